"""Shared by the tests of the command line tool: calls it, and provides a daemon with canned
answers.
BIN_DIR and SOURCE_DIR are the arguments of the test."""
import http.server
import json
import os
import shutil
import socketserver
import subprocess
import sys
import tempfile
import threading
import time
import unittest

from support.schemas import validate

BIN_DIR, SOURCE_DIR = sys.argv[1:3]
SECONDS = 60  # for which a call may take


def myograde(*args, **env):
    return subprocess.run([f"{BIN_DIR}/myograde", *args], capture_output=True, text=True,
                          timeout=SECONDS, stdin=subprocess.DEVNULL, check=False,
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


VERBS = ("serve", "submit", "status", "cancel", "choose", "leaderboard", "show", "rerun", "quota",
         "team", "team grant", "token", "board", "board explain", "board rebuild", "board rejudge", "submission",
         "submission hide", "submission unhide", "submission disqualify", "submission reinstate",
         "submission baseline", "phase", "phase seeds", "store", "store export", "store import",
         "store backup", "episode", "episode log", "episode replay", "episode render", "plot", "report", "proof",
         "proof receipt", "proof key", "proof release", "verify", "login", "logout", "whoami", "new", "local", "try",
         "spec", "doctor")
COUNTS = {"total": 2, "done": 2, "success": 1, "failure": 1, "fault": 0}
STATUS = {"submission": 7, "team": "alpha", "track": "t", "profile": "paper", "phase": None,
          "artefact": "a" * 64,
          "name": "walker", "ranked": True, "state": "done", "evaluation": 9, "episodes": COUNTS,
          "queue": None, "waiting": None, "reason": None, "blocks": [], "evaluations": [],
          "owner": None, "deadline_at": None, "estimated_end_at": None, "history": []}
AGGREGATE = {"episodes": 2, "successes": 1, "success_rate": 0.5, "time_s": 7.5, "effort": 0.03,
             "pain": None, "distance_m": None, "effort_over_steps": 0.0123456,
             "pain_over_steps": None, "max_touch_n": 481.25}


def metric(name, title, unit, digits=4, better="less"):
    return {"name": name, "title": title, "unit": unit, "better": better, "digits": digits}


TIME, EFFORT = metric("time_s", "time", "s"), metric("effort", "effort", "", 6)
TOUCH = metric("max_touch_n", "peak touch", "N", 1, "neither")
RESULT = {"evaluation": 9, "submission": 7, "kind": "original", "team": "alpha", "track": "t",
          "merkle_root": None, "rejudge": None,
          "profile": "paper", "phase": None, "ranked": True, "state": "done", "reason": None,
          "first": 0, "last": 1,
          "episodes": COUNTS, "outcomes": {"success": 1, "failure": 1}, "reasons": {"time": 1},
          "aggregate": AGGREGATE, "official_figures": False, "metrics": [TIME, EFFORT],
          "hashes": {}, "grader": {}, "limits": {}, "output": [
              {"first": 0, "last": 1, "stderr_tail": "evil \x1b[2J words", "stdout_tail": ""}],
          "comparison": None}
BOARD = {"track": "t", "profile": "paper", "phase": None, "frozen_at": None, "complete": True,
         "board": "main", "config": "c" * 64, "episodes": 2,
         "other_config": 0, "disqualified": [], "rules": {}, "official_figures": False,
         "at": None, "config_in_force": "c" * 64, "builds": [], "other_configs": [], "ranks": "rules",
         "columns": [TIME, EFFORT],
         "unreadable": [],
         "rows": [{"rank": 1, "rank_by_rules": 1, "baseline": False, "team": "alpha", "submission": 7,
                   "evaluation": 9, "rejudge": None, "build": "b" * 12, "other_build": False,
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
        validate(value, verb)
        return value
