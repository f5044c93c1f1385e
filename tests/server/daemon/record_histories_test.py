"""Random histories of a challenge: whatever teams and organisers do, a copy of the record holds, one
altered bit of it is found, and a daemon that imports the store shows the same. MYOGRADE_TEST_FULL: more
of them."""

import json
import os
import random
import shutil
import signal
import unittest

from phases_test import TRACK, moment, seeds
from record_test import RecordCase
from rejudge_case import RejudgeCase, Skill

HISTORIES = 24 if os.environ.get("MYOGRADE_TEST_FULL") else 2
COPIES = 5
ALTERATIONS = 4


class Histories(RejudgeCase, RecordCase):
    """A history plays on the phases "final" and "warm", or on the track's own board."""

    def history(self, number):
        self.dice = random.Random(number)
        self.teams = ["alpha", "beta", "gamma", "delta"]
        self.submissions = []
        self.boards = [("--track", TRACK)]
        if self.dice.random() < 0.7:
            self.hold(final=self.some_phase(3000), warm=self.some_phase(4000))
            self.boards = [("--phase", "final"), ("--phase", "warm")]
        acts = [self.enter] * 6 + [self.mark, self.mark, self.rename, self.merge, self.ban, self.choose,
                                   self.rejudge, self.rejudge, self.drop, self.publish]
        for copy in range(COPIES):
            for _ in range(self.dice.randint(2, 6)):
                self.dice.choice(acts)()
            folder = self.exported(f"copy-{copy}")
            answer = self.verify(folder)
            self.assertTrue(answer["valid"], (number, copy, answer["checks"]))
            for _ in range(ALTERATIONS):
                self.alter(folder, number)
            shutil.rmtree(folder)
        before = self.shown()
        self.import_elsewhere()
        self.assertEqual(self.shown(), before, number)

    def some_phase(self, first):
        phase = {"seeds": self.dice.choice([seeds(first), {"committed": 6}]), "opens_at": moment(hours=-1)}
        if self.dice.random() < 0.7:
            phase["entry"] = self.dice.choice(["best", "last", "chosen"])
        if self.dice.random() < 0.7:
            phase["statistics"] = {"ranks": "groups"}
        return phase

    def alter(self, folder, number):
        file = self.dice.choice(sorted(path for path in folder.rglob("*")
                                       if path.is_file() and path.stat().st_size > 0))
        whole = file.read_bytes()
        place = self.dice.randrange(len(whole))
        altered = whole[place] ^ 1 << self.dice.randrange(8)
        file.write_bytes(whole[:place] + bytes([altered]) + whole[place + 1:])
        done = self.daemon.run_verb("verify", "--all", folder, "--key", self.key(), timeout_s=60)
        self.assertIn(done.returncode, (1, 2), (number, file, place, altered, done))
        file.write_bytes(whole)

    def shown(self):
        answers = [self.get("/v1/teams"), self.get("/v1/submissions?limit=1000")]
        for rejudge in self.get("/v1/rejudges")["rejudges"]:
            answers.append(self.get(f"/v1/rejudges/{rejudge['rejudge']}?changes=1"))
        for kind, name in self.boards:
            path = f"/v1/leaderboard?{kind[2:]}={name}"
            answers.append(self.get(path))
            for other in answers[-1]["other_configs"]:
                answers.append(self.get(f"{path}&config={other['config']}"))
        return answers

    def import_elsewhere(self):
        """Goes on with a new data folder."""
        file, other = self.folder / "all.json", self.folder / "other"
        self.cli("store", "export", file)
        done = self.daemon.run_verb("store", "import", file, "--data", other, timeout_s=60, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.stop(signal.SIGTERM)
        self.daemon.data = other
        self.start()

    def tried(self, *words):
        """What a verb prints, or None if it was refused."""
        done = self.cli(*words, check=False)
        self.assertIn(done.returncode, (0, 2), (words, done.stderr))
        return done.stdout if done.returncode == 0 else None

    # --- acts; each may be refused ---

    def enter(self):
        skill = Skill(self.dice.randint(0, 6), self.dice.randint(0, 6), self.dice.choice([10, 2000]),
                      self.dice.randint(1, 3))
        where = {"phase": self.dice.choice(self.boards)[1]} if len(self.boards) > 1 else {}
        status, answer = self.try_submit(self.dice.choice([skill.mode] * 5 + ["crash"]),
                                         self.dice.choice(self.teams), **where)
        self.assertIn(status, (200, 201, 403, 409), answer)
        if status < 400:
            self.ended(answer["submission"])
            self.submissions.append(answer["submission"])

    def mark(self):
        if self.submissions:
            verb = self.dice.choice(["hide", "unhide", "disqualify", "reinstate", "baseline"])
            self.tried("submission", verb, self.dice.choice(self.submissions), "--reason", "a test")

    def rename(self):
        place = self.dice.randrange(len(self.teams))
        name = self.teams[place] + "x"
        if self.tried("team", "rename", self.teams[place], name, "--reason", "a test") is not None:
            self.teams[place] = name

    def merge(self):
        team, into = self.dice.sample(self.teams, 2)
        if self.dice.random() < 0.3:
            self.tried("team", "merge", team, "--into", into, "--reason", "a test", "--yes")

    def ban(self):
        self.tried("team", self.dice.choice(["ban", "unban"]), self.dice.choice(self.teams), "--reason",
                   "a test")

    def choose(self):
        if self.submissions:
            self.tried("choose", self.dice.choice(self.submissions))

    def rejudge(self):
        rules = self.scoring(force_limit_n=self.dice.choice([100, 1500, 5000]))
        made = self.tried("board", "rejudge", "create", *self.dice.choice(self.boards), "--config", rules,
                          "--reason", "a test", "--wait", "--json")
        if made is not None and self.dice.random() < 0.8:
            self.tried("board", "rejudge", "apply", json.loads(made)["rejudge"], "--reason", "a test")

    def drop(self):
        self.tried("board", "rejudge", "drop", self.dice.randint(1, 3), "--reason", "a test")

    def publish(self):
        self.tried("phase", "publish", "--phase", "final", "--reason", "a test")


for history in range(HISTORIES):
    setattr(Histories, f"test_{history}", lambda self, number=history: self.history(number))

if __name__ == "__main__":
    unittest.main()
