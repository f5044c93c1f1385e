"""schemathesis asks the daemon, as each role, what its OpenAPI document promises: with requests that
the document allows, where the answers must be those it describes, and with requests that it does not
allow, which must be refused. --full asks for longer."""

import json
import os
import pathlib
import subprocess
import sys
import unittest

from world import CHALLENGE, PROFILE, ROLES, TRACK, World

SCHEMATHESIS = pathlib.Path(os.environ["MYOGRADE_TEST_SCHEMATHESIS"])
FULL = "--full" in sys.argv
SECONDS = 60 if FULL else 5  # of one role, with good or with bad requests
EXAMPLES = 200 if FULL else 8
SEED = 18
# Between its bad requests schemathesis makes good ones, with names that nothing has.
CHECKS = {"positive": [], "negative": ["--exclude-checks", "positive_data_acceptance"]}
DEADLINE_S = 10 * SECONDS + 120


# A GET or DELETE that has a body is refused by its head; http_test.py asks without one. Archives and
# exports can't be made up, schemathesis takes phases from answers, where they may be null, and a key
# that came with another request before is refused. A stream of events ends with its reader alone
# (tests/server/web reads it).
CONFIG = """
[phases.coverage]
unexpected-methods = ["PUT", "POST", "OPTIONS", "PATCH", "TRACE", "QUERY"]
[checks.positive_data_acceptance]
expected-statuses = ["2xx", "3xx", "401", "403", "404", "409", "422", "429", "503"]
[[operations]]
include-operation-id = ["upload", "importStore", "pausePhase", "resumePhase", "publishPhase",
                        "revealPhase", "proveRecordEntry", "proveRecordConsistency", "createRejudge",
                        "applyRejudge", "playMoreSeeds"]
checks.positive_data_acceptance.enabled = false
[[operations]]
include-operation-id = ["followQueue"]
enabled = false
"""


def loosened(value, names):
    """A schema of answers without references to those of requests."""
    if isinstance(value, list):
        return [loosened(entry, names) for entry in value]
    if not isinstance(value, dict):
        return value
    if str(value.get("$ref")).rpartition("/")[2] in names:
        return {"type": ["string", "integer"]}
    return {key: loosened(entry, names) for key, entry in value.items()}


def narrowed(document, world):
    """The document, with requests for what this daemon has: what is made up is 404 and shows nothing
    of an answer."""
    known = {"TrackName": [TRACK], "ProfileName": [PROFILE], "PhaseName": ["final", "past"],
             "BoardName": ["main"], "TeamName": ["alpha", "beta"], "Reason": ["because"],
             "Id": world.submissions}
    schemas = document["components"]["schemas"]
    for name, schema in schemas.items():
        if not name.startswith("New"):
            schemas[name] = loosened(schema, known)
    schemas.update({name: {"enum": values} for name, values in known.items()})
    submission = schemas["NewSubmission"]["properties"]
    submission["artefact"] = {"enum": [world.upload("alpha"), world.upload("beta")]}
    # JSON Schema takes 3.0 for an integer, the daemon does not.
    submission["seeds"].update(maxItems=3, items={"enum": [10**9, 10**9 + 1, 2**63 - 1]})
    submission["episodes"] = {"enum": [1]}
    for name in ("NewSubmission", "NewRerun"):
        schemas[name].pop("examples")
    schemas["NewRerun"]["properties"] = {"first": {"enum": [0]}, "last": {"enum": [1]}}
    token = schemas["NewToken"]["properties"]
    token.update(label={"enum": ["one of many"]}, valid_days={"enum": [1, 3650]})
    schemas["NewGrant"]["properties"]["amount"] = {"enum": [1, 10**6]}
    token.pop("expires_at")
    parameters = document["components"]["parameters"]
    parameters["Track"]["required"] = True
    # A config is of one track or phase, and none of it could be of several that are asked for at once.
    parameters["Config"]["schema"] = {"enum": ["0" * 64]}
    parameters["At"]["schema"] = {"enum": ["2026-01-01T00:00:00Z"]}
    member = document["paths"]["/v1/teams/{name}/members"]["post"]["requestBody"]["content"]
    member["application/json"]["schema"]["properties"]["person"] = {"enum": ["uid 61001"]}
    phase_act = document["components"]["requestBodies"]["Reason"]["content"]["application/json"]
    phase_act["schema"]["properties"]["reason"] = {"enum": ["because"]}
    # Branches of a oneOf are drawn one by one: what binds all of them is said in each.
    node_act = schemas["NodeAct"]
    for properties in (node_act["properties"], node_act["oneOf"][0]["properties"]):
        properties["reason"] = {"enum": ["because"]}
    return document


class Schemathesis(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.world = World(CHALLENGE)
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
        config.write_text(CONFIG)
        # How far it gets in its time depends on the host's load, and so do timeouts of its requests: a
        # mistake of the daemon's is one that is found again.
        done = self.run_once(role, mode, file, config)
        if done.returncode != 0:
            print(f"{role}, {mode}, once more:\n{done.stdout}\n{done.stderr}", file=sys.stderr)
            done = self.run_once(role, mode, file, config)
        self.assertEqual(done.returncode, 0, f"{role}, {mode}:\n{done.stdout}\n{done.stderr}")
        self.assertTrue(self.world.running, self.world.state())

    def run_once(self, role, mode, file, config):
        return subprocess.run(
            [SCHEMATHESIS, "--config-file", config, "--no-color", "run", file,
             "--url", self.world.url, "--mode", mode, "--phases", "examples,coverage,fuzzing",
             "--max-examples", str(EXAMPLES), "--max-time", str(SECONDS), "--seed", str(SEED),
             *self.identity(role), *CHECKS[mode],
             "--suppress-health-check", "all", "--warnings", "off", "--continue-on-failure",
             "--report", "ndjson", "--report-ndjson-path", self.world.root / "report.ndjson"],
            capture_output=True, text=True, cwd=self.world.root, timeout=DEADLINE_S)


def add_tests():
    for role in ("public", *ROLES):
        for mode in ("positive", "negative"):
            def test(self, role=role, mode=mode):
                self.check(role, mode)
            setattr(Schemathesis, f"test_{role}_{mode}", test)


add_tests()
if __name__ == "__main__":
    unittest.main(argv=[arg for arg in sys.argv if arg != "--full"], verbosity=2)
