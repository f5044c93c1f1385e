"""The daemon's door to the network: TLS, its certificate, and plain HTTP behind a proxy."""

import contextlib
import gzip
import http.client
import json
import shutil
import signal
import socket
import sqlite3
import ssl
import subprocess
import time
import unittest

from daemon_test import BIN, DaemonCase
from support import client
from support.certificates import make_certificate
from support.submission import played_by_stand_in
from support.waiting import wait_until

TIMEOUT_S = 60


class NetworkCase(DaemonCase):
    listen = {"address": "127.0.0.1", "port": 0}

    def configure(self, **changes):
        changes.setdefault("http", {"listen": self.door()})
        super().configure(**changes)

    def door(self):
        """`listen` of server.json."""
        return self.listen

    @property
    def url(self):
        return (self.data / "listen").read_text().strip()

    @property
    def port(self):
        return int(self.url.rsplit(":", 1)[1])

    def exit_of(self, listen):
        """Exit status and last words of a daemon that can't start."""
        super().configure(http={"listen": listen})
        process = self.daemon.launch()
        self.addCleanup(process.kill)
        status = process.wait(TIMEOUT_S)
        # The check of the reference episodes runs beside it and may log something later.
        words = [line for line in self.daemon.log().splitlines() if "reference episodes" not in line]
        return status, words[-1]


