"""The real daemon, runner, simulator and sandboxes on a host that fails, is repaired, and has its
processes killed."""

import contextlib
import json
import os
import pathlib
import shutil
import signal
import subprocess
import unittest

from soak import soak
from support.waiting import wait_until
from support import proc
from system import BIN, POLICIES, SystemTest, track_config
from whole_system_test import identities

TRACKS = {"short": track_config("locomotion", seeds={"first": 30, "count": 4},
                                episodes_per_lease=2, budgets={"startup_s": 120})}


class BrokenHost(SystemTest):
    """A host without its simulator for a while."""

    tracks = TRACKS

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.bin = cls.root / "bin"
        cls.bin.mkdir(mode=0o755)
        for program in BIN.iterdir():
            if program.name.startswith("myograde"):
                shutil.copy2(program, cls.bin)
        cls.environment["MYOGRADE_BIN_DIR"] = str(cls.bin)
        cls.daemon.configure(scheduler={"retry_delay_s": 0.5, "self_test_every_s": 3})
        cls.start_daemon()

    def wait(self, what, condition):
        return wait_until(what, 240, "it stays", condition, every_s=0.3)

    def host(self):
        return self.ask("status")["daemon"]["host"]

    def break_simulator(self):
        """Where the good one is, and where it belongs."""
        sim = self.bin / "myograde-sim"
        good = sim.rename(self.bin / "kept")
        sim.write_text("#!/bin/sh\necho the simulator was broken by an upgrade >&2\nexit 3\n")
        sim.chmod(0o755)
        return good, sim

    def test_it_pauses_says_why_and_resumes_by_itself(self):
        whole = self.ask("submit", POLICIES / "zero", "--track", "short", "--team", "a", "--wait")
        good, sim = self.break_simulator()
        submission = self.ask("submit", POLICIES / "zero", "--track", "short", "--team", "b"
                              )["submission"]
        host = self.wait(self.host, lambda found: found["state"] == "paused")
        self.assertIn("broken by an upgrade", host["reason"])
        self.assertIn("is paused", self.ask("status", submission)["waiting"])
        self.assertIn("is paused", self.run_cli("status").stdout)
        good.rename(sim)
        self.wait(lambda: self.ask("status", submission), lambda found: found["state"] == "done")
        self.assertEqual(self.host()["state"], "well")
        rows = [self.ask("show", s, "--episodes")["episode_rows"]
                for s in (whole["submission"], submission)]
        self.assertEqual(identities(rows[0]), identities(rows[1]))

    def test_a_local_run_waits_between_its_retries(self):
        good, sim = self.break_simulator()
        with subprocess.Popen(
                [BIN / "myograde", "local", POLICIES / "zero", "--track", "short", "--json"],
                env=self.environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                stderr=subprocess.PIPE, text=True) as local:
            said = next((line for line in local.stderr if "are retried" in line), "")
            good.rename(sim)
            answer, rest = local.communicate(timeout=240)
        self.assertRegex(said, "episodes . to . are retried after a fault of the grader: .*"
                               "broken by an upgrade")
        self.assertEqual(local.returncode, 0, said + rest)
        self.assertEqual(len(json.loads(answer)["episode_rows"]), 4)

    def test_a_dead_bridge_is_the_participants_and_costs_no_replay(self):
        # Each lease sleeps in its second episode, so there is time to find its bridge.
        submission = self.ask("submit", self.misbehaving("sleeps"), "--track", "short", "--team",
                              "c")["submission"]

        def kill_bridges():
            for pid, name in proc.below(self.daemon.pid):
                if name == "myograde-bridge":
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(pid, signal.SIGKILL)
            return self.ask("status", submission)

        status = self.wait(kill_bridges,
                           lambda found: found["state"] not in ("queued", "running"))
        self.assertEqual([(l["attempt"], l["faults"]) for l in status["blocks"]], [(1, 0)] * 2)
        rows = self.ask("show", submission, "--episodes")["episode_rows"]
        self.assertIn("crash", [row["outcome"] for row in rows])

    def test_cancel_leaves_no_process(self):
        submission = self.ask("submit", POLICIES / "random", "--track", "locomotion", "--team", "d"
                              )["submission"]
        self.wait(lambda: [name for _, name in proc.below(self.daemon.pid)],
                  lambda names: "myograde-bridge" in names)
        status = self.ask("cancel", submission, "--reason", "a mistake")
        self.assertEqual((status["state"], status["reason"]), ("cancelled", "a mistake"))
        self.assertGreaterEqual(status["cancel"]["killed"], 1)
        self.assertLess(status["cancel"]["took_wall_s"], 1)
        self.assertEqual(proc.below(self.daemon.pid), [])
        self.assertEqual(list(pathlib.Path(self.data / "work").iterdir()), [])


class Soak(unittest.TestCase):
    def test_the_board_is_the_undisturbed_one(self):
        blows = soak(0.5, seed=11, rounds=3)
        self.assertGreater(sum(blows.values()), 5)


if __name__ == "__main__":
    unittest.main(verbosity=2)
