"""A change of rules on a store of 300 submissions of 100 episodes: from facts in seconds, with every
rank as this test computes it. The store is filled by copying the rows of graded submissions, under
new teams and numbers."""

import signal
import sqlite3
import time
import unittest

from phases_test import TRACK
from rejudge_case import RejudgeCase, Skill, expected_order

EPISODES = 100
PATTERNS = 30  # submissions that are played
COPIES = 10    # of each, with itself
LOW_FORCE = 500
# Under sanitizers on a busy host; tests/bench has the figures of the program as it is installed.
SECONDS = 120
OLD_RULES = {"line": 90, "factor": 1.1}
NEW_RULES = {"line": 70, "factor": 1.3, "limit": LOW_FORCE}


def pattern(number):
    return Skill(placed=40 + 2 * number, force=900 if number % 3 == 1 else 10,
                 effort=1 + number * 7 % 11)


def copy_rows(database, table, where, changes):
    """Inserts the rows of `where` again, columns replaced by SQL expressions."""
    names = [row[1] for row in database.execute(f"PRAGMA table_info({table})")]
    values = ", ".join(changes.get(name, name) for name in names)
    database.execute(
        f"INSERT INTO {table} ({', '.join(names)}) SELECT {values} FROM {table} WHERE {where}")


def copy_submission(database, source, number):
    """Makes submission `number` of a team of its own, which is graded as `source` is."""
    artefact = f"{number:064x}"
    apart = number * 1_000_000
    copy_rows(database, "team", f"id = (SELECT team_id FROM submission WHERE id = {source})",
              {"id": str(number), "name": f"'Team {number}'"})
    copy_rows(database, "artefact",
              f"hash = (SELECT artefact FROM submission WHERE id = {source})",
              {"hash": f"'{artefact}'"})
    copy_rows(database, "submission", f"id = {source}",
              {"id": str(number), "team_id": str(number), "artefact": f"'{artefact}'"})
    copy_rows(database, "evaluation", f"id = {source}",
              {"id": str(number), "submission": str(number)})
    copy_rows(database, "standing", f"evaluation = {source}", {"evaluation": str(number)})
    copy_rows(database, "lease", f"evaluation = {source}",
              {"id": f"id + {apart}", "evaluation": str(number)})
    copy_rows(database, "episode", f"evaluation = {source}",
              {"evaluation": str(number), "lease": f"lease + {apart}"})


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
                copy_submission(database, number % PATTERNS + 1, number + 1)
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
        rejudge = self.create(file)
        seconds = time.monotonic() - begin
        print(f"{len(self.entries)} submissions of {EPISODES} episodes: {seconds:.1f} s")
        self.assertLess(seconds, SECONDS)
        self.assertEqual(rejudge["items"], {"total": 300, "ended": 300, "facts": 300, "play": 0})
        self.assertEqual(self.text(self.board_path), live)
        old, new = self.ranks_of(OLD_RULES), self.ranks_of(NEW_RULES)
        self.assertEqual(self.ranks(rejudge["rejudge"]),
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
