"""The command line tool as users see it: its reaction to bad input, the schemas of --json, and how
it shows a daemon's answers.  usage: cli_test.py BIN_DIR SOURCE_DIR"""
import http.server
import json
import os
import re
import shutil
import socketserver
import subprocess
import sys
import tempfile
import threading
import time
import unittest

BIN_DIR, SOURCE_DIR = sys.argv[1:3]
TYPES = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}


def has_type(value, name):
    if name == "integer":
        return isinstance(value, int) and not isinstance(value, bool)
    if name == "number":
        return isinstance(value, (int, float)) and not isinstance(value, bool)
    return isinstance(value, TYPES[name])


def mistakes(value, schema, where="$"):
    """The subset of JSON Schema that the project's schemas use."""
    if "anyOf" in schema:
        tried = [mistakes(value, s, where) for s in schema["anyOf"]]
        return [] if [] in tried else [m for t in tried for m in t]
    if "const" in schema and value != schema["const"]:
        return [f"{where}: is not {schema['const']!r}"]
    if "enum" in schema and value not in schema["enum"]:
        return [f"{where}: {value!r} is not one of {schema['enum']}"]
    wanted = schema.get("type")
    wanted = [wanted] if isinstance(wanted, str) else wanted
    if wanted and not any(has_type(value, t) for t in wanted):
        return [f"{where}: {value!r} is no {wanted}"]
    found = []
    if "pattern" in schema and not re.search(schema["pattern"], value):
        found.append(f"{where}: {value!r} does not match {schema['pattern']}")
    if isinstance(value, dict):
        found += [f"{where}: lacks {k!r}" for k in schema.get("required", []) if k not in value]
        for key, entry in value.items():
            inner = schema.get("properties", {}).get(key, schema.get("additionalProperties", {}))
            found += mistakes(entry, inner, f"{where}.{key}")
    if isinstance(value, list) and "items" in schema:
        for i, entry in enumerate(value):
            found += mistakes(entry, schema["items"], f"{where}[{i}]")
    return found


def schema_of(verb):
    with open(f"{SOURCE_DIR}/configs/schema/{verb}.json", encoding="utf-8") as file:
        return json.load(file)


def myograde(*args, **env):
    return subprocess.run([f"{BIN_DIR}/myograde", *args], capture_output=True, text=True,
                          timeout=60, stdin=subprocess.DEVNULL, check=False,
                          env={**os.environ, "MYOGRADE_CONFIG_DIR": f"{SOURCE_DIR}/configs", **env})


class UnixServer(socketserver.ThreadingMixIn, socketserver.UnixStreamServer):
    daemon_threads = True


class Handler(http.server.BaseHTTPRequestHandler):
    answers = {}  # "GET /path" -> (status, JSON or text)
    heard = []

    def address_string(self):
        return "client"

    def log_message(self, format, *args):  # pylint: disable=redefined-builtin
        pass

    pause = 0  # s per 256 KiB of a body

    def body(self):
        left = int(self.headers.get("Content-Length", 0))
        pieces = []
        while left > 0:
            time.sleep(self.pause)
            pieces.append(self.rfile.read(min(left, 256 << 10)))
            left -= len(pieces[-1])
        return b"".join(pieces)

    def reply(self):
        self.heard.append((self.command, self.path, self.body()))
        status, answer = self.answers.get(f"{self.command} {self.path}", (404, {
            "error": {"code": "not_found", "message": "There is no such thing."}}))
        if isinstance(answer, list):  # in sequence, repeating the last
            answer = answer.pop(0) if len(answer) > 1 else answer[0]
        data = answer.encode() if isinstance(answer, str) else json.dumps(answer).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    do_GET = do_POST = reply


VERBS = ("serve", "submit", "status", "cancel", "leaderboard", "show", "rerun", "quota", "hide",
         "unhide", "disqualify", "baseline", "export", "import", "backup", "log", "replay",
         "receipt", "verify", "key", "seeds", "local", "spec", "doctor")
COUNTS = {"total": 2, "done": 2, "success": 1, "failure": 1, "fault": 0}
STATUS = {"submission": 7, "team": "alpha", "track": "t", "profile": "paper", "artefact": "a" * 64,
          "name": "walker", "ranked": True, "state": "done", "evaluation": 9, "episodes": COUNTS,
          "queue": None, "waiting": None, "reason": None, "leases": [], "evaluations": [],
          "owner": None, "deadline_at": None, "estimated_end_at": None, "history": []}
