"""Types the manual of cluster operators from its first command to its last, on three virtual nodes of
this host, and compares the result with the same submission's without a cluster."""

import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tempfile
import unittest

from support import slurm

BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
MANUAL = SOURCE / "configs/CLUSTER.md"
FENCE = re.compile(r"^## (\d+)\. |^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PORTS = ("16817", "16818", "16819", "16820")
KEPT = "environment"


def sections():
    """The commands of each section, by its number."""
    found, number = {}, None
    for match in FENCE.finditer(MANUAL.read_text(encoding="utf-8")):
        if match[1]:
            number = int(match[1])
        else:
            found[number] = found.get(number, "") + match[2]
    return found


class ClusterManual(unittest.TestCase):
    def setUp(self):
        if lacking := slurm.missing():
            self.skipTest(lacking)
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="myograde-cluster-", dir="/var/tmp"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        # Policies run as users of their own, and have to get to the folder.
        self.folder.chmod(0o755)
        shutil.copytree(SOURCE / "configs", self.folder / "configs")
        self.ports = dict(zip(PORTS, range(slurm.free_ports(len(PORTS)), 65536)))
        self.environment = {key: value for key, value in os.environ.items()
                            if key not in ("MYOGRADE_CONFIG_DIR", "MYOGRADE_DATA", "SLURM_CONF")}
        self.environment["PATH"] = f"{BIN}:/usr/sbin:/sbin:{os.environ['PATH']}"
        self.addCleanup(self.end_all)

    def type(self, text, timeout=300):
        """Types commands into the same shell: what they export stays."""
        for port, free in self.ports.items():
            text = text.replace(port, str(free))
        kept = self.folder / KEPT
        script = f"test ! -e {kept} || . {kept}\n{text}\nexport -p > {kept}\n"
        with tempfile.TemporaryFile() as output:  # no pipe: what stays in the background holds it
            done = subprocess.run(["bash", "-e", "-c", script], cwd=self.folder, text=True,
                                  env=self.environment, stdin=subprocess.DEVNULL, stdout=output,
                                  stderr=output, timeout=timeout, check=False)
            output.seek(0)
            said = output.read().decode(errors="replace")
        log = self.folder / "daemon.log"
        told = log.read_text(errors="replace")[-4000:] if log.exists() else ""
        self.assertEqual(done.returncode, 0, f"{text}\n{said}\n{told}")
        return said

    def ask(self, words):
        return json.loads(self.type(f"myograde {words} --json 2> /dev/null"))

    def end_all(self):
        """What a failed test leaves behind."""
        for name in pathlib.Path("/proc").iterdir():
            if not name.name.isdigit() or int(name.name) == os.getpid():
                continue
            try:
                words = (name / "cmdline").read_bytes() + (name / "environ").read_bytes()
            except OSError:
                continue
            if str(self.folder).encode() in words:
                try:
                    os.kill(int(name.name), signal.SIGKILL)
                except ProcessLookupError:
                    pass

    def test_every_command(self):
        steps = sections()
        self.assertEqual(sorted(steps), [1, 2, 3, 4, 7])
        self.assertIn("node3", self.type(steps[1] + "scontrol show nodes\n"))
        self.assertIn("slurm_partition", self.type(steps[2]))
        self.type(steps[3])
        said = self.type(steps[4])
        self.assertIn("proved", said, "of myograde cluster nodes")
        self.assertRegex(said, r"node[123]")
        made = {"site", "cluster", "node", "data", "my-policy", "daemon.log", "status.txt"}
        self.assertEqual({path.name for path in self.folder.iterdir()}, made | {"configs", KEPT})
        for name in made:
            self.assertIn(f"`{name}`", MANUAL.read_text(encoding="utf-8"), "what the commands make")
        result = self.ask("show 1")
        local = self.ask("local my-policy --track elbow --slots 2")
        self.assertEqual(result["merkle_root"], local["merkle_root"])
        self.type('myograde cluster drain node1 --reason "new disks"\nmyograde cluster admit node1\n')
        self.type(steps[7])
        self.assertFalse(list((self.folder / "data/work").iterdir()))


if __name__ == "__main__":
    unittest.main()
