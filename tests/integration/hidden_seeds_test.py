"""A phase with hidden seeds on the real simulator: what was played can be simulated again from the
receipt and the logs once the seeds are revealed, and not before."""

import json
import unittest

from system import POLICIES, SystemTest, track_config

COUNT = 2


class HiddenSeeds(SystemTest):
    tracks = {"short": track_config("locomotion")}

    def hold(self, closes_at):
        folder = self.daemon.configs / "challenges"
        folder.mkdir(exist_ok=True)
        (folder / "cup.json").write_text(json.dumps({
            "form": 1, "title": "Cup", "phases": [
                {"name": "final", "title": "Final", "track": "short", "profile": "paper",
                 "seeds": {"committed": COUNT}, "opens_at": "2020-01-01T00:00:00Z",
                 "closes_at": closes_at, "show": {"logs": False}}]}))
        self.start_daemon()

    def test_a_receipt_is_simulated_again_after_the_reveal(self):
        self.hold("2200-01-01T00:00:00Z")
        self.ask("team", "create", "alpha")
        submission = self.ask("submit", POLICIES / "zero", "--track", "short", "--phase", "final",
                              "--team", "alpha", "--wait")["submission"]
        key, receipt = self.root / "key.pem", self.root / "receipt.json"
        self.run_cli("proof", "key", "-o", key)
        self.run_cli("proof", "receipt", submission, "-o", receipt)
        before = self.ask("verify", receipt, "--key", key)
        self.assertEqual([check["name"] for check in before["checks"]],
                         ["signature", "merkle_root", "results", "record", "hidden"])
        early = self.run_cli("verify", receipt, "--key", key, "--resimulate", 1, check=False)
        self.assertEqual(early.returncode, 2, early.stderr)
        again = self.ask("rerun", submission)
        self.assertEqual((again["comparison"]["compared"], again["comparison"]["equal"]),
                         (COUNT, COUNT))
        self.stop_daemon()
        self.hold("2021-01-01T00:00:00Z")
        seeds = self.ask("phase", "seeds", "reveal", "--phase", "final")["seeds"]
        self.assertEqual(len(set(seeds)), COUNT)
        after = self.ask("verify", receipt, "--key", key, "--resimulate", COUNT)
        self.assertTrue(after["valid"], after)
        self.assertEqual([entry["equal"] for entry in after["resimulated"]], [True] * COUNT)
        # Whoever knows the seeds can play the phase at home: the same starts, another luck.
        listed = self.root / "seeds.json"
        listed.write_text(json.dumps(seeds))
        local = self.ask("local", POLICIES / "zero", "--track", "short", "--seeds", listed)
        rows = self.ask("show", submission, "--episodes")["episode_rows"]
        self.assertEqual([row["digest"] for row in local["episodes"]],
                         [row["digest"] for row in rows], "this policy draws nothing")


if __name__ == "__main__":
    unittest.main(verbosity=2)
