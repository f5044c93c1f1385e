"""submit --dry-run with canned answers of a server and a stand-in for the runner: what would fail is
named, and nothing is sent.
usage: dry_run_test.py BIN_DIR SOURCE_DIR"""
import copy
import json
import os
import shutil
import sys
import unittest

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
from cli_case import (  # pylint: disable=wrong-import-position
    SOURCE_DIR, CliCase, Handler, myograde, validate)

TRACK = "manipulation"
WHOAMI = {"role": "participant", "teams": ["alpha"], "caller": "token 3", "remote": True, "token": None}
PHASE = {"phase": "final", "track": TRACK, "profile": "paper", "state": "open", "paused": None,
         "opens_at": "2026-01-01T00:00:00.000Z", "closes_at": "2099-01-01T00:00:00.000Z",
         "teams": None}
USE = {"limit": 5, "granted": 0, "used": 1, "open": 0, "left": 4}
BUDGET = {"per_day": USE, "total": {**USE, "limit": 9, "left": 8}}
PLACE = {"waiting": {"limit": 2, "used": 0}, "official": BUDGET, "practice": BUDGET, "failed": BUDGET}
SUBMISSIONS = f"GET /v1/submissions?team=alpha&track={TRACK}&limit=1000"


def challenges(*phases, paused=None):
    return {"paused": paused, "challenges": [{"challenge": "cup", "phases": list(phases)}]
            if phases else []}