AGGREGATE = {"episodes": 2, "successes": 1, "success_rate": 0.5, "time_s": 7.5, "effort": 0.03,
             "pain": None, "distance_m": None, "effort_over_steps": 0.0123456,
             "pain_over_steps": None, "max_touch_n": 481.25}


def metric(name, title, unit, digits=4, better="less"):
    return {"name": name, "title": title, "unit": unit, "better": better, "digits": digits}


TIME, EFFORT = metric("time_s", "time", "s"), metric("effort", "effort", "", 6)
TOUCH = metric("max_touch_n", "peak touch", "N", 1, "neither")
RESULT = {"evaluation": 9, "submission": 7, "kind": "original", "team": "alpha", "track": "t",
          "merkle_root": None,
          "profile": "paper", "ranked": True, "state": "done", "reason": None, "first": 0, "last": 1,
          "episodes": COUNTS, "outcomes": {"success": 1, "failure": 1}, "reasons": {"time": 1},
          "aggregate": AGGREGATE, "official_figures": False, "metrics": [TIME, EFFORT],
          "hashes": {}, "grader": {}, "limits": {}, "output": [
              {"first": 0, "last": 1, "stderr_tail": "evil \x1b[2J words", "stdout_tail": ""}],
          "comparison": None}
BOARD = {"track": "t", "profile": "paper", "board": "main", "config": "c" * 64, "episodes": 2,
         "other_config": 0, "disqualified": [], "rules": {}, "official_figures": False,
         "columns": [TIME, EFFORT],
         "unreadable": [],
         "rows": [{"rank": 1, "baseline": False, "team": "alpha", "submission": 7, "evaluation": 9,
                   "name": "walker", "aggregate": AGGREGATE}]}
LONG_BOARD = {**BOARD, "track": "locomotion",
              "columns": [metric("distance_m", "distance", "m", better="more"), TIME, EFFORT,
                          metric("pain", "pain", "", 6)], "order": "By mean distance. " * 12, "other_config": 1,
              "rows": [{**BOARD["rows"][0], "rank": rank, "baseline": rank is None,
                        "submission": 1000 + i, "team": team, "name": "a policy of some length",
                        "aggregate": {**AGGREGATE, "distance_m": 99.1234, "pain": 0.012345}}
                       for i, (rank, team) in enumerate((
                           (1, "The Walking Muscles of the University of Somewhere"),
                           (2, "東京大学筋肉部" * 3), (None, "MyoGrade")))]}
HASHES = {name: "0123456789abcdef" * 4 for name in ("artefact", "config", "seeds", "results")}


