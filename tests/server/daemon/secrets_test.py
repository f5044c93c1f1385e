"""A phase with hidden seeds, as its participants see it: no answer has a seed, or anything that one
follows from, before the reveal, and afterwards everything can be checked. The runners play
without physics; their digests are of the episode's seed and its policy seed."""

import datetime
import hashlib
import hmac
import json
import re
import signal
import sqlite3
import unittest

from organiser_test import OrganiserCase, TRACK
from support import client
from support.submission import played_by_stand_in

COUNT = 6
SEEDS_SHOWN = {"aggregate": True, "outcomes": True, "metrics": True, "logs": False, "output": True}
LITTLE = {"aggregate": True, "outcomes": False, "metrics": False, "logs": False, "output": False}


def moment(hours):
    """So many hours from now, as challenge files write it."""
    at = datetime.datetime.now(datetime.timezone.utc) + datetime.timedelta(hours=hours)
    return at.strftime("%Y-%m-%dT%H:%M:%SZ")


def forms_of(number):
    """How a seed may be written."""
    return [str(number), f"{number:x}", f"{number:016x}"]


class SecretsCase(OrganiserCase):
    def hold(self, show=None, closes_in_hours=1, seeds=None):
        """Restarts the daemon with a challenge of one phase."""
        phase = {"name": "final", "title": "Final", "track": TRACK, "profile": "paper",
                 "seeds": seeds or {"committed": COUNT}, "opens_at": "2020-01-01T00:00:00Z",
                 "closes_at": moment(closes_in_hours), "show": show or SEEDS_SHOWN}
        folder = self.configs / "challenges"
        folder.mkdir(exist_ok=True)
        (folder / "cup.json").write_text(json.dumps(
            {"form": 1, "title": "Cup", "phases": [phase]}))
        self.stop(signal.SIGTERM)
        self.start()

    def organise(self, *teams):
        """Teams with a token each."""
        self.tokens = {}
        for team in teams:
            status, body = self.call("POST", "/v1/teams", {"team": team, "reason": "test"})
            self.assertEqual(status, 201, body)
            status, body = self.call("POST", "/v1/tokens", {
                "role": "participant", "team": team, "label": team})
            self.assertEqual(status, 201, body)
            self.tokens[team] = body["token"]

    def as_team(self, team, method, path, body=None, kind=None):
        """Status and bytes of an answer to a participant."""
        connection = client.Connection(self.daemon.socket_path)
        headers = {"Authorization": f"Bearer {self.tokens[team]}"}
        if isinstance(body, dict):
            body, kind = json.dumps(body), "application/json"
        if kind:
            headers["Content-Type"] = kind
        try:
            connection.request(method, path, body, headers)
            answer = connection.getresponse()
            if answer.headers["Content-Type"] != "text/event-stream":
                return answer.status, answer.read()
            return answer.status, b"".join(iter(answer.readline, b"\n"))  # the first event
        finally:
            connection.close()

    def shown(self, team, path):
        status, text = self.as_team(team, "GET", path)
        self.assertEqual(status, 200, text)
        return json.loads(text)

    def refused(self, team, method, path, body=None):
        """The code and sentence of a refusal."""
        status, text = self.as_team(team, method, path, body)
        self.assertGreaterEqual(status, 400, text)
        error = json.loads(text)["error"]
        return status, error["code"], error["message"]

    def enter(self, mode, team="alpha"):
        """A submission of the team itself to the phase, once it has ended."""
        status, body = self.as_team(team, "POST", "/v1/artefacts", played_by_stand_in(mode, team),
                                    "application/x-tar")
        self.assertIn(status, (200, 201), body)
        status, body = self.as_team(team, "POST", "/v1/submissions", {
            "artefact": json.loads(body)["artefact"], "team": team, "track": TRACK,
            "phase": "final"})
        self.assertEqual(status, 201, body)
        submission = json.loads(body)["submission"]
        self.ended(submission)
        return submission

    def hidden(self):
        """Everything that nobody may see: seeds, the phase's secret, and what follows from it."""
        with sqlite3.connect(f"file:{self.data}/store.db?mode=ro", uri=True) as store:
            secret = store.execute("SELECT secret FROM phase_secret").fetchone()[0]
            configs = [json.loads(row[0]) for row in store.execute("SELECT content_json FROM config")]
        store.close()
        config = next(config for config in configs if config.get("phase") == "final")
        seeds = config["seeds"]
        self.assertEqual(len(seeds), COUNT)
        texts = [secret.hex(), config["policy_seed_secret"], config["seed_salt"]]
        texts += [form for seed in seeds for form in forms_of(seed)]
        for index in range(COUNT):
            digest = hmac.new(config["policy_seed_secret"].encode(),
                              f"myograde policy seed/{index}".encode(), hashlib.sha256).digest()
            texts += forms_of(int.from_bytes(digest[-8:], "big") & (2**63 - 1))
        return seeds, secret, texts

    def addresses(self, submission):
        """Every address that can be read, about this submission and all that belongs to it."""
        whole = self.get(f"/v1/submissions/{submission}/result?episodes=1")
        status = self.get(f"/v1/submissions/{submission}")
        logs = [row["log"]["sha256"] for row in whole["episode_rows"] if row["log"]] or ["0" * 64]
        paths = []
        for address in self.get("/v1/addresses")["addresses"]:
            if address["method"] != "GET":
                continue
            path = address["path"]
            for name, values in (("ID", [evaluation["evaluation"]
                                         for evaluation in status["evaluations"]]
                                  if "/evaluations/" in path else [submission]),
                                 ("HASH", logs), ("NAME", ["alpha"])):
                if name in path:
                    paths += [path.replace(name, str(value)) for value in values]
                    break
            else:
                paths.append(path)
        queries = {"/v1/leaderboard": ["?phase=final", f"?track={TRACK}"],
                   "/v1/leaderboard/explain": ["?phase=final&a=alpha&b=beta"],
                   "/v1/leaderboard/badge": ["?phase=final&team=alpha", "?phase=final"],
                   "/v1/leaderboard/feed": ["?phase=final"],
                   "/v1/quota": ["?team=alpha"]}
        asked = []
        for path in paths:
            asked += [path + query for query in queries.get(path, [""])]
            if re.search(r"/result$|/evaluations/\d+$", path):
                asked.append(path + "?episodes=1")
        return asked

    def all_answers(self, team, submission):
        """Every answer that a participant can read, as bytes by path."""
        paths = self.addresses(submission)
        self.assertGreaterEqual(len(paths), 15, paths)
        return {path: self.as_team(team, "GET", path) for path in paths}


