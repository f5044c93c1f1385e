"""A request with an Idempotency-Key takes effect once, and the command line tool sends one."""

import concurrent.futures
import json
import socket
import socketserver
import threading
import unittest

from support import submission
from support.client import Connection
from support.waiting import wait_until
from world import TRACK, World

CLIENTS = 12


class LossyDoor(socketserver.ThreadingMixIn, socketserver.UnixStreamServer):
    """Hands requests on to the daemon's socket, and hangs up in place of the first answer to a POST
    of a submission or a rerun."""

    daemon_threads = True

    def __init__(self, path, daemon):
        self.daemon = str(daemon)
        self.lost = []
        super().__init__(str(path), LossyPassage)

    def handle_error(self, request, client_address):
        pass  # somebody hung up


class LossyPassage(socketserver.BaseRequestHandler):
    def handle(self):
        head = b""
        while b"\r\n\r\n" not in head:
            head += self.request.recv(1 << 16)
        head, _, body = head.partition(b"\r\n\r\n")
        lines = head.decode().split("\r\n")
        length = next((int(line.split(":")[1]) for line in lines
                       if line.lower().startswith("content-length:")), 0)
        while len(body) < length:
            body += self.request.recv(1 << 16)
        with socket.socket(socket.AF_UNIX) as daemon:
            daemon.connect(self.server.daemon)
            lines.insert(1, "Connection: close")
            daemon.sendall("\r\n".join(lines).encode() + b"\r\n\r\n" + body)
            answer = b"".join(iter(lambda: daemon.recv(1 << 16), b""))
        method, path = lines[0].split()[:2]
        if method == "POST" and path.endswith(("/submissions", "/rerun")) and \
                path not in self.server.lost:
            self.server.lost.append(path)
            return
        self.request.sendall(answer)


class RequestKeys(unittest.TestCase):
    def setUp(self):
        self.world = World()
        self.addCleanup(self.world.close)
        self.world.start()
        self.body = {"artefact": self.world.upload("more"), "team": "alpha", "track": TRACK,
                     "episodes": 2}

    def post(self, path, body, *keys, token=None):
        connection = Connection(self.world.socket_path)
        try:
            text = json.dumps(body).encode()
            connection.putrequest("POST", path)
            connection.putheader("Content-Length", str(len(text)))
            for key in keys:
                connection.putheader("Idempotency-Key", key)
            if token:
                connection.putheader("Authorization", f"Bearer {token}")
            connection.endheaders(text)
            answer = connection.getresponse()
            return answer.status, json.loads(answer.read())
        finally:
            connection.close()

    def count(self):
        return len(self.world.get("/v1/submissions")["submissions"])

    def test_of_many_at_once_one_is_accepted(self):
        before = self.count()
        with concurrent.futures.ThreadPoolExecutor(CLIENTS) as clients:
            answers = list(clients.map(lambda _: self.post("/v1/submissions", self.body, "key"),
                                       range(CLIENTS)))
        self.assertEqual(sorted(status for status, _ in answers), [200] * (CLIENTS - 1) + [201])
        self.assertEqual(len({answer["submission"] for _, answer in answers}), 1)
        for status, answer in answers:
            self.assertEqual((answer["repeated"], answer["linked"]), (status == 200, False))
        self.assertEqual(self.count(), before + 1)

    def test_the_key_belongs_to_the_request_and_the_caller(self):
        made = self.post("/v1/submissions", self.body, "key")[1]["submission"]
        status, answer = self.post("/v1/submissions", {**self.body, "episodes": 1}, "key")
        self.assertEqual((status, answer["error"]["code"]), (422, "idempotency_mismatch"))
        self.assertIn(str(made), answer["error"]["message"])
        status, answer = self.post(f"/v1/submissions/{made}/rerun", {}, "key")
        self.assertEqual((status, answer["error"]["code"]), (422, "idempotency_mismatch"))
        status, answer = self.post("/v1/submissions", self.body, "key",
                                   token=self.world.tokens["participant"])
        self.assertEqual((status, answer["repeated"]), (201, False))
        self.assertNotEqual(answer["submission"], made)

    def test_it_is_answered_when_it_would_not_be_accepted_any_more(self):
        made = self.post("/v1/submissions", self.body, "key")[1]["submission"]
        self.world.post("/v1/pause", {"reason": "a break"})
        status, answer = self.post("/v1/submissions", self.body, "another-key")
        self.assertEqual(status, 409, answer)
        status, answer = self.post("/v1/submissions", self.body, "key")
        self.assertEqual((status, answer["submission"], answer["repeated"]), (200, made, True))

    def test_it_survives_a_restart(self):
        made = self.post("/v1/submissions", self.body, "key")[1]["submission"]
        self.world.restart_plain()
        status, answer = self.post("/v1/submissions", self.body, "key")
        self.assertEqual((status, answer["submission"], answer["repeated"]), (200, made, True))

    def test_a_refused_request_may_be_corrected(self):
        wrong = {**self.body, "artefact": "f" * 64}
        self.assertEqual(self.post("/v1/submissions", wrong, "key")[0], 404)
        self.assertEqual(self.post("/v1/submissions", self.body, "key")[0], 201)

    def test_a_rerun_is_started_once(self):
        path = f"/v1/submissions/{self.world.submissions[0]}/rerun"
        status, first = self.post(path, {"first": 0, "last": 0}, "key")
        self.assertEqual((status, first["repeated"]), (201, False))
        status, again = self.post(path, {"first": 0, "last": 0}, "key")
        self.assertEqual((status, again["repeated"], again["evaluation"]),
                         (200, True, first["evaluation"]))
        self.assertEqual((again["first"], again["last"]), (first["first"], first["last"]))

    def test_a_malformed_key_is_refused(self):
        for keys in (("a b",), ("k" * 256,), ("k\u00e4",), ("a", "b")):
            status, answer = self.post("/v1/submissions", self.body, *keys)
            self.assertEqual((status, answer["error"]["code"]), (400, "bad_request"), keys)
            self.assertIn("Idempotency-Key", answer["error"]["message"])

    def test_the_command_line_tool_asks_again_when_an_answer_is_lost(self):
        folder = self.world.root / "policy.tar"
        folder.write_bytes(submission.played_by_stand_in("ok", "sent twice"))
        door = LossyDoor(self.world.root / "lossy.sock", self.world.socket_path)
        threading.Thread(target=door.serve_forever, daemon=True).start()
        self.addCleanup(door.server_close)
        self.addCleanup(door.shutdown)
        before = self.count()
        answer = self.world.ask("submit", folder, "--team", "alpha", "--track", TRACK,
                                "--socket", door.server_address)
        self.assertEqual(door.lost, ["/v1/submissions"])
        self.assertEqual((answer["repeated"], answer["linked"]), (True, False))
        self.assertEqual(self.count(), before + 1)
        number = answer["submission"]
        wait_until(lambda: self.world.get(f"/v1/submissions/{number}"), 60, "it does not end",
                   fits=lambda status: status["state"] == "done")
        rerun = self.world.ask("rerun", number, "--no-wait", "--socket", door.server_address)
        self.assertTrue(rerun["repeated"])
        evaluations = self.world.get(f"/v1/submissions/{number}")["evaluations"]
        self.assertEqual([one["kind"] for one in evaluations], ["original", "rerun"])


if __name__ == "__main__":
    unittest.main(verbosity=2)
