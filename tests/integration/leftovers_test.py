"""What a killed daemon and its killed runners leave, and that the next start removes it."""

import json
import os
import pathlib
import signal
import time
import unittest

from system import SystemTest, track_config


def children_of(pid):
    """Processes whose parent is `pid`."""
    found = []
    for entry in pathlib.Path("/proc").iterdir():
        try:
            stat = (entry / "stat").read_text() if entry.name.isdigit() else ""
        except OSError:
            continue
        fields = stat.rpartition(")")[2].split()
        if fields and int(fields[1]) == pid:
            found.append(int(entry.name))
    return found


def groups_of(pid):
    """Control groups that the process with `pid` made."""
    return [path for path, _, _ in os.walk("/sys/fs/cgroup")
            if os.path.basename(path).startswith(f"myograde.{pid}.")]


def says(pid, words):
    """True if `words` are on the command line of a process."""
    try:
        return words.encode() in pathlib.Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


def below(pid):
    """All that descend of a process."""
    found = children_of(pid)
    return found + [other for child in found for other in below(child)]


class Leftovers(SystemTest):
    tracks = {"long": track_config("locomotion", budgets={"startup_s": 600})}

    def wait_for(self, what, condition, seconds=60):
        deadline = time.monotonic() + seconds
        while not condition():
            self.assertLess(time.monotonic(), deadline, what)
            time.sleep(0.1)

    def processes_of_slots(self):
        base = int(self.ask_config("uid_base"))
        found = []
        for entry in pathlib.Path("/proc").iterdir():
            try:
                if entry.name.isdigit() and base <= entry.stat().st_uid < base + 8192:
                    found.append(int(entry.name))
            except OSError:
                continue
        return found

    def ask_config(self, key):
        return json.loads((self.root / "configs" / "server.json").read_text())[key]

    def test_the_next_start_removes_what_killed_runners_left(self):
        self.start_daemon()
        self.ask("submit", self.misbehaving("silent"), "--track", "long", "--team", "silent")
        self.wait_for("no policy was started", lambda: any(
            says(pid, "misbehaving_policy") for pid in below(self.daemon.pid)))
        runners = children_of(self.daemon.pid)
        self.assertTrue(runners)
        # The runners first, so that none of them hears that the daemon is gone.
        for pid in runners:
            os.kill(pid, signal.SIGKILL)
        self.stop_daemon(signal.SIGKILL)
        if os.geteuid() == 0:
            self.wait_for("processes outlived their runner",
                          lambda: not self.processes_of_slots(), 10)
        work = self.data / "work"
        self.assertTrue(list(work.iterdir()))
        old = set(work.iterdir())
        (work / "999-1").mkdir()
        (work / "999-1" / "link").symlink_to("/etc")
        self.start_daemon()
        # Any daemon's start removes the groups of runners that are dead, so another one's may have.
        self.wait_for("control groups are left",
                      lambda: not any(groups_of(pid) for pid in runners), 10)
        self.assertFalse((old | {work / "999-1"}) & set(work.iterdir()))
        self.assertTrue(os.path.exists("/etc/passwd"))
        self.assertEqual(self.stop_daemon(), 0)
        if os.geteuid() == 0:
            self.wait_for("processes outlived the daemon",
                          lambda: not self.processes_of_slots(), 10)


if __name__ == "__main__":
    unittest.main(verbosity=2)
