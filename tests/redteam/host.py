"""The host's side of the suite: a separate daemon with the suite's tracks, and checks for what it
leaves on the host."""

import contextlib
import json
import os
import pathlib
import time

from support import proc
from support.daemon import Daemon
from support.sanitizer import asan_options

SLOTS = 3
MOST_READERS = 64
VERB_S = 120
# Large and unlike anything that would occur by chance, so that they can be searched for.
SEEDS = [914207635518432 + i for i in range(20)]
RANKED = {"first": 5000, "count": 20}  # all hostile programs are played as practice

BUDGETS = {
    "startup_s": 20, "startup_wall_s": 80, "step_s": 0.2, "overtime_s": 0.8, "wall_factor": 6, "lease_cpu_s": 40,
    "lease_wall_s": 90, "memory_bytes": 256 << 20, "cpus": 1, "tasks": 128,
    "scratch_bytes": 32 << 20, "scratch_files": 2000, "output_bytes": 65536, "open_files": 256,
    "stray_messages": 1000, "wrong_answers": 16, "restarts": 1,
}


def _track(base="locomotion", **budgets):
    return {"extends": base, "seeds": RANKED, "practice_seeds": SEEDS, "episodes_per_lease": 20,
            "budgets": {**BUDGETS, **budgets}}


TRACKS = {
    "rt": _track(),
    "rt-start": _track(startup_s=4, startup_wall_s=40),
    "rt-spin": _track(wall_factor=60),  # a busy host gives a spinner little CPU time
    "rt-patient": _track(overtime_s=10),
    "rt-lease": _track(lease_wall_s=8),
    "rt-cpu": _track(lease_cpu_s=3, overtime_s=10),
    "rt-idle": _track(lease_idle_s=3),
    "rt-memory": _track(memory_bytes=96 << 20, scratch_bytes=512 << 20, startup_s=15),
    "rt-arm": _track(base="manipulation"),
    "rt-often": _track(restarts=20, overtime_s=0.2, wall_factor=30),
    "rt-honest": {"extends": "locomotion", "seeds": {"first": 4100, "count": 2},
                  "episodes_per_lease": 2},
}


