"""Stands in for EvalAI: its API for remote workers, with Django REST framework's answers, and its queue, which
delivers a message again until it is deleted. Written from EvalAI's apps/jobs and apps/challenges."""

import contextlib
import http.server
import json
import re
import threading
import time
import urllib.parse

STATUSES = ("submitted", "running", "queued", "resuming", "failed", "cancelled", "finished", "submitting")


class Refusal(Exception):
    def __init__(self, status, body, **headers):
        super().__init__(status, body)
        self.status, self.body, self.headers = status, body, headers


class Evalai:
    """`splits`: by phase, by the split's codename, its leaderboard's schema. `visibility_s`: for how long
    the queue hides a message that it has delivered."""

    def __init__(self, splits, challenge=7, queue="arm-7.fifo", token="0123456789abcdef", visibility_s=0.1):
        self.challenge, self.queue, self.token = challenge, queue, token
        self.splits, self.visibility_s = splits, visibility_s
        self.lock = threading.RLock()
        self.submissions, self.messages, self.files, self.results = {}, [], {}, {}
        self.requests, self.refusals, self.statuses = [], [], {}
        self._receipts = 0
        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_port}"
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()

    def close(self):
        self._server.shutdown()
        self._server.server_close()

    # --- what people do on EvalAI ---

    def submit(self, team, phase, content, name="submission.zip"):
        """Whoever is in `team` (number, name) submits a file; returns the submission's number."""
        with self.lock:
            number = max(self.submissions, default=100) + 1
            self.files[f"/media/submission_{number}/{name}"] = content
            self._add(number, team, phase, f"{self.url}/media/submission_{number}/{name}")
            return number

    def _add(self, number, team, phase, file):
        self.submissions[number] = {
            "id": number, "participant_team": team[0], "participant_team_name": team[1], "challenge_phase": phase,
            "status": "submitted", "input_file": file, "stdout_file": None, "stderr_file": None,
            "started_at": None, "completed_at": None, "method_name": "", "job_name": []}
        self.statuses[number] = ["submitted"]
        self.send(number)

    def send(self, number):
        self.messages.append({"at": 0.0, "receipt": None, "body": {
            "challenge_pk": self.challenge, "phase_pk": self.submissions[number]["challenge_phase"],
            "submission_pk": number, "is_static_dataset_code_upload_submission": False}})

    def set_status(self, number, status):
        self.submissions[number]["status"] = status
        self.statuses[number].append(status)

    def rerun(self, number):
        """As its host's button does: the old one is cancelled, and a new one has its file."""
        with self.lock:
            old = self.submissions[number]
            self.set_status(number, "cancelled")
            new = max(self.submissions) + 1
            self._add(new, (old["participant_team"], old["participant_team_name"]), old["challenge_phase"],
                      old["input_file"])
            return new

    def resume(self, number):
        with self.lock:
            self.set_status(number, "resuming")
            self.send(number)

    def leaderboard(self, phase, split):
        """Teams with their results in its order: of equal scores the newest first, of each team the best."""
        label = self.splits[phase][split]["default_order_by"]
        rows, seen = [], set()
        found = [(number, result) for (number, of), result in self.results.items() if of == split
                 and self.submissions[number]["challenge_phase"] == phase
                 and self.submissions[number]["status"] == "finished"]
        for number, result in sorted(sorted(found, reverse=True), key=lambda row: row[1].get(label, 0), reverse=True):
            team = self.submissions[number]["participant_team_name"]
            if team not in seen:
                seen.add(team)
                rows.append((team, result))
        return rows

    @contextlib.contextmanager
    def refusing(self, pattern, status, body, **headers):
        """Answers requests whose method and path fit so; a body that is no object is sent as HTML."""
        rule = (re.compile(pattern), Refusal(status, body, **headers))
        self.refusals.append(rule)
        try:
            yield
        finally:
            self.refusals.remove(rule)

    # --- what a worker asks ---

    def answer(self, method, path, query, body, authorization):
        with self.lock:
            self.requests.append((method, path, body))
            for pattern, refusal in self.refusals:
                if pattern.search(f"{method} {path}"):
                    raise refusal
            if path.startswith("/media/"):
                if authorization:
                    raise Refusal(400, "<Error>a token is not for the files' host</Error>")
                if path not in self.files:
                    raise Refusal(404, "<h1>Not Found</h1>")
                return self.files[path]
            if not authorization:
                raise Refusal(401, {"detail": "Authentication credentials were not provided."})
            if authorization != f"Token {self.token}":
                raise Refusal(401, {"detail": "Token has expired"})
            for wanted, pattern, handler in (
                    ("GET", r"/api/jobs/challenge/queues/([\w.-]+)/", self._receive),
                    ("POST", r"/api/jobs/queues/([\w.-]+)/", self._delete),
                    ("GET", r"/api/jobs/submission/(\d+)", self._get),
                    ("GET", r"/api/jobs/challenge/(\d+)/submission/", self._list),
                    ("PATCH", r"/api/jobs/challenge/(\d+)/update_submission/", self._patch),
                    ("PUT", r"/api/jobs/challenge/(\d+)/update_submission/", self._put),
                    ("GET", r"/api/challenges/(\d+)/challenge_phase_split", self._splits)):
                if wanted == method and (found := re.fullmatch(pattern, path)):
                    return handler(found[1], query if method == "GET" else body)
            raise Refusal(404, "<h1>Not Found</h1>")

    def _known(self, number):
        if int(number) not in self.submissions:
            raise Refusal(404, {"detail": f"Submission {number} does not exist"})
        return self.submissions[int(number)]

    def _receive(self, queue, _):
        if queue != self.queue:
            raise Refusal(400, {"error": f"Challenge with queue name {queue} does not exist"})
        now = time.monotonic()
        for message in self.messages:
            if message["at"] <= now:
                self._receipts += 1
                message.update(at=now + self.visibility_s, receipt=f"receipt-{self._receipts}")
                self.messages.sort(key=lambda message: message["at"])
                return {"body": message["body"], "receipt_handle": message["receipt"]}
        return {"body": None, "receipt_handle": None}

    def _delete(self, queue, body):
        found = [message for message in self.messages if message["receipt"] == body["receipt_handle"]]
        if not found or found[0]["at"] < time.monotonic():
            # EvalAI puts the exception itself into the answer, which can't be written as JSON.
            raise Refusal(500, "<h1>Server Error (500)</h1>")
        self.messages.remove(found[0])
        return {"success": f"Message deleted successfully from the queue: {queue}"}

    def _get(self, number, _):
        if int(number) not in self.submissions:
            raise Refusal(404, {"error": f"Submission {number} does not exist"})
        return self.submissions[int(number)]

    def _list(self, _, query):
        status = query.get("status")
        if status not in STATUSES:
            raise Refusal(400, {"error": f"Invalid submission status {status}"})
        return [found for found in self.submissions.values() if found["status"] == status]

    def _patch(self, _, body):
        found = self._known(body["submission"])
        if body.get("submission_status", "").lower() not in ("queued", "running"):
            raise Refusal(400, {"error": "Sorry, submission status is invalid"})
        self.set_status(found["id"], body["submission_status"].lower())
        found["started_at"] = "2026-11-27T12:00:00Z"
        return found

    def _put(self, _, body):
        found = self._known(body.get("submission"))
        status = body.get("submission_status", "").lower()
        texts = {key: body.get(key, "").encode() for key in ("stdout", "stderr", "environment_log")}
        if status not in ("failed", "cancelled", "finished"):
            raise Refusal(400, {"error": "Sorry, submission status is invalid"})
        shown = []
        if status == "finished":
            try:
                results = json.loads(body.get("result", ""))
            except (ValueError, TypeError) as error:
                raise Refusal(400, {"error": f"`result` key contains invalid data with error {error}."}) from error
            for result in results:
                schema = self.splits.get(int(body["challenge_phase"]), {}).get(result.get("split"))
                if schema is None:
                    raise Refusal(400, {"error": "Challenge Phase Split does not exist with phase_id: "
                                        f"{body['challenge_phase']} andsplit codename: {result.get('split')}"})
                missing = [label for label in result["accuracies"] if label not in schema["labels"]]
                if missing:
                    raise Refusal(400, {"error": f"Following metrics are missing in theleaderboard data: {missing}"})
                if [value for value in result["accuracies"].values() if not isinstance(value, (int, float))]:
                    raise Refusal(400, {"error": "Values for following metrics are not offloat/int: []"})
            for result in results:
                self.results[found["id"], result["split"]] = result["accuracies"]
                if result.get("show_to_participant", False):
                    shown.append(result["accuracies"])
        self.set_status(found["id"], status)
        found.update(stdout_file=texts["stdout"].decode(), stderr_file=texts["stderr"].decode(),
                     submission_result_file=str(shown), metadata=str(body.get("metadata", "")),
                     completed_at="2026-11-27T12:00:01Z")
        return {"success": "Submission result has been successfully updated"}

    def _splits(self, _, __):
        return [{"id": place, "challenge_phase": phase, "dataset_split_name": name, "visibility": 3,
                 "leaderboard_schema": schema}
                for place, (phase, name, schema) in enumerate(
                    (phase, name, schema) for phase, splits in self.splits.items()
                    for name, schema in splits.items())]

    def _handler(self):
        evalai = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def _any(self):
                parts = urllib.parse.urlsplit(self.path)
                text = self.rfile.read(int(self.headers.get("Content-Length") or 0))
                headers = {}
                try:
                    status, answer = 200, evalai.answer(
                        self.command, urllib.parse.unquote(parts.path), dict(urllib.parse.parse_qsl(parts.query)),
                        json.loads(text) if text else {}, self.headers.get("Authorization"))
                except Refusal as refusal:
                    status, answer, headers = refusal.status, refusal.body, refusal.headers
                kind = "application/json"
                if isinstance(answer, str):
                    answer, kind = answer.encode(), "text/html"
                elif not isinstance(answer, bytes):
                    answer = json.dumps(answer).encode()
                self.send_response(status)
                for name, value in {"Content-Type": kind, "Content-Length": len(answer), **headers}.items():
                    self.send_header(name.replace("_", "-"), str(value))
                self.end_headers()
                with contextlib.suppress(ConnectionError):
                    self.wfile.write(answer)

            do_GET = do_POST = do_PUT = do_PATCH = _any

            def log_message(self, *_):
                pass

        return Handler
