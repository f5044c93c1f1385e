"""Leases while the host's calendar is set forwards and back, by more than any silence or deadline
allows. Only the programs under test see it: shifted_calendar.c is loaded into them."""

import contextlib
import os
import pathlib
import struct
import subprocess
import threading
import unittest

from system import POLICIES, SystemTest, track_config
from whole_system_test import identities

STEPS_S = (200, 0, -200, 90000, 0)
ENOUGH = 4 * len(STEPS_S)


class Calendar(SystemTest):
    # Short enough for minutes, long enough for many calendar changes.
    tracks = {"short": track_config("locomotion", seeds={"first": 30, "count": 2},
                                    episodes_per_lease=1, budgets={"startup_s": 120})}

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.calendar = cls.root / "calendar"
        cls.set_calendar(0)
        cls.environment.update(LD_PRELOAD=os.environ["MYOGRADE_TEST_SHIFT"],
                               MYOGRADE_TEST_CALENDAR=str(cls.calendar),
                               ASAN_OPTIONS=":".join(filter(None, [
                                   os.environ.get("ASAN_OPTIONS"), "verify_asan_link_order=0"])))
        cls.start_daemon()

    @classmethod
    def set_calendar(cls, seconds):
        with open(cls.calendar, "r+b" if cls.calendar.exists() else "xb") as file:
            file.write(struct.pack("=q", seconds))

    @contextlib.contextmanager
    def stepping(self):
        """Changes the calendar repeatedly; yields the list of its settings."""
        steps, stop = [], threading.Event()

        def step():
            while not stop.wait(0.1):
                steps.append(STEPS_S[len(steps) % len(STEPS_S)])
                self.set_calendar(steps[-1])

        thread = threading.Thread(target=step)
        thread.start()
        try:
            yield steps
        finally:
            stop.set()
            thread.join()
            self.set_calendar(0)

    def rows(self, submission):
        shown = self.ask("show", submission, "--episodes")
        self.assertEqual(shown["state"], "done")
        return identities(shown["episode_rows"])

    def test_the_calendar_of_the_programs_is_shifted(self):
        self.set_calendar(90000)
        try:
            shown = subprocess.run(["date", "+%s"], env=self.environment, text=True,
                                   capture_output=True, check=True).stdout
        finally:
            self.set_calendar(0)
        self.assertGreater(int(shown) - pathlib.Path(self.calendar).stat().st_mtime, 80000)

    def test_a_healthy_lease_stays_healthy_and_comes_out_the_same(self):
        quiet = self.ask("submit", POLICIES / "zero", "--track", "short", "--team", "quiet",
                         "--wait")["submission"]
        stepped = []
        with self.stepping() as steps:
            while len(steps) <= ENOUGH:  # however quick the host is
                stepped.append(self.ask("submit", POLICIES / "zero", "--track", "short", "--team",
                                        f"stepped {len(stepped)}", "--wait")["submission"])
        for submission in stepped:
            status = self.ask("status", submission)
            self.assertEqual([block["faults"] for block in status["blocks"]], [0, 0])
            self.assertEqual(self.rows(submission), self.rows(quiet))

    def test_a_run_without_a_daemon_does_too(self):
        with self.stepping() as steps:
            while len(steps) <= ENOUGH:
                result = self.ask("local", POLICIES / "zero", "--track", "short")
                # Its measured durations are real time, too.
                self.assertLess(abs(result["wall"]["wall_s"]), 80000)


if __name__ == "__main__":
    unittest.main()
