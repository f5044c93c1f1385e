"""The seeds of policies' own randomness: the same for every team, in every data folder and in
`local`. The runners play without physics, and their
digests are of the episode's seed and its policy seed."""

import hashlib
import hmac
import json
import shutil
import signal
import unittest

from organiser_test import OrganiserCase, TRACK
from support.submission import played_by_stand_in


def seed_of(key, message):
    digest = hmac.new(key, message.encode(), hashlib.sha256).digest()
    return int.from_bytes(digest[-8:], "big") & (2**63 - 1)


def digests_of(policy_seeds, first=0):
    return [hashlib.sha256(f"{seed}/{policy_seed}".encode()).hexdigest()
            for seed, policy_seed in enumerate(policy_seeds, first)]


class PolicySeeds(OrganiserCase):
    def digests(self, submission):
        return [row["digest"] for row in self.result(submission)["episode_rows"]]

    def expected(self):
        secret = json.loads((self.configs / "tracks/manipulation.json").read_text())
        return [seed_of(secret["policy_seed_secret"].encode(), f"myograde policy seed/{index}")
                for index in range(6)]

    def elsewhere(self):
        """Restarts the daemon in another, empty data folder."""
        self.stop(signal.SIGTERM)
        self.daemon.data = f"{self.data}-2"
        self.start()

    def local(self, *words):
        policy = self.folder / "local"
        policy.mkdir(exist_ok=True)
        (policy / "policy").write_text("#!/bin/sh\n")
        (policy / "policy").chmod(0o755)
        (policy / "policy.json").write_text(
            json.dumps({"name": "l", "command": ["./policy", "ok"]}))
        return self.daemon.ask("local", policy, "--track", TRACK, *words)

    def upload_named(self, name):
        status, body = self.call("POST", "/v1/artefacts", played_by_stand_in("ok", name))
        self.assertEqual(status, 201, body)
        return body["artefact"]

    def test_all_teams_play_the_same_luck_everywhere(self):
        expected = digests_of(self.expected())
        first = self.played("ok")
        self.assertEqual(self.digests(first), expected)
        padded = self.played("ok", team="beta", artefact=self.upload_named("padding"))
        self.assertEqual(self.digests(padded), expected)
        # Practice: other seeds of the episodes, and the same luck.
        self.assertEqual(self.digests(self.played("ok", episodes=4)),
                         digests_of(self.expected()[:4], first=100))
        local = self.local()
        self.assertEqual([row["digest"] for row in local["episodes"]], expected)
        root = self.result(first)["merkle_root"]
        self.assertEqual(local["merkle_root"], root)
        self.assertEqual([row["digest"] for row in self.local("--episodes=3")["episodes"]],
                         expected[:3])
        self.elsewhere()
        self.assertEqual(self.result(self.played("ok"))["merkle_root"], root)

    def test_an_imported_submission_is_played_the_same_again(self):
        submission = self.played("ok")
        self.cli("store", "export", self.folder / "export.json")
        artefacts = self.data / "artefacts"
        self.elsewhere()
        self.cli("store", "import", self.folder / "export.json")
        shutil.copytree(artefacts, self.data / "artefacts", dirs_exist_ok=True)
        again = self.ask("rerun", submission)
        self.assertEqual((again["comparison"]["compared"], again["comparison"]["equal"]), (6, 6))

    def test_receipts_list_them(self):
        self.played("ok")
        told = self.get("/v1/submissions/1/receipt")["receipt"]
        self.assertEqual(told["policy_seeds"], self.expected())
        self.assertEqual(told["track_config"]["policy_seed_secret"],
                         "MyoGrade's public policy seeds")
        key, receipt = self.folder / "key.pem", self.folder / "receipt.json"
        self.cli("proof", "key", "-o", key)
        self.cli("proof", "receipt", 1, "-o", receipt)
        verified = self.ask("verify", receipt, "--key", key, schema="verify")
        self.assertIn("policy_seeds", [check["name"] for check in verified["checks"]])


if __name__ == "__main__":
    unittest.main(verbosity=2)