class Hidden(SecretsCase):
    def setUp(self):
        super().setUp()
        self.hold()
        self.organise("alpha", "beta")

    def test_no_answer_has_a_seed_before_the_reveal(self):
        submission = self.enter("ok")
        self.enter("crash", "beta")
        self.call("POST", f"/v1/submissions/{submission}/rerun", {})
        self.wait(f"/v1/submissions/{submission}",
                  lambda b: all(e["state"] == "done" for e in b["evaluations"]))
        seeds, _, texts = self.hidden()
        answers = self.all_answers("alpha", submission)
        for path, (_, text) in answers.items():
            for hidden in texts:
                self.assertNotIn(hidden.encode(), text, path)
        rows = self.shown("alpha", f"/v1/submissions/{submission}/result?episodes=1")["episode_rows"]
        self.assertEqual([row["seed"] for row in rows], [None] * COUNT)
        self.assertEqual(len({row["seed_commitment"] for row in rows}), COUNT)
        whole = self.result(submission)
        self.assertEqual([row["seed"] for row in whole["episode_rows"]], seeds,
                         "organisers see everything")
        self.assertEqual([row["seed_commitment"] for row in whole["episode_rows"]],
                         [row["seed_commitment"] for row in rows])
        self.assertEqual(self.shown("alpha", f"/v1/submissions/{submission}/result")["withheld"],
                         ["logs", "seeds"])
        text = self.cli("show", submission, "--episodes").stdout
        self.assertIn(str(seeds[0]), text)

    def test_a_reveal_opens_everything_after_the_close_and_not_before(self):
        submission = self.enter("ok")
        seeds, secret, _ = self.hidden()
        key, receipt = self.folder / "key.pem", self.folder / "receipt.json"
        receipt.write_bytes(self.as_team("alpha", "GET",
                                         f"/v1/submissions/{submission}/receipt")[1])
        self.cli("proof", "key", "-o", key)
        before = self.ask("verify", receipt, "--key", key, schema="verify")
        self.assertTrue(before["valid"])
        self.assertEqual([check["name"] for check in before["checks"]],
                         ["signature", "merkle_root", "results", "record", "hidden"])
        self.assertIn("can't be checked", before["checks"][-1]["detail"])
        refused = self.cli("verify", receipt, "--key", key, "--resimulate", 1, check=False)
        self.assertEqual((refused.returncode, "not revealed" in refused.stderr), (2, True),
                         refused.stderr)

        early = self.cli("phase", "seeds", "reveal", "--phase", "final", check=False)
        self.assertEqual(early.returncode, 2)
        self.assertIn("it closes at", early.stderr)
        self.assertEqual(self.refused("alpha", "POST", "/v1/phases/final/reveal",
                                      {"reason": "curious"})[:2], (403, "forbidden"))
        self.hold(closes_in_hours=-1)
        revealed = self.ask("phase", "seeds", "reveal", "--phase", "final", "--reason", "it is over",
                            schema="seeds")
        self.assertEqual((revealed["seeds"], revealed["secret"]), (seeds, secret.hex()))
        for hours in (1, -1):  # whatever became of its times
            self.hold(closes_in_hours=hours)
            again = self.call("POST", "/v1/phases/final/reveal", {"reason": "again"})
            self.assertEqual((again[0], again[1]["changed"], again[1]["seeds"]), (200, False, seeds))

        told = self.shown("alpha", "/v1/challenges")["challenges"][0]["phases"][0]["seeds"]
        self.assertEqual(told["secret"], secret.hex())
        self.assertEqual(told["commitment"], hashlib.sha256(secret.hex().encode()).hexdigest())
        rows = self.shown("alpha", f"/v1/submissions/{submission}/result?episodes=1")
        self.assertEqual([row["seed"] for row in rows["episode_rows"]], seeds)
        self.assertNotIn("withheld", rows)
        answers = self.all_answers("alpha", submission)
        for seed in seeds:
            self.assertTrue(any(str(seed).encode() in text for _, text in answers.values()))

        for words in (["--secret", secret.hex()], []):
            after = self.ask("verify", receipt, "--key", key, *words, schema="verify")
            self.assertTrue(after["valid"], (words, after))
            self.assertEqual([check["name"] for check in after["checks"]],
                             ["signature", "merkle_root", "results", "record", "commitment",
                              "seed_commitments", "seeds", "config", "policy_seeds"], words)
        wrong = self.cli("verify", receipt, "--key", key, "--secret", "0" * 64, check=False)
        self.assertEqual(wrong.returncode, 1)
        self.assertIn("commitment: WRONG", wrong.stdout)
        same = self.as_team("alpha", "GET", f"/v1/submissions/{submission}/receipt")[1]
        self.assertEqual(json.loads(same), json.loads(receipt.read_text()),
                         "a receipt stays what it was")
        checked = self.daemon.run_verb(
            "phase", "seeds", "check", "--phase", "final", "--count", COUNT, "--secret", secret.hex(),
            "--commitment", told["commitment"], "--json")
        self.assertTrue(json.loads(checked.stdout)["valid"], checked)

    def test_an_export_warns_of_what_it_holds(self):
        self.enter("ok")
        done = self.cli("store", "export", self.folder / "export.json")
        self.assertIn("final", done.stderr)
        self.assertIn("not revealed", done.stderr)
        self.hold(closes_in_hours=-1)
        self.cli("phase", "seeds", "reveal", "--phase", "final")
        self.assertEqual(self.cli("store", "export", self.folder / "again.json").stderr, "")

    def test_a_secret_stays_the_same_over_restarts(self):
        before = self.get("/v1/challenges")["challenges"][0]["phases"][0]["seeds"]["commitment"]
        first = self.enter("ok")
        self.hold()
        after = self.get("/v1/challenges")["challenges"][0]["phases"][0]["seeds"]["commitment"]
        self.assertEqual(before, after)
        second = self.enter("ok", "beta")
        self.assertEqual(*(self.result(one)["merkle_root"] for one in (first, second)),
                         "all teams play the same seeds and the same luck")