class TlsTest(NetworkCase):
    def door(self):
        certificate, key = make_certificate(self.folder)
        return {**self.listen, "certificate": str(certificate), "key": str(key)}

    def context(self, certificate="server.pem"):
        return ssl.create_default_context(cafile=self.folder / certificate)

    def connection(self, certificate="server.pem"):
        made = http.client.HTTPSConnection("127.0.0.1", self.port, timeout=TIMEOUT_S,
                                           context=self.context(certificate))
        self.addCleanup(made.close)
        return made

    def fetch(self, path, made=None):
        status, text = client.exchange(made or self.connection(), "GET", path)
        self.assertEqual(status, 200, text)
        return json.loads(text)

    def test_what_everybody_may_read_is_read_over_tls(self):
        self.assertTrue(self.url.startswith("https://127.0.0.1:"), self.url)
        made = self.connection()
        for _ in range(2):  # of one connection
            self.assertEqual(self.fetch("/v1/health", made)["status"], "ok")
        track = self.fetch("/v1/tracks")["tracks"][0]["track"]
        self.assertEqual(self.fetch(f"/v1/leaderboard?track={track}")["track"], track)
        who = self.fetch("/v1/whoami")
        self.assertEqual((who["role"], who["caller"], who["remote"], who["token"], who["teams"]),
                         ("public", "address 127.0.0.1", True, None, []))
        self.assertEqual(self.get("/v1/whoami")["role"], "operator")
        self.assertFalse(self.get("/v1/whoami")["remote"])
        done = self.daemon.run_verb("whoami", "--server", self.url, "--ca-file",
                                    self.folder / "server.pem", "--json", text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(json.loads(done.stdout)["server"], self.url)

    def myograde(self, *words, typed="", status=0):
        """What a participant's tool prints who has no folder of the daemon's."""
        environment = {name: value for name, value in self.daemon.environment.items()
                       if name != "MYOGRADE_DATA"}
        done = subprocess.run([BIN / "myograde", *map(str, words)], input=typed, text=True,
                              capture_output=True, timeout=TIMEOUT_S, check=False,
                              env={**environment, "XDG_CONFIG_HOME": str(self.folder / "config")})
        self.assertEqual(done.returncode, status, done.stderr)
        return done.stdout if status == 0 else done.stderr

    def test_a_participant_logs_in_and_submits_over_the_network(self):
        def post(path, body):
            status, answer = self.call("POST", path, body, "application/json")
            self.assertIn(status, (200, 201), answer)
            return answer
        post("/v1/teams", {"team": "alpha"})
        token = post("/v1/tokens", {"role": "participant", "team": "alpha", "label": "laptop"})
        login = ("login", self.url, "--ca-file", self.folder / "server.pem")
        self.assertIn("bad_token", json.dumps(self.call_with("nonsense")))
        self.myograde(*login, typed="nonsense\n", status=2)
        self.assertIn("a participant of alpha", self.myograde(*login, typed=token["token"] + "\n"))
        policy = self.folder / "policy.tar"
        policy.write_bytes(played_by_stand_in("ok"))
        answer = json.loads(self.myograde("submit", policy, "--track", "demo-manipulation", "--team",
                                          "alpha", "--wait", "--json"))
        self.assertEqual((answer["state"], answer["team"]), ("done", "alpha"))
        receipt = self.folder / "receipt.json"
        self.myograde("proof", "receipt", answer["submission"], "-o", receipt)
        self.assertEqual(json.loads(receipt.read_text())["receipt"]["submission"],
                         answer["submission"])
        with contextlib.closing(sqlite3.connect(self.data / "store.db")) as store:
            store.execute("BEGIN IMMEDIATE")
            rerun = ("POST", f"/v1/submissions/{answer['submission']}/rerun", {})
            status, told = self.call(*rerun, "application/json")
            self.assertIn(str(self.data), told["error"]["message"])
            self.assertEqual((status, told["error"]["code"]), (503, "store"))
            told = self.call_with(token["token"], *rerun)
            self.assertEqual(told["error"]["code"], "store")
            self.assertNotIn(str(self.data), told["error"]["message"])
            store.rollback()
        wait_until(lambda: self.call("GET", "/v1/health")[1]["status"] == "ok", TIMEOUT_S,
                   "the store stays in trouble")
        post(f"/v1/tokens/{token['id']}/revoke", {})
        self.assertIn("token", self.myograde("status", answer["submission"], status=2))
        self.assertIn("alpha", self.myograde("leaderboard", "--track", "demo-manipulation"))

    def call_with(self, token, method="GET", path="/v1/whoami", body=None):
        made = self.connection()
        made.request(method, path, None if body is None else json.dumps(body),
                     {"Authorization": f"Bearer {token}"})
        return json.loads(made.getresponse().read())

    def test_only_modern_tls_is_spoken(self):
        for version in (ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3):
            context = self.context()
            context.minimum_version = context.maximum_version = version
            with socket.create_connection(("127.0.0.1", self.port), TIMEOUT_S) as plain:
                with context.wrap_socket(plain, server_hostname="localhost") as secure:
                    self.assertIn(secure.cipher()[0].split("_")[0].split("-")[0], ("TLS", "ECDHE"))
        with socket.create_connection(("127.0.0.1", self.port), TIMEOUT_S) as plain:
            plain.sendall(b"GET /v1/health HTTP/1.1\r\nHost: x\r\n\r\n")
            answer = b"".join(iter(lambda: plain.recv(4096), b""))
            self.assertIn(b"write https://", answer)

    def test_a_crowd_of_one_address_leaves_room_for_others(self):
        with contextlib.ExitStack() as stack:
            for number in range(150):
                silent = socket.create_connection(("127.0.0.1", self.port), TIMEOUT_S)
                stack.enter_context(contextlib.closing(silent))
                with contextlib.suppress(OSError):
                    silent.sendall((b"", b"\x16\x03\x01", bytes(100))[number % 3])
            self.assertEqual(self.get("/v1/health")["status"], "ok")
        self.assertEqual(self.fetch("/v1/health")["status"], "ok")

    def test_sighup_takes_a_new_certificate_and_keeps_the_old_one_from_a_bad_pair(self):
        before = self.connection()
        self.fetch("/v1/health", before)
        shutil.copy(self.folder / "server.pem", self.folder / "first.pem")
        # A pair of which only one half has been replaced.
        make_certificate(self.folder, "new")
        shutil.copy(self.folder / "new.pem", self.folder / "server.pem")
        self.daemon.process.send_signal(signal.SIGHUP)
        wait_until(lambda: "the certificate stays as it was" in self.daemon.log(), TIMEOUT_S,
                   "the half pair is refused")
        self.assertIn("is not the key of the certificate", self.daemon.log())
        self.fetch("/v1/health", self.connection("first.pem"))
        (self.folder / "server.pem").unlink()
        self.daemon.process.send_signal(signal.SIGHUP)
        wait_until(lambda: "can't be read (No such file" in self.daemon.log(), TIMEOUT_S,
                   "the missing file is noticed")
        self.fetch("/v1/health", self.connection("first.pem"))
        # And the whole pair.
        shutil.copy(self.folder / "new.pem", self.folder / "server.pem")
        shutil.copy(self.folder / "new.key", self.folder / "server.key")
        self.daemon.process.send_signal(signal.SIGHUP)
        wait_until(lambda: "this certificate is used from now on" in self.daemon.log(), TIMEOUT_S,
                   "the new pair is taken")
        self.fetch("/v1/health", self.connection("new.pem"))
        with self.assertRaises(ssl.SSLError):
            self.fetch("/v1/health", self.connection("first.pem"))
        self.fetch("/v1/health", before)  # connections stay what they are

    def test_it_comes_back_to_its_port_and_leaves_no_address_behind(self):
        self.fetch("/v1/health")
        port = self.port
        self.stop(signal.SIGTERM)
        self.assertFalse((self.data / "listen").exists())
        super(NetworkCase, self).configure(http={"listen": {**self.door(), "port": port}})
        self.start()
        self.assertEqual(self.port, port)
        self.fetch("/v1/health")

    def test_mistakes_are_found_at_the_start(self):
        port = self.port
        good = self.door()
        make_certificate(self.folder, "other")
        for change, status, sentence in (
                ({"certificate": str(self.folder / "none.pem")}, 2, "none.pem: the certificate can't"),
                ({"key": str(self.folder / "none.key")}, 2, "none.key: the key can't be read"),
                ({"key": str(self.folder / "other.key")}, 2, "is not the key of the certificate"),
                ({"key": None}, 2, '"key" is missing'),
                ({"certificate": None, "key": None, "address": "0.0.0.0"}, 2, "without TLS the daemon listens only"),
                ({"address": "localhost"}, 2, "must be an IP address"),
                ({"address": "0.0.0.0", "behind_proxy": True}, 2, '"behind_proxy" is for a proxy')):
            found, words = self.exit_of({**good, **change})
            self.assertEqual(found, status, words)
            self.assertIn(sentence, words)
        self.daemon.data = self.folder / "second"
        found, words = self.exit_of({**good, "port": port})
        self.assertEqual(found, 4, words)
        self.assertIn("another program listens there", words)

    def test_an_expired_certificate_is_a_warning(self):
        self.stop(signal.SIGTERM)
        make_certificate(self.folder, expired=True)
        self.start()
        self.assertIn("the certificate has expired", self.daemon.log())


class PlainHttpTest(NetworkCase):
    """What RFC 9110 and 9112 ask of a server, at the socket."""

    def exchange(self, target, headers=(("Host", "localhost"),), version="1.1", method="GET"):
        """(status, headers in lower case, body) of one request on a connection of its own."""
        head = "".join(f"{name}: {value}\r\n" for name, value in (*headers, ("Connection", "close")))
        with socket.create_connection(("127.0.0.1", self.port), timeout=TIMEOUT_S) as made:
            made.sendall(f"{method} {target} HTTP/{version}\r\n{head}\r\n".encode())
            data = b"".join(iter(lambda: made.recv(65536), b""))
        top, _, body = data.partition(b"\r\n\r\n")
        lines = top.decode().split("\r\n")
        told = dict(line.lower().split(": ", 1) for line in lines[1:])
        return int(lines[0].split()[1]), told, body

    def taking(self, *codings):
        return (("Host", "localhost"), *(("Accept-Encoding", coding) for coding in codings))

    def test_a_request_names_its_host_once(self):
        for hosts in ((), ("localhost", "localhost"), ("local host",), ("a/b",), ("localhost:x",)):
            status, _, body = self.exchange("/v1/health", [("Host", host) for host in hosts])
            self.assertEqual(status, 400, (hosts, body))
        self.assertEqual(self.exchange("/v1/health", (), "1.0")[0], 200)

    def test_a_name_of_another_site_does_not_lead_to_this_host(self):
        for host in ("localhost", "localhost.", f"127.0.0.1:{self.port}", f"[::1]:{self.port}", "LOCALHOST:1",
                     "grader.localhost"):
            self.assertEqual(self.exchange("/v1/health", (("Host", host),))[0], 200, host)
        for host in ("rebound.example", "localhost.example", "127.0.0.1.example", "10.0.0.1", "0.0.0.0"):
            status, _, body = self.exchange("/v1/health", (("Host", host),))
            self.assertEqual(status, 421, host)
            self.assertIn(host, json.loads(body)["error"]["message"])

    def test_a_query_may_have_question_marks(self):
        for target in ("/sign-in?to=/a?b", "/board?track=x?&a=?"):
            self.assertEqual(self.exchange(target)[0], 200, target)

    def test_nothing_is_promised_of_a_connection_that_is_not_so(self):
        with socket.create_connection(("127.0.0.1", self.port), timeout=TIMEOUT_S) as made:
            for _ in range(8):
                made.sendall(b"GET /v1/health HTTP/1.1\r\nHost: localhost\r\n\r\n")
                data = b""
                while b"\r\n\r\n" not in data:
                    data += made.recv(65536)
                self.assertTrue(data.startswith(b"HTTP/1.1 200"), data)
                self.assertNotIn(b"keep-alive:", data.lower())

    def test_codings_are_negotiated(self):
        for path in ("/", "/web/main.js", "/docs/"):
            plain = self.exchange(path)
            if plain[0] != 200:
                continue  # the documents are not built here
            self.assertNotIn("content-encoding", plain[1])
            for codings, packed in (
                    (("gzip",), True), (("GZIP;q=0.5",), True), (("br, gzip;q=1.000",), True), (("*",), True),
                    (("x-gzip",), True), (("br", "gzip"), True), (("identity;q=0, *;q=0.1",), True),
                    (("br",), False), (("gzip;q=0",), False), (("gzip; Q=0.000",), False),
                    (("*;q=0",), False), (("gzip;q=0, *",), False), (("x-brotli",), False),
                    (("abracadabra",), False), (("gzip;q=2",), False), (("gzip;q=nan",), False),
                    (("gzip;q=0.3, identity;q=0.8",), False), (("",), False)):
                status, told, body = self.exchange(path, self.taking(*codings))
                self.assertEqual((status, told.get("content-encoding")), (200, "gzip" if packed else None),
                                 (path, codings))
                self.assertEqual(gzip.decompress(body) if packed else body, plain[2])
                self.assertIn("accept-encoding", told["vary"])
                self.assertEqual(told["etag"] == plain[1]["etag"], not packed, codings)
                status, again, body = self.exchange(path, (*self.taking(*codings),
                                                           ("If-None-Match", told["etag"])))
                self.assertEqual((status, body, again["etag"]), (304, b"", told["etag"]))

    def test_an_answer_of_the_api_costs_no_compression(self):
        for path in ("/v1/openapi.json", "/v1/tracks", "/v1/health"):
            status, told, body = self.exchange(path, self.taking("gzip, deflate, br, zstd"))
            self.assertEqual((status, told.get("content-encoding")), (200, None))
            json.loads(body)


    def uploads(self, stack, requests, *headers):
        """560 connections from 40 addresses that announce a body and send none of it; the last one."""
        for number in range(560):
            made = stack.enter_context(contextlib.closing(socket.create_connection(
                ("127.0.0.1", self.port), timeout=TIMEOUT_S,
                source_address=(f"127.0.1.{1 + number % 40}", 0))))
            lines = (f"{requests[number % len(requests)]} HTTP/1.1", "Host: localhost",
                     "Content-Type: application/x-tar", "Content-Length: 600",
                     *headers[number % max(len(headers), 1):][:1], "", "x")
            made.sendall("\r\n".join(lines).encode())
        return made

    def test_uploads_to_nowhere_are_refused_before_they_come(self):
        with contextlib.ExitStack() as stack:
            last = self.uploads(stack, ("POST /v1/nothing", "PUT /v1/artefacts", "POST /sign-in",
                                        "POST /v1/artefacts"))
            self.assertRegex(last.recv(65536), rb"HTTP/1.1 (401|404|405|429) ")
            begun = time.monotonic()
            self.assertEqual(self.exchange("/v1/health")[0], 200)
            self.assertLess(time.monotonic() - begun, 10)

    def test_uploads_of_one_team_leave_room_for_others(self):
        self.assertEqual(self.call("POST", "/v1/teams", {"team": "alpha"}, "application/json")[0], 201)
        tokens = []
        for label in ("one", "two"):
            status, answer = self.call("POST", "/v1/tokens", {"role": "participant", "team": "alpha",
                                                              "label": label}, "application/json")
            self.assertEqual(status, 201, answer)
            tokens.append(answer["token"])
        with contextlib.ExitStack() as stack:
            last = self.uploads(stack, ("POST /v1/artefacts?team=alpha",),
                                *(f"Authorization: Bearer {token}" for token in tokens))
            self.assertIn(b"your team has too many uploads", last.recv(65536))
            for _ in range(3):
                begun = time.monotonic()
                self.assertEqual(self.exchange("/v1/health")[0], 200)
                self.assertLess(time.monotonic() - begun, 10)  # it was 30 s, and then a 429


class ProxyTest(NetworkCase):
    listen = {"address": "127.0.0.1", "port": 0, "behind_proxy": True}

    def caller(self, **headers):
        made = http.client.HTTPConnection("127.0.0.1", self.port, timeout=TIMEOUT_S)
        self.addCleanup(made.close)
        made.request("GET", "/v1/whoami", headers=headers)
        return json.loads(made.getresponse().read())["caller"]

    def test_a_proxy_says_whose_requests_it_forwards(self):
        self.assertTrue(self.url.startswith("http://127.0.0.1:"), self.url)
        self.assertEqual(self.caller(), "address 127.0.0.1")
        self.assertEqual(self.caller(**{"X-Forwarded-For": "1.1.1.1, 192.0.2.7"}),
                         "address 192.0.2.7")
        self.assertEqual(self.caller(**{"X-Forwarded-For": "2001:db8::7"}), "address 2001:db8::/64")

    def test_without_one_nobody_does(self):
        self.stop(signal.SIGTERM)
        super(NetworkCase, self).configure(http={"listen": {**self.listen, "behind_proxy": False}})
        self.start()
        self.assertEqual(self.caller(**{"X-Forwarded-For": "192.0.2.7"}), "address 127.0.0.1")


if __name__ == "__main__":
    unittest.main(verbosity=2)