class CliCase(unittest.TestCase):
    def setUp(self):
        self.temp = tempfile.mkdtemp(prefix="cli-")
        self.addCleanup(shutil.rmtree, self.temp)

    def path(self, name, text=None, mode=0o644):
        path = f"{self.temp}/{name}"
        if text is not None:
            os.makedirs(os.path.dirname(path), exist_ok=True)
            with open(path, "w", encoding="utf-8") as file:
                file.write(text)
            os.chmod(path, mode)
        return path

    def refused(self, status, sentence, *args, **env):
        done = myograde(*args, **env)
        self.assertEqual(done.returncode, status, (args, done.stderr))
        self.assertRegex(done.stderr, "^myograde: error: ")
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        self.assertIn(sentence, done.stderr)
        self.assertEqual(done.stdout, "")

    def serve(self, answers):
        socket = self.path("sock")
        server = UnixServer(socket, Handler)
        Handler.answers, Handler.heard = answers, []
        threading.Thread(target=server.serve_forever, daemon=True).start()
        self.addCleanup(server.server_close)
        self.addCleanup(server.shutdown)
        return socket

    def checked(self, verb, *args):
        done = myograde(*args, "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        value = json.loads(done.stdout)
        self.assertEqual(mistakes(value, schema_of(verb)), [])
        return value


class CliTest(CliCase):
    def test_every_verb_has_help_with_an_example(self):
        for verb in VERBS:
            done = myograde(verb, "--help")
            self.assertEqual(done.returncode, 0)
            self.assertIn(f"myograde {verb}", done.stdout)
            self.assertIn("Exit status", done.stdout)

    def test_wrong_use_is_told_in_one_sentence(self):
        self.refused(2, "", "paint")
        self.refused(2, "", "status", "--colour")
        self.refused(2, "", "submit", "x", "--team", "a")
        program = self.path("program", "#!/bin/sh\n", 0o755)
        for verb in (("local",), ("submit", "--team", "a")):
            for episodes in ("0", "-3", "1000000000", "many"):
                self.refused(2, "--episodes", *verb, program, "--track", "manipulation",
                             f"--episodes={episodes}")
                self.refused(2, "", *verb, program, "--track", "manipulation",
                             "--episodes", episodes)
        self.refused(2, "no range", "rerun", "7", "--episodes", "9..3")
        self.refused(2, "running", "spec", "--track", "running")
        self.refused(2, "running", "local", program, "--track", "running")
        self.refused(2, "holiday", "spec", "--track", "manipulation", "--profile", "holiday")

    def test_bad_submissions_are_told_before_anything_runs(self):
        local = ("local", "--track", "manipulation")
        self.refused(2, "No such file", *local, self.path("missing"))
        self.refused(2, "is not executable", *local, self.path("data", "x"))
        self.path("folder/readme", "x")
        self.refused(2, "no policy.json", *local, self.path("folder"))
        self.path("folder/policy.json", '{"name": "a", "command": ["./gone"]}')
        self.refused(2, "is not there", *local, self.path("folder"))
        self.path("folder/policy.json",
                  '{"name": "a", "command": ["/bin/true"], "runtimes": ["r"]}')
        self.refused(2, "asks for the runtime", *local, self.path("folder"))

    def test_bad_seed_files(self):
        program = self.path("program", "#!/bin/sh\n", 0o755)
        for text, sentence in (("", "has 0 seeds"), ("1\n1\n", "twice"), ("1\nx\n", "line 2"),
                               ("-1\n", "line 1"), ("[1, 2.5]", "entry 1 is 2.5"), ("[1", "JSON"),
                               (str(2**63), "must be a whole number from 0"),
                               ('{"first": 1}', "count")):
            self.refused(2, sentence, "local", program, "--track", "manipulation", "--seeds",
                         self.path("seeds", text))

    def test_bad_configs_name_the_file_and_the_key(self):
        shutil.copytree(f"{SOURCE_DIR}/configs", self.path("configs"))
        track = self.path("configs/tracks/manipulation.json")
        with open(track, encoding="utf-8") as file:
            good = json.load(file)
        bad = {**good, "budgets": {**good["budgets"], "step_s": 0}}
        self.path("configs/tracks/manipulation.json", json.dumps(bad))
        spec = ("spec", "--track", "manipulation", "--configs", self.path("configs"))
        self.refused(2, "step_s", *spec)
        self.path("configs/tracks/manipulation.json", json.dumps({**good, "speed": 1}))
        self.refused(2, "speed", *spec)
        self.path("configs/tracks/manipulation.json", "{")
        self.refused(2, "manipulation.json", *spec)

    def test_no_daemon_is_status_3(self):
        self.refused(3, "no daemon", "status", "--data", self.temp)
        self.refused(3, "no daemon", "leaderboard", MYOGRADE_DATA=self.temp)
        self.refused(2, "longer than", "status", "--socket", "/" + "x" * 200)

    def test_spec_keeps_its_schema_and_the_paper_s_sizes(self):
        for track, sizes in (("manipulation", (222, 80)), ("locomotion", (365, 55))):
            spec = self.checked("spec", "spec", "--track", track)
            for vector, size in zip(("observation", "action"), sizes):
                self.assertEqual(spec[vector]["size"], size)
                self.assertEqual(sum(p["size"] for p in spec[vector]["parts"]), size)
        self.assertGreaterEqual(len(self.checked("spec", "spec")["tracks"]), 2)
        shown = myograde("spec", "--track", "locomotion").stdout
        self.assertIn("Observation", shown)
        for name in ("0 default", "1 stairs-up", "2 stairs-down", "3 slopes", "4 standing"):
            self.assertIn(name, shown)
        self.assertNotIn("stiffness\":", shown)

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
        self.refused(4, "nothing that can be read", "status", "9", *at)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
