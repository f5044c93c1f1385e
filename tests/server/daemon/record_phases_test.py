"""The public record of phases with hidden seeds: what a copy has before and after the reveal, and what
is found of seeds that were not those committed to."""

import shutil
import signal
import unittest

from record_test import RecordCase
from secrets_test import SecretsCase


class HiddenPhases(RecordCase, SecretsCase):
    def test_what_a_phase_withholds_is_withheld_until_the_reveal(self):
        self.hold()
        self.organise("alpha", "beta")
        submission = self.enter("ok")
        self.enter("crash", "beta")
        seeds, secret, texts = self.hidden()
        status, text = self.as_team("alpha", "GET", "/v1/record?limit=1000")
        self.assertEqual(status, 200)
        for hidden in texts:
            self.assertNotIn(hidden.encode(), text)
        for word in (b'"score', b"success", b'"failed"', b'"done"'):
            self.assertNotIn(word, text)
        hidden_phase = {"aggregate": True, "outcomes": False, "metrics": False, "logs": False,
                        "output": False}
        self.hold(show=hidden_phase)
        folder = self.exported("closed")
        self.assertEqual((self.said["receipts"], self.said["withheld"]), (0, 2))
        self.incomplete(folder, "is withheld: phase")
        self.hold(closes_in_hours=-1, show=hidden_phase)
        self.cli("phase", "seeds", "reveal", "--phase", "final", "--reason", "it is over")
        folder = self.exported("open")
        self.assertEqual((self.said["receipts"], self.said["withheld"]), (2, 0))
        self.assertEqual((folder / "secrets/final.txt").read_text(), secret.hex() + "\n")
        self.holds(folder)
        copy = self.altered(folder)
        (copy / "secrets/final.txt").write_text("0" * 64 + "\n")
        self.refuted(copy, "secrets", "is not the secret revealed in the record")
        self.assertEqual(self.call("GET", f"/v1/submissions/{submission}/receipt?public=true")[0], 200)

    def test_a_phase_that_plays_other_seeds_than_it_committed_to_is_told(self):
        self.hold()
        self.get("/v1/challenges")
        self.hold(seeds={"first": 7000, "count": 6})
        self.organise("alpha")
        self.enter("ok")
        self.incomplete(self.exported(), "phase final had committed to hidden seeds, and submission 1")
        done = self.daemon.run_verb("phase", "check", "--configs", self.configs, "--data", self.data,
                                    timeout_s=60, text=True)
        self.assertEqual(done.returncode, 2, done)
        self.assertIn("has committed to hidden seeds", done.stdout + done.stderr)

    def test_a_phase_whose_secret_was_left_behind_is_not_checked_nor_accused(self):
        self.hold()
        self.organise("alpha")
        self.enter("ok")
        other = self.folder / "other"
        self.cli("store", "export", self.folder / "all.json")
        self.cli("store", "import", self.folder / "all.json", data=other)
        self.stop(signal.SIGTERM)
        for path in self.data.glob("store.db*"):
            path.unlink()
        shutil.copy(other / "store.db", self.data / "store.db")
        self.start()
        folder = self.exported()
        self.assertEqual((self.said["receipts"], self.said["withheld"]), (1, 0))
        self.incomplete(folder, "the server did not have the secret of phase final")
        copy = self.altered(folder)
        (copy / "receipts/1.json").unlink()
        self.refuted(copy, "receipts", "neither a receipt nor a line in withheld.json")

    def test_seeds_that_were_committed_to_late_are_found(self):
        self.hold()
        self.organise("alpha")
        self.enter("ok")
        self.incomplete(self.exported("good"), "the seeds of phase final are not revealed")

        def later(rows):
            commitment = next(row for row in rows if row[1] == "commitment")
            rows.remove(commitment)
            place = next(i for i, row in enumerate(rows) if row[1] == "accepted")
            return rows[:place + 1] + [commitment] + rows[place + 1:]

        self.rewritten(later)
        self.refuted(self.exported("late"), "commitments", "after submission 1 to it was accepted")

        def twice(rows):
            commitment = next(row for row in rows if row[1] == "commitment")
            other = (*commitment[:3], {**commitment[3], "commitment": "0" * 64})
            return rows + [other]

        self.rewritten(twice)
        self.refuted(self.exported("twice"), "entries", "commits phase final to another secret")

        def never(rows):
            return [row for row in rows if row[1] != "commitment"]

        self.rewritten(never)
        self.refuted(self.exported("never"), "receipts", "the record never committed to them")


if __name__ == "__main__":
    unittest.main()
