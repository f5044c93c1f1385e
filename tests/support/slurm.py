"""A Slurm cluster of this host's own: munged, slurmctld and a slurmd for each of several virtual
nodes, in a folder of their own, without systemd. They run as the caller."""

import contextlib
import os
import pathlib
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile

from . import proc
from .waiting import wait_until

PROGRAMS = ("munged", "slurmctld", "slurmd", "srun", "squeue", "scancel", "scontrol", "sinfo")
START_S = 60
STOP_S = 10

CONFIG = """\
ClusterName={cluster}
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={port}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={root}/munge/socket
CryptoType=crypto/munge
StateSaveLocation={root}/state
SlurmdSpoolDir={root}/%n
SlurmctldPidFile={root}/slurmctld.pid
SlurmdPidFile={root}/slurmd-%n.pid
SlurmctldLogFile={root}/slurmctld.log
SlurmdLogFile={root}/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=bf_interval=1,sched_min_interval=50000,batch_sched_delay=0
PriorityType=priority/basic
SwitchType=switch/none
MpiDefault=none
SlurmdParameters=config_overrides
ReturnToService=2
SlurmdTimeout={slurmd_timeout}
SlurmctldTimeout=10
MessageTimeout=5
KillWait={kill_wait}
MinJobAge={min_job_age}
OverTimeLimit=0
{extra}
NodeName={nodes} NodeHostname={host} NodeAddr=127.0.0.1 Port={ports} CPUs={cpus} RealMemory=4096
PartitionName=grading Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def missing():
    """Why there can be no cluster on this host; "" if there can."""
    paths = os.pathsep.join([os.environ.get("PATH", ""), "/usr/sbin", "/sbin"])
    lacking = [name for name in PROGRAMS if shutil.which(name, path=paths) is None]
    return f"Slurm is not installed (no {', '.join(lacking)})" if lacking else ""


def free_ports(count):
    """Free ports in a row: slurmd's are given as a range."""
    for first in range(20000 + os.getpid() % 20000, 60000, count):
        with contextlib.ExitStack() as stack:
            try:
                for port in range(first, first + count):
                    listener = stack.enter_context(socket.socket())
                    listener.bind(("127.0.0.1", port))
                return first
            except OSError:
                continue
    raise OSError("no free ports")


