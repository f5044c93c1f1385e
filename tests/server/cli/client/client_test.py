"""How the verbs that talk to a daemon handle its answers, and its silence.
usage: client_test.py BIN_DIR SOURCE_DIR"""
import json
import os
import shutil
import subprocess
import sys
import unittest

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
from cli_case import (  # pylint: disable=wrong-import-position
    AGGREGATE, BIN_DIR, BOARD, COUNTS, EFFORT, HASHES, LONG_BOARD, RESULT, STATUS, TIME,
    TOUCH, CliCase, Handler, metric, myograde)


class ClientTest(CliCase):
    def test_no_daemon_is_status_3(self):
        self.refused(3, "reach a daemon", "status", "--data", self.temp)
        self.refused(3, "reach a daemon", "leaderboard", MYOGRADE_DATA=self.temp)
        self.refused(2, "longer than", "status", "--socket", "/" + "x" * 200)

    def test_a_closed_folder_has_a_remedy(self):
        folder = self.path("closed")
        os.mkdir(folder)
        os.chmod(self.temp, 0o755)
        self.path("closed/myograde.sock", "")
        os.chmod(folder, 0)
        self.addCleanup(os.chmod, folder, 0o700)
        program = shutil.copy(f"{BIN_DIR}/myograde", self.path("myograde"))
        other = {"user": 65534, "group": 65534, "extra_groups": []} if os.geteuid() == 0 else {}
        done = subprocess.run([program, "status", "--data", folder], capture_output=True, text=True,
                              timeout=60, stdin=subprocess.DEVNULL, check=False, **other)
        self.assertEqual(done.returncode, 3, done.stderr)
        self.assertIn(f"{folder} is open to", done.stderr)
        self.assertIn("run this as", done.stderr)

    def test_answers_of_the_daemon_keep_their_schemas(self):
        socket = self.serve({
            "GET /v1/submissions/7": (200, STATUS), "GET /v1/submissions/7/result": (200, RESULT),
            "POST /v1/submissions/7/cancel": (200, {**STATUS, "cancel": {
                "killed": 1, "still_ending": 0, "took_wall_s": 0.03, "charged": "official"}}),
            "POST /v1/artefacts?team=alpha&track=t": (201, {"artefact": "a" * 64}),
            "POST /v1/submissions": (201, STATUS),
            "GET /v1/leaderboard?track=t&board=main": (200, BOARD)})
        at = ("--socket", socket)
        self.checked("status", "status", "7", *at)
        self.checked("show", "show", "7", *at)
        self.checked("cancel", "cancel", "7", *at)
        self.checked("leaderboard", "leaderboard", "--track", "t", *at)
        program = self.path("program", "#!/bin/sh\n", 0o755)
        submitted = self.checked("submit", "submit", program, "--track", "t", "--team", "alpha",
                                 "--wait", *at)
        self.assertEqual(submitted["result"]["aggregate"], AGGREGATE)
        request = [json.loads(b) for c, p, b in Handler.heard if p == "/v1/submissions"]
        self.assertEqual(request, [{"artefact": "a" * 64, "team": "alpha", "track": "t"}])

    def test_an_answer_may_be_of_any_length(self):
        socket = self.serve({"GET /v1/submissions/7": (200, {**STATUS, "reason": "x" * (17 << 20)})})
        told = myograde("status", "7", "--json", "--socket", socket)
        self.assertEqual(told.returncode, 0, told.stderr[-300:])
        self.assertEqual(len(json.loads(told.stdout)["reason"]), 17 << 20)

    def test_a_phase_says_its_track(self):
        socket = self.serve({
            "GET /v1/challenges": (200, {"challenges": [
                {"challenge": "cup", "phases": [{"phase": "final", "track": "t"}]}]}),
            "POST /v1/artefacts?team=alpha&track=t": (201, {"artefact": "a" * 64}),
            "POST /v1/submissions": (201, STATUS)})
        program = self.path("program", "#!/bin/sh\n", 0o755)
        at = ("--team", "alpha", "--socket", socket)
        self.refused(2, "--track", "submit", program, *at)
        self.refused(2, "no phase \"last\"", "submit", program, "--phase", "last", *at)
        for name, why in (("x" * 65, "too long"), ("", "empty"), ("a\u200bb", "U+200B")):
            self.refused(2, why, "submit", program, "--phase", "final", "--name", name, *at)
        self.assertEqual([p for c, p, b in Handler.heard if c == "POST"], [])
        self.checked("submit", "submit", program, "--phase", "final", *at)
        request = [json.loads(b) for c, p, b in Handler.heard if p == "/v1/submissions"]
        self.assertEqual(request, [{"artefact": "a" * 64, "team": "alpha", "track": "t",
                                    "phase": "final"}])

    def test_figures_are_those_of_the_profile_and_of_the_board(self):
        graded = {"profile": "as-graded", "official_figures": True,
                  "metrics": [TIME, EFFORT, TOUCH], "columns": [TIME, EFFORT, TOUCH]}
        socket = self.serve({
            "GET /v1/submissions/7/result": (200, {**RESULT, **graded}),
            "GET /v1/submissions/8/result": (200, RESULT),
            "GET /v1/leaderboard?track=t&board=main": (200, {**BOARD, **graded}),
            "GET /v1/leaderboard?track=u&board=main": (200, BOARD),
            "GET /v1/leaderboard?track=t&board=physiological": (200, {
                **BOARD, "board": "physiological", "rules": {"means": "steps"}, "columns": [
                    metric("distance_m", "distance", "m", better="more"),
                    metric("pain_over_steps", "pain", "", 6),
                    metric("effort_over_steps", "effort", "", 6)],
                "rows": [{**BOARD["rows"][0], "aggregate": {
                    **AGGREGATE, "distance_m": 30.0, "pain": 0.5, "pain_over_steps": 0.25}}]})})
        at = ("--socket", socket)
        self.assertIn("481.2 N", myograde("show", "7", *at).stdout)
        self.assertNotIn("481", myograde("show", "8", *at).stdout)
        graded_board = myograde("leaderboard", "--track", "t", *at).stdout
        self.assertIn("touch N", graded_board)
        self.assertIn("481.2", graded_board)
        self.assertNotIn("touch", myograde("leaderboard", "--track", "u", *at).stdout)
        body = myograde("leaderboard", "--track", "t", "--board", "physiological", *at).stdout
        for ranked in ("0.250000", "0.012346"):
            self.assertIn(ranked, body)
        self.assertNotIn("0.500000", body)

    def test_text_is_harmless_and_statuses_are_exact(self):
        differs = {"with": 9, "compared": 2, "equal": 1, "missing": 0,
                   "episodes": [{"index": 0, "equal": True, "differs": []},
                                {"index": 1, "equal": False, "differs": ["digest"]}]}
        rerun = {"evaluation": 12, "first": 0, "last": 1, "state": "queued"}
        socket = self.serve({
            "GET /v1/submissions/7/result": (200, RESULT),
            "POST /v1/submissions/7/rerun": (201, rerun),
            "GET /v1/evaluations/12": (200, {**RESULT, "evaluation": 12, "kind": "rerun",
                                             "comparison": differs}),
            "POST /v1/submissions/7/cancel": (409, {"error": {
                "code": "conflict", "message": "Submission 7 has ended."}}),
            "GET /v1/submissions/8": (503, {"error": {"code": "store", "message": "Disk full."}}),
            "GET /v1/submissions/9": (200, "no JSON")})
        at = ("--socket", socket)
        shown = myograde("show", "7", *at)
        self.assertEqual(shown.returncode, 0, shown.stderr)
        self.assertNotIn("\x1b", shown.stdout)
        self.assertIn("evil ?[2J words", shown.stdout)
        again = myograde("rerun", "7", *at)
        self.assertEqual(again.returncode, 1, again.stderr)
        self.assertIn("1 of 2 episodes is equal", again.stdout)
        self.refused(2, "Submission 7 has ended.", "cancel", "7", *at)
        self.refused(4, "Disk full.", "status", "8", *at)
        self.refused(4, "no readable body", "status", "9", *at)

    def test_cancel_says_what_it_costs(self):
        for charged, words in (("official", "It still counts against the team's quota"),
                               (None, "It does not count against the team's quota")):
            socket = self.serve({"POST /v1/submissions/7/cancel": (200, {
                **STATUS, "episodes": {**COUNTS, "success": 1}, "cancel": {
                    "killed": 1, "still_ending": 0, "took_wall_s": 0.03, "charged": charged}})})
            done = myograde("cancel", "7", "--socket", socket)
            self.assertIn(words, done.stdout)
            self.assertIn("it keeps 2/2 episodes, 1 success", done.stdout)
            self.assertNotIn("lease", done.stdout)
            os.remove(socket)

    def test_results_are_aligned_and_short(self):
        socket = self.serve({"GET /v1/submissions/7/result": (
            200, {**RESULT, "hashes": HASHES, "merkle_root": "9" * 64})})
        short = myograde("show", "7", "--socket", socket).stdout
        columns = {line.index(value) for line in short.splitlines() for name, value in (
            ("failures by reason", "1 time"), ("successes  ", "1 of 2"), ("artefact", "0123"))
            if name in line}
        self.assertEqual(len(columns), 1, short)
        self.assertNotRegex(short, "[0-9a-f]{13}")
        full = myograde("show", "7", "--full-hashes", "--socket", socket).stdout
        self.assertIn(HASHES["artefact"], full)
        self.assertIn("9" * 64, full)

    def test_a_board_tells_its_order(self):
        socket = self.serve({"GET /v1/leaderboard?track=locomotion&board=main": (200, LONG_BOARD)})
        done = myograde("leaderboard", "--track", "locomotion", "--socket", socket)
        self.assertIn("  By mean distance. By mean", done.stdout)
        self.assertIn("1 evaluation under an earlier config of this track is not on it",
                      done.stdout)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