class Withheld(SecretsCase):
    def test_a_phase_that_shows_little_shows_no_more(self):
        self.hold(show=LITTLE)
        self.organise("alpha", "beta")
        submission = self.enter("crash")
        result = self.shown("alpha", f"/v1/submissions/{submission}/result?episodes=1")
        self.assertEqual(result["withheld"], ["outcomes", "metrics", "logs", "output", "seeds"])
        self.assertEqual((result["outcomes"], result["output"]), ({}, []))
        for row in result["episode_rows"]:
            self.assertEqual({key for key, value in row.items() if value not in (None, {})},
                             {"index", "attempt", "seed_commitment"})
        self.assertEqual(len(result["merkle_root"]), 64)
        for path, (_, text) in self.all_answers("alpha", submission).items():
            self.assertNotIn(b"hello from the policy", text, path)
            self.assertNotIn(b"signal 11", text, path)
            if path != "/v1/openapi.json":  # which has the words in an example
                self.assertNotIn(b"ended as", text, path)
        for method, part in (("GET", "receipt"), ("POST", "rerun")):
            status, code, message = self.refused(
                "alpha", method, f"/v1/submissions/{submission}/{part}",
                {} if method == "POST" else None)
            self.assertEqual((status, code), (409, "withheld"))
            self.assertIn("wait until the organiser", message)
        self.assertEqual(self.call("GET", f"/v1/submissions/{submission}/receipt")[0], 200)
        # Another team's is answered as one that there is none of, withheld or not.
        for part in ("", "/result", "/receipt"):
            other = self.refused("beta", "GET", f"/v1/submissions/{submission}{part}")
            none = self.refused("beta", "GET", f"/v1/submissions/999{part}")
            self.assertEqual(other[:2], none[:2])
            self.assertEqual(other[2].replace(str(submission), "999"), none[2])
        text = self.cli("show", submission).stdout
        self.assertIn("crash", text)
        self.call("POST", "/v1/phases/final/publish", {"reason": "it is over"})
        result = self.shown("alpha", f"/v1/submissions/{submission}/result?episodes=1")
        self.assertEqual(result["withheld"], ["seeds"])
        self.assertEqual(result["outcomes"], {"crash": COUNT})

    def test_a_look_costs_what_a_look_costs(self):
        self.hold(show=SEEDS_SHOWN)
        self.organise("alpha")
        failed = self.enter("crash")
        result = self.shown("alpha", f"/v1/submissions/{failed}/result?episodes=1")
        self.assertIn("the first as crash", result["reason"])
        self.assertEqual((result["outcomes"], result["reasons"], result["aggregate"]), ({}, {}, None))
        self.assertTrue(all(row["outcome"] is row["steps"] is row["fault"] is None
                            for row in result["episode_rows"]))
        self.assertLessEqual(len(result["output"]), 1)
        self.assertEqual(self.refused("alpha", "GET", f"/v1/submissions/{failed}/receipt")[:2],
                         (409, "withheld"))
        status, body = self.as_team("alpha", "POST", "/v1/artefacts", played_by_stand_in("stubborn"),
                                    "application/x-tar")
        self.assertEqual(status, 201, body)
        status, body = self.as_team("alpha", "POST", "/v1/submissions", {
            "artefact": json.loads(body)["artefact"], "team": "alpha", "track": TRACK,
            "phase": "final"})
        path = f"/v1/submissions/{json.loads(body)['submission']}"
        self.wait(path, lambda b: b["state"] == "running" and b["blocks"][0]["step"] is not None)
        running = self.shown("alpha", path)
        for block in running["blocks"]:
            self.assertTrue(block["episode"] is block["step"] is block["silent_wall_s"] is None)
        self.assertEqual(running["episodes"]["done"], 0)
        status, body = self.as_team("alpha", "POST", path + "/cancel", {})
        self.assertEqual((status, json.loads(body)["cancel"]["charged"]), (200, "official"), body)

    def test_counts_and_means_come_when_all_is_played(self):
        self.hold(show=LITTLE)
        self.organise("alpha")
        status, body = self.as_team("alpha", "POST", "/v1/artefacts",
                                    played_by_stand_in("slow"), "application/x-tar")
        self.assertEqual(status, 201, body)
        status, body = self.as_team("alpha", "POST", "/v1/submissions", {
            "artefact": json.loads(body)["artefact"], "team": "alpha", "track": TRACK,
            "phase": "final"})
        submission = json.loads(body)["submission"]
        path = f"/v1/submissions/{submission}"
        self.wait(path, lambda b: b["episodes"]["done"] >= 2)
        running = self.shown("alpha", path)
        if running["state"] == "running":
            self.assertIsNone(running["episodes"]["success"])
            self.assertIsNone(self.shown("alpha", path + "/result")["aggregate"])
            self.assertTrue(all(block["step"] is None for block in running["blocks"]))
        self.ended(submission)
        self.assertEqual(self.shown("alpha", path)["episodes"]["done"], COUNT)
        self.assertIsNotNone(self.shown("alpha", path)["episodes"]["success"])
        self.assertIsNotNone(self.shown("alpha", path + "/result")["aggregate"])
        listed = self.shown("alpha", "/v1/submissions")["submissions"][0]
        self.assertEqual(listed["withheld"], running["withheld"])

    def test_a_phase_whose_file_is_gone_shows_no_more_than_before(self):
        self.hold(show=LITTLE)
        self.organise("alpha")
        submission = self.enter("ok")
        (self.configs / "challenges/cup.json").write_text(json.dumps(
            {"form": 1, "title": "Cup", "phases": [
                {"name": "next", "title": "Next", "track": TRACK, "profile": "paper"}]}))
        self.stop(signal.SIGTERM)
        self.start()
        _, _, texts = self.hidden()
        for path, (_, text) in self.all_answers("alpha", submission).items():
            for hidden in texts:
                self.assertNotIn(hidden.encode(), text, path)
        result = self.shown("alpha", f"/v1/submissions/{submission}/result?episodes=1")
        self.assertEqual(result["withheld"], ["outcomes", "metrics", "logs", "output", "seeds"])
        status, body = self.call("POST", "/v1/phases/final/reveal", {"reason": "it is over"})
        self.assertEqual((status, len(body.get("seeds", []))), (200, COUNT), body)
        self.assertNotIn("withheld", self.shown("alpha", f"/v1/submissions/{submission}/result"))