class Slurm:
    """A cluster of nodes "n1" to "nN". Not started yet; close() ends all of it, as does the end of a
    `with`. `options`: further lines of slurm.conf."""

    def __init__(self, nodes=3, cpus=1, options=(), slurmd_timeout=5, kill_wait=2, min_job_age=10):
        self.root = pathlib.Path(tempfile.mkdtemp(prefix="myograde-slurm-"))
        os.chmod(self.root, 0o755)
        self.nodes = [f"n{i + 1}" for i in range(nodes)]
        self.config = self.root / "slurm.conf"
        self.environment = dict(os.environ, SLURM_CONF=str(self.config), PATH=os.pathsep.join(
            [os.environ.get("PATH", ""), "/usr/sbin", "/sbin"]))
        port = free_ports(nodes + 1)
        self.config.write_text(CONFIG.format(
            cluster=f"test{os.getpid()}", host=socket.gethostname().split(".")[0], port=port,
            user=pwd.getpwuid(os.geteuid()).pw_name, root=self.root, nodes=f"n[1-{nodes}]",
            ports=f"[{port + 1}-{port + nodes}]", cpus=cpus, slurmd_timeout=slurmd_timeout,
            kill_wait=kill_wait, min_job_age=min_job_age, extra="\n".join(options)))
        self.processes = {}  # by name: "munged", "slurmctld", and those of nodes

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self.close()

    # --- starting and stopping ---

    def _launch(self, name, *words):
        with open(self.root / f"{name}.out", "ab") as out:
            self.processes[name] = subprocess.Popen(
                words, env=self.environment, stdin=subprocess.DEVNULL, stdout=out, stderr=out,
                start_new_session=True)

    def start(self):
        """Returns when all nodes are idle."""
        munge = self.root / "munge"
        munge.mkdir(mode=0o711)
        (self.root / "state").mkdir(mode=0o700)
        (munge / "key").write_bytes(os.urandom(1024))
        os.chmod(munge / "key", 0o400)
        self._launch("munged", "munged", "--foreground", "--force", f"--key-file={munge}/key",
                     f"--socket={munge}/socket", f"--pid-file={munge}/pid",
                     f"--log-file={munge}/log", f"--seed-file={munge}/seed")
        wait_until((munge / "socket").exists, START_S, "munged has no socket")
        self.start_controller()
        for node in self.nodes:
            self.start_node(node)
        wait_until(lambda: self.node_states(), START_S, "not all nodes are idle",
                   lambda states: all(states.get(node) == "idle" for node in self.nodes))

    def start_controller(self):
        self._launch("slurmctld", "slurmctld", "-D")
        wait_until(lambda: self.run("scontrol", "ping").stdout, START_S, "slurmctld is down",
                   lambda said: " is UP" in said)

    def stop_controller(self):
        self._end("slurmctld", signal.SIGTERM)

    def start_node(self, node):
        self._launch(node, "slurmd", "-D", "-N", node)

    def kill_daemon(self, node):
        """Kills the node's slurmd alone: what it started goes on."""
        self._end(node, signal.SIGKILL)

    def kill_node(self, node):
        """Kills the node with all that runs there."""
        self.kill_daemon(node)
        for pid in self.processes_of(node):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

    def _end(self, name, how):
        process = self.processes.pop(name, None)
        if process is None:
            return
        process.send_signal(how)
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def close(self):
        for node in self.nodes:
            self.kill_node(node)
        self._end("slurmctld", signal.SIGKILL)
        for pid in self.processes_of(None):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self._end("munged", signal.SIGTERM)
        shutil.rmtree(self.root, ignore_errors=True)

    # --- looking ---

    def run(self, *words):
        """One of Slurm's commands."""
        return subprocess.run(words, env=self.environment, stdin=subprocess.DEVNULL,
                              capture_output=True, text=True, timeout=60, check=False)

    def node_states(self):
        """Name -> state, as sinfo shows them."""
        lines = self.run("sinfo", "-h", "-N", "-o", "%N %t").stdout.split("\n")
        return dict(line.split() for line in lines if line)

    def jobs(self, *states):
        """Tasks as (id, state, node), of these states or of all that are not over."""
        which = [f"--states={','.join(states)}"] if states else []
        said = self.run("squeue", "-h", "-r", *which, "-o", "%i|%T|%N").stdout
        return [tuple(line.split("|")) for line in said.split("\n") if line]

    def processes_of(self, node):
        """The jobs' processes on a node, and those of Slurm that look after them, which come first;
        of `None`: on any node. Processes in a lease's sandboxes end with these."""
        mark = f"SLURM_CONF={self.config}".encode()
        name = f"SLURMD_NODENAME={node}".encode()
        own = {os.getpid(), *(process.pid for process in self.processes.values())}
        jobs, keepers = [], []
        for entry in pathlib.Path("/proc").iterdir():
            if not entry.name.isdigit() or int(entry.name) in own:
                continue
            try:
                variables = (entry / "environ").read_bytes().split(b"\0")
                parent = int(proc.status(entry.name)["PPid"])
            except (OSError, KeyError):
                continue  # it has ended, or is another user's
            if mark not in variables or (node is not None and name not in variables):
                continue
            jobs.append(int(entry.name))
            if node is not None and parent != 1 and parent not in own:
                keepers.append(parent)
        return keepers + jobs

    def log(self):
        """The ends of all logs."""
        return "\n".join(f"{path.name}:\n{path.read_text(errors='replace')[-2000:]}"
                         for path in sorted(self.root.glob("*.log")))


def wait_for_job(slurm, state, seconds=60):
    """The id and node of the first task in this state."""
    def look():
        return [(job, node) for job, found, node in slurm.jobs() if found == state]
    return wait_until(look, seconds, f"no job is {state}: {slurm.jobs()}")[0]



class Wrapped:
    """A folder with Slurm's commands that can be made to fail, for `slurm_bin_dir`: while there is a
    file "srun.fail" beside them, srun fails; with "srun.hang" it hangs. The same with the others."""

    SCRIPT = """\
#!/bin/sh
d={folder}
n={name}
[ -e "$d/$n.hang" ] && {{ while [ -e "$d/$n.hang" ]; do sleep 0.2; done; exit 1; }}
[ -e "$d/$n.fail" ] && {{ echo "$n: error: it is made to fail" >&2; exit 1; }}
exec {program} "$@"
"""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.folder.mkdir()
        for name in ("srun", "squeue", "scancel", "sinfo"):
            path = self.folder / name
            path.write_text(self.SCRIPT.format(folder=self.folder, name=name,
                                               program=shutil.which(name)))
            path.chmod(0o755)

    @contextlib.contextmanager
    def made_to(self, name, what):
        flag = self.folder / f"{name}.{what}"
        flag.touch()
        try:
            yield
        finally:
            flag.unlink(missing_ok=True)
