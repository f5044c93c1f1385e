"""schemathesis asks the daemon, as each role, what its OpenAPI document promises: with requests that
the document allows, where the answers must be those it describes, and with requests that it does not
allow, which must be refused. --full asks for longer."""

import json
import os
import pathlib
import subprocess
import sys
import unittest

from world import ROLES, TRACK, World

SCHEMATHESIS = pathlib.Path(os.environ["MYOGRADE_TEST_SCHEMATHESIS"])
FULL = "--full" in sys.argv
SECONDS = 60 if FULL else 7  # of one role, with good or with bad requests
EXAMPLES = 200 if FULL else 8
SEED = 18
DEADLINE_S = 10 * SECONDS + 120


def narrowed(document, world):
    """The document, with names and numbers of what this daemon has: a made-up one is 404 and shows
    nothing of an answer."""
    schemas = document["components"]["schemas"]
    track = next(one for one in world.get("/v1/tracks")["tracks"] if one["track"] == TRACK)
    schemas["TrackName"] = {"enum": [TRACK]}
    schemas["ProfileName"] = {"enum": [profile["profile"] for profile in track["profiles"]]}
    schemas["BoardName"] = {"enum": track["boards"]}
    schemas["TeamName"] = {"enum": ["alpha", "beta"]}
    schemas["Reason"] = {"enum": ["because"]}
    schemas["Id"] = {"enum": world.submissions}
    schemas["NewSubmission"]["properties"]["artefact"] = {"enum": [world.upload("alpha")]}
    return document


class Schemathesis(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.world = World()
        cls.addClassCleanup(cls.world.close)
        cls.world.start()

    def identity(self, role):
        if role == "public":
            return []
        return ["--header", f"Authorization: Bearer {self.world.tokens[role]}"]

    def check(self, role, mode):
        document = self.world.get("/v1/openapi.json")
        if mode == "positive":
            document = narrowed(document, self.world)
        file = self.world.root / f"{role}-{mode}.json"
        file.write_text(json.dumps(document))
        config = self.world.root / "schemathesis.toml"
        config.write_text("")
        done = subprocess.run(
            [SCHEMATHESIS, "--config-file", config, "--no-color", "run", file,
             "--url", self.world.url, "--mode", mode, "--phases", "examples,coverage,fuzzing",
             "--max-examples", str(EXAMPLES), "--max-time", str(SECONDS), "--seed", str(SEED),
             *self.identity(role),
             "--suppress-health-check", "all", "--warnings", "off", "--continue-on-failure",
             "--report", "ndjson", "--report-ndjson-path", self.world.root / "report.ndjson"],
            capture_output=True, text=True, cwd=self.world.root, timeout=DEADLINE_S)
        self.assertEqual(done.returncode, 0, f"{role}, {mode}:\n{done.stdout}\n{done.stderr}")
        self.assertTrue(self.world.running, self.world.state())


def add_tests():
    for role in ("public", *ROLES):
        for mode in ("positive", "negative"):
            def test(self, role=role, mode=mode):
                self.check(role, mode)
            setattr(Schemathesis, f"test_{role}_{mode}", test)


add_tests()
if __name__ == "__main__":
    unittest.main(argv=[arg for arg in sys.argv if arg != "--full"], verbosity=2)
