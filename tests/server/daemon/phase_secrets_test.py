"""The secrets of phases with hidden seeds: drawn once, one challenge's, brought along by hand, and
never used again once revealed."""

import json
import signal
import sqlite3
import unittest

from phases_test import PhasesCase, moment, seeds


class Secrets(PhasesCase):
    phases = {"final": {"seeds": {"committed": 6}, "closes_at": moment(hours=1)}}

    def test_a_secret_is_drawn_once_and_only_its_commitment_is_told(self):
        told = self.phase("final")["seeds"]
        self.assertEqual((told["kind"], told["count"], told["secret"]), ("committed", 6, None))
        submission = self.played("ok")
        self.hold(**self.phases)
        self.assertEqual(self.phase("final")["seeds"], told)
        self.assertEqual(self.submissions_on(self.board_of("final")), [submission])
        text = self.cli("phase", "status").stdout
        self.assertIn(told["commitment"], text.replace("\n", ""))

    def test_a_damaged_secret_stops_its_phase_and_nothing_else(self):
        submission = self.played("ok")
        phases = {**self.phases, "other": {"seeds": seeds(3000)}}
        self.hold(**phases)
        board = self.board_of("final")
        self.stop(signal.SIGTERM)
        with sqlite3.connect(self.data / "store.db") as db:
            db.executescript("DROP TRIGGER phase_secret_fixed; PRAGMA ignore_check_constraints = 1;"
                             "UPDATE phase_secret SET secret = x'00'")
        self.start()
        self.refused("damaged_row", "phase_secret final", phase="final", status=500)
        self.assertEqual(self.try_submit("ok", phase="other")[0], 201)
        self.assertEqual(self.board_of("final"), board)
        self.assertEqual(self.submissions_on(board), [submission])
        self.assertEqual([p["phase"] for p in self.challenges()["unusable"]], ["final"])


    def check(self, *words):
        """Exit status and mistakes of `challenge check`, which looks at the store too."""
        done = self.daemon.run_verb("phase", "check", *words, "--configs", self.configs, "--data",
                                    self.data, "--json", timeout_s=60, text=True)
        return done.returncode, json.loads(done.stdout)["mistakes"]

    def test_a_revealed_phase_never_opens_again(self):
        submission = self.played("ok")
        self.hold(final={**self.phases["final"], "closes_at": moment()})
        self.assertEqual(self.check(), (0, []))
        self.ask("phase", "seeds", "reveal", "--phase", "final", "--count", 6)
        self.assertEqual(self.check(), (0, []))
        self.hold(**self.phases)
        self.refused("phase_revealed", "were revealed", phase="final", team="beta")
        self.assertEqual(self.phase("final")["state"], "closed")
        self.assertIn("its times would keep it open", self.daemon.log())
        status, mistakes = self.check()
        self.assertEqual((status, len(mistakes)), (2, 1), mistakes)
        self.assertIn('phase "final": its seeds were revealed', mistakes[0])
        self.assertEqual(self.submissions_on(self.board_of("final")), [submission])
        # Next year's challenge with a phase of the same name.
        file = self.configs / "challenges/cup.json"
        file.rename(file.with_name("next-cup.json"))
        status, mistakes = self.check()
        self.assertEqual((status, len(mistakes)), (2, 1), mistakes)
        self.stop(signal.SIGTERM)
        self.start()
        self.refused("phase_revealed", "were revealed", phase="final", team="beta")
        file.with_name("next-cup.json").rename(file)

    def test_a_secret_belongs_to_one_challenge(self):
        file = self.configs / "challenges/cup.json"
        file.rename(file.with_name("next-cup.json"))
        self.stop(signal.SIGTERM)
        self.start()
        self.refused("no_secret", 'belongs to challenge "cup"', phase="final", team="beta")
        self.assertIn('belongs to challenge "cup"', self.check()[1][0])
        file.with_name("next-cup.json").rename(file)
        self.hold(**self.phases)
        self.assertEqual(self.try_submit("ok", phase="final")[0], 201)

    def test_an_imported_phase_waits_for_its_secret(self):
        submission = self.played("ok")
        told = self.phase("final")["seeds"]["commitment"]
        here = self.folder / "here.secret"
        moved = self.daemon.run_verb("phase", "seeds", "export", "--phase", "final", "-o", here, "--data",
                                     self.data, "--json", timeout_s=60, text=True)
        self.assertEqual(moved.returncode, 0, moved.stderr)
        self.assertEqual(json.loads(moved.stdout)["commitment"], told)
        self.assertEqual(here.stat().st_mode & 0o777, 0o600)
        self.cli("store", "export", self.folder / "all.json")
        self.stop(signal.SIGTERM)
        old = self.data.rename(self.folder / "old")
        verb = self.daemon.run_verb("store", "import", self.folder / "all.json", "--data", self.data,
                                    timeout_s=60, text=True)
        self.assertEqual(verb.returncode, 0, verb.stderr)
        self.assertIn("not its secret", self.check()[1][0])
        self.start()
        self.refused("no_secret", "myograde phase seeds import", phase="final", team="beta")
        self.assertIn("not its secret", self.daemon.log())
        self.assertEqual([p["phase"] for p in self.challenges()["unusable"]], ["final"])
        self.stop(signal.SIGTERM)
        wrong = self.folder / "wrong.secret"
        wrong.write_text("0" * 64 + "\n")

        def bring(file, phase="final"):
            return self.daemon.run_verb("phase", "seeds", "import", "--phase", phase, "--secret", file, "--data",
                                        self.data, "--json", timeout_s=60, text=True)

        for refused, words in ((bring(wrong), "is not the secret"),
                               (bring(here, "other"), "no commitment for phase")):
            self.assertEqual(refused.returncode, 2, refused)
            self.assertIn(words, refused.stderr)
        self.assertEqual([json.loads(bring(here).stdout)["changed"] for _ in range(2)], [True, False])
        self.start()
        self.assertEqual(self.check(), (0, []))
        self.assertEqual(self.phase("final")["seeds"]["commitment"], told)
        self.assertEqual(self.submissions_on(self.board_of("final")), [submission])
        entries = self.get("/v1/record?limit=1000")["entries"]
        self.assertEqual(sum(row["entry"]["kind"] == "commitment" for row in entries), 1)
        self.assertTrue(old.exists())


if __name__ == "__main__":
    unittest.main(verbosity=2)