class Host(Daemon):
    """A daemon with the suite's tracks. `user`: an ordinary user's id to run it as, or None."""

    CANARY = "a file of the host that everybody may write to\n"

    def __init__(self, programs, source, user=None):
        # The daemon plays others at leisure, and the suite would see that as something left. This one
        # is played before the first honest submission.
        super().__init__(programs, source, "redteam", user, references=("locomotion",))
        self.data.mkdir(exist_ok=True)
        quota = json.loads((self.configs / "server.json").read_text())["quota"]
        # Its crowds are there to take places and time, which the limit on requests would save.
        self.configure(slots=SLOTS, artefacts={"bytes": 64 << 20, "files": 1000},
                       http={"requests_per_s": 1e6, "burst": 1e6},
                       quota={key: 10**6 for key in quota
                              if key.endswith(("_per_day", "_total")) or key == "waiting"})
        for name, track in TRACKS.items():
            self.add_track(name, track)
        # AddressSanitizer quarantines freed memory: keep that small, so that growth is visible.
        self.environment.update(ASAN_OPTIONS=asan_options("quarantine_size_mb=16"), NO_COLOR="1")
        self.runners = set()

    # --- requests to the daemon ---

    def verb(self, *words):
        """A verb's result, in bytes, whatever its exit status."""
        return self.run_verb(*words, timeout_s=VERB_S)

    def submit(self, folder, track, team, episodes=None, profile=None):
        """The submission's id."""
        words = ["submit", folder, "--track", track, "--team", team, "--json"]
        if episodes is not None:
            words += ["--episodes", episodes]
        if profile is not None:
            words += ["--profile", profile]
        done = self.verb(*words)
        if done.returncode != 0:
            raise RuntimeError(f"submit: {done.stderr.decode(errors='replace').strip()}")
        return json.loads(done.stdout)["submission"]

    def wait(self, submission, timeout):
        """Its status once it has ended; None if it has not in `timeout` s."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            self.note_runners()
            status = self.get(f"/v1/submissions/{submission}")
            if status["state"] not in ("queued", "running"):
                return status
            time.sleep(0.03)
        return None

    def result(self, submission):
        return self.get(f"/v1/submissions/{submission}/result?episodes=1")

    # --- what exists, and what is left ---

    def note_runners(self):
        """Remembers the runners' process ids: control groups are named after them. Uses the
        kernel's own list, as this is called all the time."""
        for path in pathlib.Path(f"/proc/{self.pid}/task").glob("*/children"):
            try:
                self.runners.update(path.read_text().split())
            except OSError:
                pass

    def _slot_uids(self):
        return range(self.uid_base, self.uid_base + SLOTS)

    def _own_uids(self):
        """Users that belong to this daemon alone."""
        return {*self._slot_uids(), *([] if self.user is None else [self.user])}

    def _processes(self):
        """Processes of the slots' users, or below the daemon."""
        suspects = {}
        for name in os.listdir("/proc"):
            if not name.isdigit():
                continue
            try:
                entries = proc.status(name)
            except OSError:
                continue
            uid = int(entries["Uid"].split()[0])
            inside = len(entries.get("NSpid", "").split()) > 1
            own_user = self.user if self.user is not None else os.getuid()
            if uid in self._slot_uids() or (own_user != 0 and uid == own_user and inside):
                suspects[int(name)] = entries["Name"]
        for pid, name in proc.below(self.pid):
            suspects.setdefault(pid, f"{name}, below the daemon")
        return [f"process {pid} ({name})" for pid, name in suspects.items()]

    def _mounts(self):
        found = []
        for pid in ("self", self.pid):
            lines = pathlib.Path(f"/proc/{pid}/mountinfo").read_text().splitlines()
            found += [f"mount {line.split()[4]}" for line in lines
                      if str(self.root) in line or " scratch " in line or "newroot" in line]
        return found

    def _groups(self):
        found = []
        for folder, folders, _ in os.walk("/sys/fs/cgroup"):
            for name in list(folders):
                if name.startswith("myograde."):
                    folders.remove(name)
                    if name.split(".")[1].split("-")[0] in self.runners:
                        found.append(f"control group {folder}/{name}")
        return found

    def _objects(self):
        """System V objects, and files of the slots' users in world-writable places."""
        found = []
        for kind, column in (("shm", 7), ("msg", 7), ("sem", 4)):
            path = pathlib.Path(f"/proc/sysvipc/{kind}")
            for line in path.read_text().splitlines()[1:] if path.exists() else []:
                if int(line.split()[column]) in self._own_uids():
                    found.append(f"System V {kind} {line.split()[1]}")
        for folder in ("/dev/shm", "/tmp", "/var/tmp", "/dev/mqueue"):
            for entry in os.scandir(folder) if os.path.isdir(folder) else ():
                try:
                    uid = entry.stat(follow_symlinks=False).st_uid
                except OSError:
                    continue  # another user's, gone since it was listed
                if uid in self._own_uids() and entry.path != str(self.root):
                    found.append(f"file {entry.path}")
        for kind in ("tcp", "tcp6", "udp", "udp6", "raw"):
            path = pathlib.Path(f"/proc/net/{kind}")
            for line in path.read_text().splitlines()[1:] if path.exists() else []:
                if int(line.split()[7]) in self._own_uids():
                    found.append(f"socket {kind} {line.split()[1]}")
        return found

    def _scratch(self):
        found = []
        for name in ("work", "spool"):
            if (self.data / name).is_dir():
                found += [f"file {path}" for path in (self.data / name).iterdir()]
        return found

    def leftovers(self):
        return (self._processes() + self._mounts() + self._groups() + self._objects()
                + self._scratch())

    def wait_clean(self, timeout):
        """What is still there after `timeout` s of waiting, how long it took to go, and what went
        last."""
        begin, last = time.monotonic(), []
        while True:
            left = self.leftovers()
            spent = time.monotonic() - begin
            if not left or spent > timeout:
                return left, spent, last
            last = left
            time.sleep(0.02)

    def _descriptors(self):
        """The daemon's, except the store's: it keeps one reader for each request that was ever
        answered concurrently, which are no more than its workers."""
        folder = pathlib.Path(f"/proc/{self.pid}/fd")
        of_store, others = 0, 0
        for fd in os.listdir(folder):
            with contextlib.suppress(FileNotFoundError):
                if "/store.db" in os.readlink(folder / fd):
                    of_store += 1
                else:
                    others += 1
        # A reader has the file, its write-ahead log and its index open.
        if of_store > 3 * MOST_READERS:
            raise RuntimeError(f"the daemon has {of_store} descriptors of its store")
        return others

    def daemon_use(self):
        """Resident memory in MiB, open descriptors and threads of the daemon."""
        if not self.running:
            raise RuntimeError(self.state())
        return {"memory_mib": proc.memory_bytes(self.pid) / 2**20,
                "descriptors": self._descriptors(),
                "threads": int(proc.status(self.pid)["Threads"])}