class Practice(SecretsCase):
    def practise(self, **more):
        return self.call("POST", "/v1/submissions", {
            "artefact": self.upload("ok"), "team": "alpha", "track": TRACK, **more})

    def test_practice_has_seeds_of_its_own(self):
        submission = self.submit("ok", episodes=4)
        self.ended(submission)
        self.assertEqual([row["seed"] for row in self.result(submission)["episode_rows"]],
                         [100, 101, 102, 103])
        status, body = self.practise(episodes=COUNT + 1)
        self.assertEqual(status, 400)
        self.assertIn("practice seeds has 6", body["error"]["message"])

    def test_a_ranked_seed_is_no_practice(self):
        # Seeds of this track, and of another one of the same environment.
        for seeds in ([0], [200, 5], [99]):
            status, body = self.practise(seeds=seeds)
            self.assertEqual((status, body["error"]["code"]), (400, "ranked_seed"), body)
        self.assertIn('track "manipulation" ranks', body["error"]["message"])
        self.assertEqual(self.practise(seeds=[200, 201], episodes=1)[0], 201)

    def test_public_seeds_of_a_phase_are_no_practice_and_hidden_ones_are_not_looked_at(self):
        self.hold(seeds={"first": 5000, "count": 3}, show={})
        self.call("POST", "/v1/teams", {"team": "alpha", "reason": "test"})
        status, body = self.practise(seeds=[5001])
        self.assertEqual((status, body["error"]["code"]), (400, "ranked_seed"), body)
        self.assertIn('phase "final" ranks', body["error"]["message"])
        self.assertEqual(self.practise(seeds=[6001])[0], 201)
        self.assertEqual(self.practise(episodes=2)[0], 201)
        (self.configs / "challenges/cup.json").unlink()
        self.hold()
        self.organise("beta")
        self.enter("ok", "beta")
        seeds, _, _ = self.hidden()
        # Whoever guesses one learns nothing.
        self.assertEqual(self.practise(seeds=[seeds[0]])[0], 201)


if __name__ == "__main__":
    unittest.main(verbosity=2)
