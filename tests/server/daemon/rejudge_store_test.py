"""A change of rules on a store of 300 submissions: from facts in seconds, with every rank as this test
computes it. The store is filled by copying the rows of graded submissions, under new teams and
numbers. MYOGRADE_TEST_EPISODES is the number of episodes of each; by default few, for sanitizers."""

import os
import signal
import sqlite3
import time
import unittest

from phases_test import TRACK
from rejudge_case import RejudgeCase, Skill, expected_order
from support.store_copies import copy_submission

EPISODES = int(os.environ.get("MYOGRADE_TEST_EPISODES", "20"))
PATTERNS = 30  # submissions that are played
COPIES = 10    # of each, with itself
LOW_FORCE = 500
SECONDS = 240  # under sanitizers on a busy host
OLD_RULES = {"line": 90, "factor": 1.1}
NEW_RULES = {"line": 70, "factor": 1.3, "limit": LOW_FORCE}


def pattern(number):
    return Skill(placed=EPISODES * (40 + 2 * number) // 100, force=900 if number % 3 == 1 else 10,
                 effort=1 + number * 7 % 11)


class LargeStore(RejudgeCase):
    def setUp(self):
        super().setUp()
        self.stop(signal.SIGTERM)
        self.daemon.change_config("tracks/demo-manipulation.json", episodes_per_lease=EPISODES,
                                  seeds={"first": 0, "count": EPISODES},
                                  practice_seeds={"first": 1000, "count": 6})
        self.start()
        self.entries = []
        for number in range(PATTERNS):
            self.submit(pattern(number).mode, f"Team {number + 1}")
        for number in range(PATTERNS):
            self.assertEqual(self.ended(number + 1)["state"], "done")
        self.stop(signal.SIGTERM)
        with sqlite3.connect(self.data / "store.db") as database:
            database.execute("PRAGMA synchronous = OFF")
            for number in range(PATTERNS, PATTERNS * COPIES):
                copy_submission(database, number % PATTERNS + 1, number + 1, number + 1)
        database.close()
        self.start()
        self.entries = [(f"Team {number + 1}", pattern(number % PATTERNS))
                        for number in range(PATTERNS * COPIES)]

    def expected(self, rules):
        return expected_order(self.entries, EPISODES, **rules)

    def ranks_of(self, rules):
        return {team: rank for rank, team in enumerate(self.expected(rules), 1)}

    def test_new_rules_from_facts(self):
        live = self.text(self.board_path)
        self.assertEqual(self.order(), self.expected(OLD_RULES))
        receipts = {number: self.text(f"/v1/submissions/{number}/receipt")
                    for number in (1, 31, 300)}
        file = self.scoring(force_limit_n=LOW_FORCE, boards={"main": {
            "line_successes": NEW_RULES["line"], "band_factor": NEW_RULES["factor"]}})
        begin = time.monotonic()
        number = self.create(file, wait=False)["rejudge"]
        self.computed(number)
        seconds = time.monotonic() - begin
        rejudge = self.show(number)
        print(f"{len(self.entries)} submissions of {EPISODES} episodes: {seconds:.1f} s")
        self.assertLess(seconds, SECONDS)
        self.assertEqual(rejudge["items"], {"total": 300, "ended": 300, "facts": 300, "play": 0})
        self.assertEqual(self.text(self.board_path), live)
        old, new = self.ranks_of(OLD_RULES), self.ranks_of(NEW_RULES)
        self.assertEqual(self.ranks(number),
                         {team: (old[team], new[team]) for team in old})
        self.assertEqual(rejudge["boards"][0]["moved"],
                         sum(old[team] != new[team] for team in old))
        applied = self.act("apply", rejudge["rejudge"])
        self.check_signatures(applied)
        self.assertEqual(len(applied["events"][-1]["document"]["results"]), 300)
        self.assertEqual(self.order(), self.expected(NEW_RULES))
        for number, receipt in receipts.items():
            self.assertEqual(self.text(f"/v1/submissions/{number}/receipt"), receipt,
                             "a receipt is of what was accepted")
        self.act("drop", rejudge["rejudge"])
        self.assertEqual(self.order(), self.expected(OLD_RULES))
        self.act("apply", rejudge["rejudge"])
        self.restart()
        self.assertEqual(self.order(), self.expected(NEW_RULES))


if __name__ == "__main__":
    unittest.main(verbosity=2)
