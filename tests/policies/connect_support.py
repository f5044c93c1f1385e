"""A daemon whose leases play without physics, and a stand-in for EvalAI, for the tests of the connector."""

import json
import os
import pathlib
import unittest
import unittest.mock

from myograde.client import Client
from myograde.connect import worker
from myograde.connect.settings import Settings
from myograde.connect.worker import Worker
from support.daemon import Daemon
from support.evalai import Evalai
from support.waiting import wait_until

BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
TRACK, LONG_S = "demo-manipulation", 60
COLUMNS = {"Score": "score", "Success": "success_rate", "Success error": "success_rate.error", "Time": "time_s"}
SCHEMA = {"labels": list(COLUMNS), "default_order_by": "Score"}
FAST = 0.05  # s between two looks


class WithChallenge(unittest.TestCase):
    """A daemon with a challenge of two phases for each class."""

    @classmethod
    def setUpClass(cls):
        cls.daemon = Daemon(BIN, SOURCE, "connect")
        cls.addClassCleanup(cls.daemon.close)
        cls.daemon.use_stand_in_runner()
        cls.daemon.command = [BIN / "myograded"]
        cls.daemon.environment["MYOGRADE_CACHE"] = str(cls.daemon.root / "cache")
        cls.daemon.change_config(f"tracks/{TRACK}.json", episodes_per_lease=2, seeds={"first": 0, "count": 10},
                                 practice_seeds={"first": 100, "count": 6},
                                 scoring={"boards": {"main": {"band_factor": 2}}})
        quota = {"official_per_day": 1000, "official_total": 1000, "same_artefact": "team"}
        (cls.daemon.configs / "challenges").mkdir(exist_ok=True)
        (cls.daemon.configs / "challenges/cup.json").write_text(json.dumps({
            "form": 1, "title": "Cup", "phases": [
                {"name": name, "title": name, "track": TRACK, "profile": "paper", "quota": quota,
                 "seeds": {"first": 1000 * year, "count": 10}, "opens_at": f"20{year}-01-01T00:00:00Z", "closes_at": f"20{year + 20}-12-31T00:00:00Z"}
                for name, year in (("warm-up", 20), ("final", 21))]}))
        cls.daemon.configure(slots=2)
        cls.daemon.start()
        cls.client = Client(data=cls.daemon.data)

    def here(self, team, phase=None):
        return sorted(self.client.submissions(team=team, phase=phase), key=lambda known: known["submission"])


class WithBoth(WithChallenge):
    """And an EvalAI for each test."""

    def setUp(self):
        patch = unittest.mock.patch.multiple(worker, LONGEST_WAIT_S=FAST)
        patch.start()
        self.addCleanup(patch.stop)
        self.evalai = Evalai({3001: {"test": SCHEMA}, 3002: {"test": SCHEMA}})
        self.addCleanup(self.evalai.close)
        self.folder = self.daemon.root / self.id().rsplit(".", 1)[-1]
        self.folder.mkdir()
        (self.folder / "evalai.token").write_text(self.evalai.token + "\n")
        self.settings()

    def settings(self, **changes):
        file = self.folder / "connect.json"
        file.write_text(json.dumps({
            "//": "A comment.",
            "evalai": {"server": self.evalai.url, "challenge": self.evalai.challenge, "queue": self.evalai.queue,
                       "token_file": "evalai.token"},
            "myograde": {"server": str(self.daemon.socket_path), "pages": "https://grader.example.org"},
            "poll_s": FAST,
            "phases": {"3001": {"phase": "warm-up", "splits": {"test": COLUMNS}},
                       "3002": {"phase": "final", "splits": {"test": COLUMNS}}}, **changes}))
        return Settings(str(file))

    def start(self, **changes):
        made = Worker(self.settings(**changes))
        self.addCleanup(made.state.close)
        return made

    def turn_until(self, made, look, what="the connector did not come so far"):
        def turned():
            made.turn()
            return look()
        return wait_until(turned, LONG_S, what, every_s=FAST)

    def status(self, number):
        return self.evalai.submissions[number]["status"]

    def all_over(self):
        return not self.evalai.messages and all(
            found["status"] in ("finished", "failed", "cancelled") for found in self.evalai.submissions.values())
