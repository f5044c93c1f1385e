"""The daemon is killed before and after every commit of a rejudge, from its creation to its second
application: nothing is lost, and the board is always that of what was done."""

import http.client
import os
import pathlib
import shutil
import signal
import sqlite3
import time
import unittest

from phases_test import TRACK
from rejudge_case import RejudgeCase, Skill
from support.sanitizer import asan_options
from support.waiting import wait_until

KILLER = os.environ.get("MYOGRADE_TEST_KILLER", "")
FULL = os.environ.get("MYOGRADE_TEST_FULL", "") != ""
SKILLS = [("alpha", Skill(5, otherwise=1, force=900)), ("beta", Skill(4, otherwise=3))]
OLD, NEW = ["alpha", "beta"], ["beta", "alpha"]
ACTS = ["created", "applied", "dropped", "applied"]
VERBS = {"applied": "apply", "dropped": "drop"}
CONFIGS = {"facts": {"extends": TRACK, "scoring": {"force_limit_n": 500}},
           "play": {"extends": TRACK, "rules": {"max_time_s": 20}}}
TROUBLE = (OSError, http.client.HTTPException, AssertionError, ValueError, KeyError)


class Killed(RejudgeCase):
    def setUp(self):
        self.assertTrue(pathlib.Path(KILLER).exists(), "build kill_at_sync first")
        super().setUp()
        for team, skill in SKILLS:
            self.played(skill.mode, team)
        self.stop(signal.SIGTERM)
        self.clean = self.folder / "clean"
        shutil.copytree(self.data, self.clean, ignore=shutil.ignore_patterns("*.sock"))

    def post(self, path, body):
        status, answer = self.call("POST", path, {"reason": "r", **body})
        self.assertIn(status, (200, 201), answer)
        return answer

    def go_on(self, config):
        """Does what is left of ACTS. True: there is nothing left."""
        listed = self.get("/v1/rejudges")["rejudges"]
        if not listed:
            self.post("/v1/rejudges", {"track": TRACK, "config": config})
            return False
        self.assertEqual(len(listed), 1)
        rejudge = self.get("/v1/rejudges/1")
        done = [event["event"] for event in rejudge["events"]]
        self.assertEqual(done, ACTS[:len(done)])
        if len(done) == len(ACTS):
            return True
        if rejudge["state"] != "computing":
            self.post(f"/v1/rejudges/1/{VERBS[ACTS[len(done)]]}", {})
        return False

    def run_until_killed(self, config, when):
        """False: the daemon survived all of it."""
        # Otherwise a sanitizer's runtime would refuse to load after the preloaded library.
        self.daemon.process = self.daemon.launch(
            LD_PRELOAD=KILLER, KILL_AT_SYNC=when, ASAN_OPTIONS=asan_options("verify_asan_link_order=0"))
        deadline = time.monotonic() + 120
        try:
            while self.daemon.running and time.monotonic() < deadline:
                try:
                    if self.go_on(config):
                        return False
                except TROUBLE:
                    pass  # not up yet, or killed during the request
                time.sleep(0.02)
        finally:
            status = self.stop(signal.SIGKILL)
        self.assertEqual(status, -signal.SIGKILL, self.daemon.state())
        return True

    def check_board(self):
        """It is that of the latest act that was written."""
        listed = self.get("/v1/rejudges")["rejudges"]
        applied = bool(listed) and listed[0]["state"] == "applied"
        self.assertEqual(self.order(), NEW if applied else OLD)

    def check_end(self):
        self.check_board()
        rejudge = self.get("/v1/rejudges/1")
        self.assertEqual(self.check_signatures(rejudge), ACTS)
        self.assertEqual((rejudge["items"]["ended"], rejudge["without_result"]),
                         (len(SKILLS), []))
        with sqlite3.connect(self.data / "store.db") as store:
            self.assertEqual(store.execute("PRAGMA integrity_check").fetchall(), [("ok",)])
            self.assertEqual(store.execute("PRAGMA foreign_key_check").fetchall(), [])
        store.close()

    def kill_at_every_commit(self, config, sides):
        for side in sides:
            number, killed = 0, True
            while killed:
                number += 1
                shutil.rmtree(self.data)
                shutil.copytree(self.clean, self.data)
                killed = self.run_until_killed(config, f"{side}:{number}")
                self.start()
                with self.subTest(side=side, commit=number):
                    self.check_board()
                    wait_until(lambda: self.go_on(config), 120, "it is not done")
                    self.check_end()
                self.stop(signal.SIGTERM)
                self.assertLess(number, 200, "every start of the daemon is killed")
            self.assertGreater(number, 4, "creating, computing, three acts")

    def test_from_facts(self):
        self.kill_at_every_commit(CONFIGS["facts"], ("before", "after") if FULL else ("after",))

    @unittest.skipUnless(FULL, "it takes minutes; ./dev test --full plays it")
    def test_played(self):
        self.kill_at_every_commit(CONFIGS["play"], sides=("after",))


if __name__ == "__main__":
    unittest.main(verbosity=2)
