"""What a killed daemon and its killed runners leave, and that the next start removes it."""

import json
import os
import pathlib
import signal
import time
import unittest

from support.waiting import wait_until
from support import proc
from system import SystemTest, track_config


def groups_of(pid):
    """Control groups created by the process with `pid`."""
    return [path for path, _, _ in os.walk("/sys/fs/cgroup")
            if os.path.basename(path).startswith(f"myograde.{pid}.")]


def says(pid, words):
    """True if `words` are on the command line of a process."""
    try:
        return words.encode() in pathlib.Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


class Freezer:
    """A control group whose processes are frozen, so that not even SIGKILL ends them."""

    def __init__(self):
        self.folder = pathlib.Path(f"/sys/fs/cgroup/freezer/myograde-test-{os.getpid()}")
        self.folder.mkdir()

    def freeze(self, pid):
        (self.folder / "cgroup.procs").write_text(str(pid))
        self._become("FROZEN")

    def thaw(self):
        self._become("THAWED")

    def _become(self, state):
        (self.folder / "freezer.state").write_text(state)
        wait_until(lambda: (self.folder / "freezer.state").read_text().strip() == state, 60,
                   f"the freezer does not become {state}")

    def remove(self):
        self.thaw()
        wait_until(lambda: not (self.folder / "cgroup.procs").read_text(), 60,
                   "the freezer is not empty")
        self.folder.rmdir()


STOPS_PROCESSES = os.geteuid() == 0 and os.path.isdir("/sys/fs/cgroup/freezer")


class LeftoversTest(SystemTest):
    """Shared by both kinds of daemons."""

    tracks = {"long": track_config("locomotion", budgets={"startup_s": 600})}

    def wait_for(self, what, condition, seconds=60):
        wait_until(condition, seconds, what)

    def sleepers(self, seconds):
        return [pid for pid in (int(entry.name) for entry in pathlib.Path("/proc").iterdir()
                                if entry.name.isdigit())
                if says(pid, f"sleep\0{seconds}\0") and not says(pid, "sh\0")]

    def closed_slots(self):
        return self.ask("status")["daemon"]["closed_slots"]

    def crashing(self, seconds):
        """A submission that exits with status 7 on SIGUSR1, with a child that sleeps this long."""
        folder = self.root / "crashing"
        folder.mkdir()
        (folder / "run").write_text(f"#!/bin/sh\ntrap 'exit 7' USR1; sleep {seconds} &\n"
                                    "while :; do sleep 0.1; done\n")
        (folder / "run").chmod(0o755)
        (folder / "policy.json").write_text(json.dumps({"name": "c", "command": ["./run"]}))
        return folder

    def crash(self, sleeper):
        stat = pathlib.Path(f"/proc/{sleeper}/stat").read_text()
        os.kill(int(stat.rpartition(")")[2].split()[1]), signal.SIGUSR1)

    def see_a_slot_closed(self):
        """A verdict stands, and its slot stays closed, after runner and daemon have died."""
        self.daemon.configure(slots=1)
        freezer, seconds = Freezer(), 20_000_000 + os.getpid()
        self.addCleanup(freezer.remove)
        self.start_daemon()
        submission = self.ask("submit", self.crashing(seconds), "--track", "long", "--team",
                              "crash")["submission"]
        self.wait_for("no policy was started", lambda: self.sleepers(seconds))
        left, = self.sleepers(seconds)
        freezer.freeze(left)
        self.crash(left)
        self.wait_for("nothing was recorded",
                      lambda: self.ask("status", submission)["episodes"]["done"] == 1)
        for pid in proc.children(self.daemon.pid):
            os.kill(pid, signal.SIGKILL)
        self.expect_closed(seconds, left, 3)
        self.stop_daemon(signal.SIGKILL)
        self.start_daemon()
        self.expect_closed(seconds, left, 5)
        freezer.thaw()
        self.wait_for("the slot stays closed", lambda: not self.closed_slots())

        def over():
            for pid in self.sleepers(seconds):
                self.crash(pid)
            return self.ask("status", submission)["state"] == "failed"
        self.wait_for("it does not go on", over, 300)
        first = self.ask("show", submission, "--episodes")["episode_rows"][0]
        self.assertEqual((first["outcome"], first["attempt"]), ("crash", 1))
        self.assertIn("status 7", first["fault"]["detail"])
        self.assertEqual(self.stop_daemon(), 0)

    def expect_closed(self, seconds, left, for_seconds):
        """Slot 0 stays closed for that long, and nothing is played."""
        self.wait_for("the slot is not closed", self.closed_slots, 10)
        until = time.monotonic() + for_seconds
        while time.monotonic() < until:
            slot, = self.closed_slots()
            self.assertEqual(slot["slot"], 0)
            self.assertIn(f"{left} (sleep, state ", json.dumps(slot))
            self.assertEqual(self.sleepers(seconds), [left])
            time.sleep(0.5)


class Leftovers(LeftoversTest):
    def processes_of_slots(self):
        found = []
        for entry in pathlib.Path("/proc").iterdir():
            try:
                if entry.name.isdigit() and self.daemon.has_user(entry.stat().st_uid):
                    found.append(int(entry.name))
            except OSError:
                continue
        return found

    def test_the_next_start_removes_what_killed_runners_left(self):
        self.start_daemon()
        self.ask("submit", self.misbehaving("silent"), "--track", "long", "--team", "silent")
        self.wait_for("no policy was started", lambda: any(
            says(pid, "misbehaving_policy") for pid, _ in proc.below(self.daemon.pid)))
        runners = proc.children(self.daemon.pid)
        self.assertTrue(runners)
        # The runners first, so that none of them notices the daemon's death; nor does it notice theirs.
        os.kill(self.daemon.pid, signal.SIGSTOP)
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
        # Any daemon's start removes the groups of dead runners, so another one may have done it.
        self.wait_for("control groups are left",
                      lambda: not any(groups_of(pid) for pid in runners), 10)
        self.assertFalse((old | {work / "999-1"}) & set(work.iterdir()))
        self.assertTrue(os.path.exists("/etc/passwd"))
        self.assertEqual(self.stop_daemon(), 0)
        if os.geteuid() == 0:
            self.wait_for("processes outlived the daemon",
                          lambda: not self.processes_of_slots(), 10)

    @unittest.skipUnless(STOPS_PROCESSES,
                         "no slots with users of their own, or no groups that stop processes")
    def test_a_verdict_stays_and_its_slot_is_closed_over_the_death_of_runner_and_daemon(self):
        self.see_a_slot_closed()


@unittest.skipUnless(STOPS_PROCESSES, "only root can become a user and stop processes")
class LeftoversOfAUser(LeftoversTest):
    """A daemon without separate users for its slots."""

    user = 71997

    def test_a_verdict_stays_and_its_slot_is_closed_over_the_death_of_runner_and_daemon(self):
        self.see_a_slot_closed()
        # The folders that the sandboxes mount are empty, and no more than the slots.
        marks = self.data / "slots"
        self.assertEqual([(path.name, list(path.iterdir())) for path in marks.iterdir()],
                         [("0", [])])


if __name__ == "__main__":
    unittest.main(verbosity=2)