class DryRunTest(CliCase):
    def setUp(self):
        super().setUp()
        os.mkdir(self.path("bin"))
        runner = shutil.copy(f"{SOURCE_DIR}/tests/support/fake_runner.py",
                             self.path("bin/myograde-runner"))
        os.chmod(runner, 0o755)
        self.policy("ok")
        config = json.loads(self.myograde("local", self.path("policy"), "--track", TRACK,
                                          "--episodes", "1", "--json").stdout)["hashes"]["config"]
        self.answers = {
            "GET /v1/whoami": WHOAMI,
            "GET /v1/teams/alpha": {"team": "alpha", "banned": False},
            "GET /v1/challenges": challenges(),
            "GET /v1/tracks": {"tracks": [{"track": TRACK, "default_profile": "paper", "profiles": [
                {"profile": "paper", "config": config}]}]},
            f"GET /v1/quota?team=alpha&track={TRACK}&limit=1": {
                "next_day_at": "2026-01-02T00:00:00.000Z", "tracks": [{"track": TRACK, **PLACE}],
                "phases": [{"phase": "final", "track": TRACK, **PLACE}]},
            "GET /v1/runtimes": {"runtimes": [{"runtime": "python"}, {"runtime": "torch-cpu"}]},
            SUBMISSIONS: {"submissions": []},
            SUBMISSIONS + "&phase=final": {"submissions": []}}
        self.socket = self.serve({})

    def policy(self, mode):
        self.path("policy/policy.json", json.dumps({"name": "walker", "command": ["./run", mode]}))
        self.path("policy/run", "#!/bin/sh\n", 0o755)

    def myograde(self, *words):
        return myograde(*words, MYOGRADE_BIN_DIR=self.path("bin"))

    def dry(self, status, *words, answers=None, at=None):
        """The checks by their names; the exit status must be `status`."""
        told = {**copy.deepcopy(self.answers), **(answers or {})}
        Handler.answers.clear()
        Handler.answers.update({key: value if isinstance(value, tuple) else (200, value)
                                for key, value in told.items()})
        Handler.heard.clear()
        place = () if "--phase" in words else ("--track", TRACK)
        done = self.myograde("submit", self.path("policy"), "--team", "alpha", "--dry-run", "--json",
                             *place, *(at or ("--socket", self.socket)), *words)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        self.assertEqual({command for command, _, _ in Handler.heard} - {"GET"}, set())
        report = json.loads(done.stdout)
        validate(report, "submit-dry-run")
        self.report = report
        return {check["name"]: check for check in report["checks"]}

    def fails(self, check, sentence, *words, answers=None):
        checks = self.dry(1, *words, answers=answers)
        self.assertEqual([name for name, found in checks.items() if found["state"] == "fails"],
                         [check], checks)
        self.assertIn(sentence, checks[check]["found"])
        self.assertEqual(self.report["state"], "fails")

    def quota(self, **changes):
        answers = copy.deepcopy(self.answers[f"GET /v1/quota?team=alpha&track={TRACK}&limit=1"])
        for place in answers["tracks"] + answers["phases"]:
            place.update(changes)
        return {f"GET /v1/quota?team=alpha&track={TRACK}&limit=1": answers}

    def test_a_submission_that_would_be_graded(self):
        checks = self.dry(0)
        self.assertEqual({name: check["state"] for name, check in checks.items()}, {
            "submission": "ok", "program": "ok", "server": "ok", "team": "ok", "phase": "ok",
            "rules": "ok", "runtimes": "ok", "quota": "ok", "episode": "ok", "time": "ok", "output": "ok",
            "memory": "unknown"})  # the stand-in does not measure it
        self.assertIn("4 official submissions are left today, 8 in all", checks["quota"]["found"])
        # The first practice seed, which is never a ranked one.
        self.assertEqual(self.report["episode"]["seed"], 100)
        for words in (("--seeds", self.path("seeds", "7777\n8888\n")), ("--episodes", "3")):
            self.assertIn("practice", self.dry(0, *words)["phase"]["found"])
        self.assertEqual(self.dry(0, "--seeds", self.path("seeds"))["episode"]["state"], "ok")
        self.assertEqual(self.report["episode"]["seed"], 7777)

    def test_the_time_is_of_the_blocks_that_would_be_played(self):
        # "as-graded" allows blocks of any length, and the whole evaluation is one.
        config = json.loads(self.myograde("local", self.path("policy"), "--track", TRACK, "--profile", "as-graded",
                                          "--episodes", "1", "--json").stdout)["hashes"]["config"]
        profiles = [{"profile": "as-graded", "config": config}]
        tracks = {"GET /v1/tracks": {"tracks": [{"track": TRACK, "default_profile": "paper",
                                                 "profiles": profiles}]}}
        final = {**tracks, "GET /v1/challenges": challenges({**PHASE, "profile": "as-graded", "episodes": 250})}
        for words, answers, episodes in (((), tracks, 100), (("--episodes", "7"), tracks, 7),
                                         (("--seeds", self.path("seeds", "1\n2\n3\n")), tracks, 3),
                                         (("--phase", "final"), final, 250)):
            place = () if "--phase" in words else ("--profile", "as-graded")
            time = self.dry(0, *place, *words, answers=answers)["time"]
            # 0.1 s in all, of which 0.01 s are the episode's.
            self.assertIn("the start takes 90 ms of CPU time, ", time["found"])
            block = 0.09 + 0.01 * episodes
            self.assertIn(f"a block of {episodes} such episodes "
                          f"{f'{block:.3g} s' if block >= 1 else f'{1000 * block:.3g} ms'} of", time["found"])
            self.assertEqual(time["state"], "ok")

    def test_people_read_what_to_do(self):
        Handler.answers.update({key: (200, value) for key, value in self.answers.items()})
        words = ("submit", self.path("policy"), "--track", TRACK, "--team", "alpha", "--dry-run",
                 "--socket", self.socket)
        done = self.myograde(*words)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("would be accepted and graded. Nothing was sent.\n", done.stdout)
        self.policy("crash")
        done = self.myograde(*words)
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn("the policy died of signal 11", done.stdout)
        self.assertIn("hello from the policy", done.stdout)

    def test_the_submission_itself(self):
        self.policy("crash")
        self.fails("episode", "ended as crash after 200 steps: the policy died of signal 11")
        self.path("policy/policy.json", '{"name": "walker", "command": ["./gone"]}')
        self.fails("submission", "./gone")
        self.assertEqual([self.report["name"], self.report["episode"]], [None, None])
        self.path("policy/policy.json", '{"name": "walker", "command": ["python99"]}')
        self.fails("program", "nor a program of the sandbox")
        self.path("policy/policy.json",
                  '{"name": "w", "command": ["/bin/true"], "runtimes": ["elsewhere"]}')
        self.fails("runtimes",
                   'the runtime "elsewhere", which this server does not have; it has python, torch-cpu')
        # It may be there and not here.
        checks = self.dry(4, answers={"GET /v1/runtimes": {"runtimes": [{"runtime": "elsewhere"}]}})
        self.assertIn('asks for the runtime "elsewhere"', checks["program"]["found"])
        self.assertEqual((checks["runtimes"]["state"], checks["episode"]["state"]),
                         ("ok", "unknown"))

    def test_who_submits(self):
        self.fails("server", "does not know you", answers={"GET /v1/whoami": {
            **WHOAMI, "role": "public", "teams": []}})
        self.fails("server", "The token is revoked.", answers={"GET /v1/whoami": (401, {
            "error": {"code": "bad_token", "message": "The token is revoked."}})})
        self.fails("team", "banned", answers={"GET /v1/teams/alpha": {"team": "alpha",
                                                                      "banned": True}})
        unknown = {"GET /v1/teams/alpha": (404, {"error": {"code": "not_found", "message": "No."}})}
        self.assertIn("creates it", self.dry(0, answers=unknown)["team"]["found"])
        self.fails("team", 'no team "alpha"',
                   answers={**unknown, "GET /v1/challenges": challenges(PHASE)})
        renamed = {"GET /v1/teams/alpha": {"team": "beta", "banned": False}}
        self.assertIn('which is "beta" now', self.dry(0, answers=renamed)["team"]["found"])

    def test_what_is_open(self):
        def at(*phases, paused=None):
            return {"GET /v1/challenges": challenges(*phases, paused=paused)}

        self.assertIn('"final"', self.dry(0, answers=at(PHASE))["phase"]["found"])
        self.assertIn("until 2099", self.dry(0, "--phase", "final", answers=at(PHASE))["phase"]
                      ["found"])
        self.assertEqual(self.report["phase"], "final")
        upcoming = {**PHASE, "state": "upcoming"}
        self.fails("phase", "opens at 2026", answers=at(upcoming))
        self.dry(0, "--episodes", "1", answers=at(upcoming))
        self.fails("phase", "closed at 2099", answers=at({**PHASE, "state": "closed"}))
        self.fails("phase", "paused all submissions: a fire", "--episodes", "1",
                   answers=at(PHASE, paused={"reason": "a fire"}))
        self.fails("phase", 'paused phase "final": rain', answers=at(
            {**PHASE, "state": "paused", "paused": {"reason": "rain"}}))
        self.fails("phase", "2 open phases: final, second",
                   answers=at(PHASE, {**PHASE, "phase": "second"}))
        self.fails("phase", 'is of track "locomotion"', "--phase", "leg", "--track", TRACK,
                   answers=at({**PHASE, "phase": "leg", "track": "locomotion"}))
        invited = self.dry(0, answers=at({**PHASE, "teams": ["beta"]}))["phase"]
        self.assertEqual(invited["state"], "warning")
        refused = self.myograde("submit", self.path("policy"), "--team", "alpha", "--dry-run",
                                "--phase", "nowhere", "--socket", self.socket)
        self.assertEqual((refused.returncode, refused.stdout), (2, ""))
        self.assertIn('no phase "nowhere"', refused.stderr)

    def test_what_is_left(self):
        used_up = {**USE, "left": 0, "used": 5}
        self.fails("quota", "5 of 5 today; the next day begins at 2026-01-02", answers=self.quota(
            official={**BUDGET, "per_day": used_up}))
        self.fails("quota", "official submissions is used up: 5 of 5 in all", answers=self.quota(
            official={**BUDGET, "total": used_up}))
        self.fails("quota", "failed tries", answers=self.quota(
            failed={**BUDGET, "per_day": used_up}))
        self.fails("quota", "waiting, which is", answers=self.quota(waiting={"limit": 2, "used": 2}))
        practice = self.quota(official={**BUDGET, "per_day": used_up})
        self.dry(0, "--episodes", "1", answers=practice)
        self.dry(0)
        twin = {"submission": 5, "artefact": self.report["artefact"], "ranked": True,
                "state": "done", "profile": "paper"}
        novelty = self.dry(0, answers={SUBMISSIONS: {"submissions": [twin]}})["novelty"]
        self.assertEqual(novelty["state"], "warning")
        self.assertIn("submission 5", novelty["found"])

    def test_other_rules_are_told(self):
        tracks = copy.deepcopy(self.answers["GET /v1/tracks"])
        tracks["tracks"][0]["profiles"][0]["config"] = "c" * 64
        rules = self.dry(0, answers={"GET /v1/tracks": tracks})["rules"]
        self.assertEqual(rules["state"], "warning")
        self.assertIn("cccccccccccc", rules["found"])
        self.fails("rules", 'no profile "myosuite"', "--profile", "myosuite")
        self.fails("rules", f'no track "{TRACK}"', answers={"GET /v1/tracks": {"tracks": []}})

    def test_without_a_server_or_a_host_that_plays(self):
        checks = self.dry(3, at=("--data", self.path("nowhere")))
        self.assertEqual(checks["server"]["state"], "unknown")
        self.assertEqual(checks["episode"]["state"], "ok")
        self.assertFalse(self.report["answered"])
        self.assertEqual(self.dry(3, at=("--server", "http://127.0.0.1:9"))["server"]["state"],
                         "unknown")
        self.policy("dies")
        self.assertIn("out of luck", self.dry(4)["episode"]["found"])
        self.policy("crash")  # what would fail weighs more than what is unknown
        self.dry(1, at=("--data", self.path("nowhere")))

    def test_wrong_use(self):
        submit = ("submit", self.path("policy"), "--team", "a", "--dry-run")
        self.refused(2, "--track", *submit)
        self.refused(2, "no track", *submit, "--track", "running")
        self.refused(2, "--wait", *submit, "--track", TRACK, "--wait")
        self.refused(3, "reach a daemon", *submit, "--phase", "final", "--data", self.temp)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
