"""Which daemon verbs speak to, and what they show it: servers over the network, logins and tokens.
usage: server_test.py BIN_DIR SOURCE_DIR"""
import grp
import http.server
import json
import os
import pty
import socket
import socketserver
import ssl
import stat
import subprocess
import sys
import threading
import unittest

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
from cli_case import (  # pylint: disable=wrong-import-position
    BIN_DIR, SOURCE_DIR, STATUS, CliCase, Handler, validate)
from support.certificates import make_certificate  # pylint: disable=wrong-import-position

TOKEN = "myt_0123456789abcdef"
WHO = {"role": "participant", "teams": ["alpha"], "caller": "token 3", "remote": True,
       "token": {"id": 3, "label": "laptop", "expires_at": "2026-12-01T00:00:00.000Z"}}
OLD = ("MYOGRADE_SERVER", "MYOGRADE_TOKEN", "MYOGRADE_CA_FILE", "MYOGRADE_DATA")


class NetworkHandler(Handler):
    """Notes the tokens that it is shown, with the port that it was asked at."""
    tokens = []

    def reply(self):
        self.tokens.append((self.server.server_port, self.headers.get("Authorization")))
        super().reply()

    do_GET = do_POST = reply


class TcpServer(socketserver.ThreadingMixIn, http.server.HTTPServer):
    daemon_threads = True

    def handle_error(self, request, client_address):
        pass  # clients that don't trust the certificate hang up


@unittest.skipUnless(os.geteuid() == 0, "only root gives files to groups")
class ClosedSocketTest(CliCase):
    """A socket of the host that its user may not open."""

    def test_the_group_that_may_is_named(self):
        os.chmod(self.temp, 0o755)
        path = f"{self.temp}/myograde.sock"
        group = grp.getgrnam("games")
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(path)
            for mode, gid, words in (
                    (0o660, group.gr_gid, "is open to the group games, and nobody is not in it; .*adduser nobody games"),
                    (0o660, 0, "is open to root only; run this as root"),
                    (0o600, group.gr_gid, "is open to root only; run this as root")):
                os.chown(path, 0, gid)
                os.chmod(path, mode)
                done = subprocess.run(
                    ["setpriv", "--reuid=nobody", "--regid=nogroup", "--clear-groups", f"{BIN_DIR}/myograde",
                     "status", "--socket", path], capture_output=True, text=True, timeout=60, check=False)
                self.assertEqual(done.returncode, 3, done.stderr)
                self.assertRegex(done.stderr, words)


class ClientAloneTest(CliCase):
    """A host with the client and no programs that play."""

    def test_nobody_misses_a_file(self):
        for folder in ("bin", "configs"):
            os.mkdir(f"{self.temp}/{folder}")
        for part in ("tracks", "challenges"):
            os.symlink(f"{SOURCE_DIR}/configs/{part}", f"{self.temp}/configs/{part}")
        environment = {**os.environ, "MYOGRADE_BIN_DIR": f"{self.temp}/bin",
                       "MYOGRADE_CONFIG_DIR": f"{self.temp}/configs"}
        policy = f"{BIN_DIR}/../policies/zero"
        for words in (("local", policy, "--track", "elbow"), ("runtime", "list"), ("doctor",)):
            done = subprocess.run([f"{BIN_DIR}/myograde", *words], capture_output=True, text=True,
                                  timeout=120, check=False, env=environment, stdin=subprocess.DEVNULL)
            said = done.stdout + done.stderr
            if words[0] != "runtime":
                self.assertEqual(done.returncode, 4, said)
                self.assertIn("myograde-server", said)
            self.assertNotIn("server.json", said)


class ServerTest(CliCase):
    def setUp(self):
        super().setUp()
        self.certificate, self.key = make_certificate(self.temp)
        self.environment = {
            **{name: value for name, value in os.environ.items() if name not in OLD},
            "MYOGRADE_CONFIG_DIR": f"{SOURCE_DIR}/configs", "HOME": self.temp,
            "XDG_CONFIG_HOME": f"{self.temp}/config"}
        self.login_file = f"{self.temp}/config/myograde/login.json"
        NetworkHandler.tokens = []

    def listen(self, answers=None, certificate=None, key=None, tls=True):
        """A server; its port."""
        server = TcpServer(("127.0.0.1", 0), NetworkHandler)
        if tls:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(certificate or self.certificate, key or self.key)
            server.socket = context.wrap_socket(server.socket, server_side=True,
                                                do_handshake_on_connect=False)
        Handler.answers = answers or {"GET /v1/whoami": (200, WHO),
                                      "GET /v1/submissions/7": (200, STATUS)}
        Handler.heard = []
        threading.Thread(target=server.serve_forever, daemon=True).start()
        self.addCleanup(server.server_close)
        self.addCleanup(server.shutdown)
        return server.server_port

    def run_verb(self, *words, typed="", **environment):
        return subprocess.run([f"{BIN_DIR}/myograde", *map(str, words)], input=typed, text=True,
                              capture_output=True, timeout=60, check=False,
                              env={**self.environment, **environment})

    def done(self, *words, **more):
        result = self.run_verb(*words, **more)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertNotIn(TOKEN, result.stdout + result.stderr)
        return result.stdout

    def told(self, status, sentence, *words, **more):
        result = self.run_verb(*words, **more)
        self.assertEqual(result.returncode, status, (words, result.stderr))
        self.assertRegex(result.stderr, "^myograde: error: [^\n]*\n$")
        self.assertIn(sentence, result.stderr)
        self.assertNotIn(TOKEN, result.stdout + result.stderr)

    def log_in(self, port):
        answer = json.loads(self.done("login", f"https://localhost:{port}", "--ca-file",
                                      self.certificate, "--json", typed=TOKEN + "\n"))
        validate(answer, "login")
        return f"https://localhost:{port}"

    def shown(self):
        """What servers were shown since the last call."""
        tokens, NetworkHandler.tokens = NetworkHandler.tokens, []
        return tokens

    # --- logins ---

    def test_a_login_is_kept_for_the_verbs_after_it(self):
        port = self.listen()
        server = self.log_in(port)
        self.assertEqual(stat.S_IMODE(os.stat(self.login_file).st_mode), 0o600)
        self.assertEqual(stat.S_IMODE(os.stat(os.path.dirname(self.login_file)).st_mode), 0o700)
        self.assertEqual(os.listdir(os.path.dirname(self.login_file)), ["login.json"])
        with open(self.login_file, encoding="utf-8") as file:
            self.assertEqual(json.load(file), {"server": server, "token": TOKEN,
                                               "ca_file": str(self.certificate)})
        self.done("status", "7")
        who = json.loads(self.done("whoami", "--json"))
        validate(who, "whoami")
        self.assertEqual((who["server"], who["role"]), (server, "participant"))
        self.assertIn("a participant of alpha", self.done("whoami"))
        self.assertEqual(set(self.shown()), {(port, f"Bearer {TOKEN}")})
        out = json.loads(self.done("logout", "--json"))
        validate(out, "logout")
        self.assertEqual((out["removed"], out["server"]), (True, server))
        self.assertFalse(os.path.exists(self.login_file))
        self.assertIn("no login", self.done("logout"))
        self.told(3, "can't reach a daemon", "status", "7", XDG_DATA_HOME=self.temp,
                  **({"MYOGRADE_DATA": self.temp} if os.geteuid() == 0 else {}))

    def test_a_token_that_the_server_does_not_take_is_not_kept(self):
        for answer, sentence in (((401, {"error": {"code": "bad_token", "message": "It is revoked."}}),
                                  "It is revoked."),
                                 ((200, {**WHO, "token": None}), "ignored the token")):
            port = self.listen({"GET /v1/whoami": answer})
            self.told(2, sentence, "login", f"https://localhost:{port}", "--ca-file",
                      self.certificate, typed=TOKEN)
            self.assertFalse(os.path.exists(self.login_file))
        for typed in ("", "\n", "two words", "x" * 600, "ü"):
            self.told(2, "token", "login", f"https://localhost:{port}", typed=typed)
        self.told(2, "a login is for a server over the network", "login", "/run/myograde.sock")

    def test_nothing_shows_what_is_typed_at_a_terminal(self):
        port = self.listen()
        outer, inner = pty.openpty()
        process = subprocess.Popen(
            [f"{BIN_DIR}/myograde", "login", f"https://localhost:{port}", "--ca-file",
             self.certificate], stdin=inner, stdout=inner, stderr=inner, env=self.environment)
        os.close(inner)
        self.addCleanup(process.kill)
        text = b""
        while b"Token for" not in text:
            text += os.read(outer, 1000)
        os.write(outer, TOKEN.encode() + b"\n")
        while True:
            try:
                piece = os.read(outer, 1000)
            except OSError:  # its end
                break
            if not piece:
                break
            text += piece
        os.close(outer)
        self.assertEqual(process.wait(60), 0, text)
        self.assertNotIn(TOKEN.encode(), text)
        self.assertIn(b"you are a participant", text)

    def test_a_login_that_others_may_read_is_refused(self):
        self.log_in(self.listen())
        os.chmod(self.login_file, 0o640)
        self.told(2, "other users may read the token", "status", "7")
        for text in ("{", '{"server": 1}', "null", json.dumps({"server": "https://x"}),
                     json.dumps({"server": "ftp://x", "token": TOKEN})):
            self.path("config/myograde/login.json", text, 0o600)
            self.told(2, "login.json", "status", "7")
        self.path("config/myograde/login.json", "{", 0o644)
        self.assertIn("is removed", self.done("logout"))

    # --- which server, and who is shown the token ---

    def test_the_nearest_word_decides(self):
        port, other = self.listen(), self.listen()
        self.log_in(port)
        socket = self.serve({"GET /v1/submissions/7": (200, STATUS)})
        self.shown()
        at_other = {"MYOGRADE_SERVER": f"https://localhost:{other}",
                    "MYOGRADE_CA_FILE": str(self.certificate)}
        for words, environment, expected in (
                ((), {}, [port]), ((), at_other, [other]),
                ((), {**at_other, "MYOGRADE_DATA": self.temp}, [other]),
                (("--socket", socket), at_other, []), (("--data", self.temp), at_other, None),
                ((), {"MYOGRADE_DATA": self.temp}, None),
                (("--server", f"https://localhost:{port}"), at_other, [port]),
                (("--server", f"unix:{socket}"), at_other, []), (("--server", socket), {}, [])):
            with self.subTest(words=words, environment=environment):
                if expected is None:
                    self.told(3, "there is no socket", "status", "7", *words, **environment)
                else:
                    self.done("status", "7", *words, **environment)
                self.assertEqual([p for p, _ in self.shown()], expected or [])
        self.told(2, "--socket excludes --server", "status", "7", "--server", socket, "--socket",
                  socket)

    def test_a_token_goes_to_its_own_server_alone(self):
        port, other = self.listen(), self.listen()
        self.log_in(port)
        self.shown()
        trust = ("--ca-file", self.certificate)
        self.done("status", "7", "--server", f"https://localhost:{other}", *trust)
        self.assertEqual(self.shown(), [(other, None)])
        # The same host under another name is another server to whoever trusts names.
        self.done("status", "7", "--server", f"https://127.0.0.1:{port}", *trust)
        self.assertEqual(self.shown(), [(port, None)])
        self.done("status", "7", "--server", f"https://LOCALHOST:{port}/", *trust)
        self.assertEqual(self.shown(), [(port, f"Bearer {TOKEN}")])
        self.done("status", "7", MYOGRADE_TOKEN="another")
        self.assertEqual(self.shown(), [(port, "Bearer another")])
        self.done("status", "7", "--server", f"https://localhost:{other}", *trust,
                  MYOGRADE_TOKEN="another", MYOGRADE_SERVER=f"https://localhost:{port}")
        self.assertEqual(self.shown(), [(other, None)])
        self.told(2, "MYOGRADE_TOKEN: not a token", "status", "7", MYOGRADE_TOKEN="a\nb: c")

    def test_redirections_are_not_followed(self):
        class Away(NetworkHandler):
            def reply(self):
                self.tokens.append((self.server.server_port, self.headers.get("Authorization")))
                self.send_response(302)
                self.send_header("Location", f"https://localhost:{other}/v1/submissions/7")
                self.send_header("Content-Length", "0")
                self.end_headers()
            do_GET = do_POST = reply

        other, port = self.listen(), self.listen()
        self.log_in(port)
        self.shown()
        elsewhere = TcpServer(("127.0.0.1", 0), Away)
        threading.Thread(target=elsewhere.serve_forever, daemon=True).start()
        self.addCleanup(elsewhere.server_close)
        self.addCleanup(elsewhere.shutdown)
        self.told(4, "redirects requests", "status", "7", "--server",
                  f"http://127.0.0.1:{elsewhere.server_port}", MYOGRADE_TOKEN=TOKEN)
        self.assertEqual(self.shown(), [(elsewhere.server_port, f"Bearer {TOKEN}")])

    # --- what a certificate must be ---

    def test_certificates_that_are_not_trusted(self):
        def status(port, *words, host="localhost"):
            return ("status", "7", "--server", f"https://{host}:{port}", *words)
        port = self.listen()
        trust = ("--ca-file", self.certificate)
        self.told(3, "is not signed by an authority that this host trusts", *status(port))
        other, _ = make_certificate(self.temp, "other")
        self.told(3, f"is not signed by an authority in {other}", *status(port, "--ca-file", other))
        self.told(2, "can't be read (No such file", *status(port, "--ca-file", f"{self.temp}/none"))
        empty = self.path("empty.pem", "no certificates\n")
        self.told(3, "has no PEM certificates", *status(port, "--ca-file", empty))
        old, old_key = make_certificate(self.temp, "old", expired=True)
        self.told(3, "has expired", *status(self.listen(certificate=old, key=old_key), "--ca-file", old))
        named, named_key = make_certificate(self.temp, "named", hosts=("DNS:grader.example.org",))
        for host in ("localhost", "127.0.0.1"):
            self.told(3, f"is not for {host}", *status(
                self.listen(certificate=named, key=named_key), "--ca-file", named, host=host))
        self.told(3, "can't make a TLS connection", *status(self.listen(tls=False), *trust))
        self.assertEqual(self.shown(), [])
        self.done(*status(port, *trust))
        self.done(*status(port), SSL_CERT_FILE=str(self.certificate))

    def test_addresses_that_are_none(self):
        for text, sentence in (
                ("http://grader.example.org", "is without TLS"), ("ftp://x", "not a server's address"),
                ("https://", "not a server's address"), ("https://x:0", "not a server's address"),
                ("https://x:99999", "not a server's address"), ("https://x/path", "not a server's address"),
                ("https://a b", "not a server's address"), ("grader", "not a server's address"),
                ("https://[::1", "not a server's address"), ("https://[x]", "not a server's address"),
                (f"https://user:{TOKEN}@x", "leave user and password out"),
                ("unix:", "not a server's address")):
            self.told(2, sentence, "status", "7", "--server", text)
            self.told(2, sentence, "status", "7", MYOGRADE_SERVER=text)
        self.told(3, "can't reach a server", "status", "7", "--server", "https://127.0.0.1:1")
        self.told(3, "can't reach a server", "status", "7", "--server", "http://[::1]:1")

    # --- files over the network ---

    def test_files_go_up_and_come_down(self):
        answers = {"POST /v1/artefacts?team=alpha&track=t": (201, {"artefact": "a" * 64}),
                   "POST /v1/submissions": (201, STATUS), "GET /v1/backup": (200, "b" * 3_000_000)}
        program = self.path("program", "#!/bin/sh\n" + "x" * 2_000_000, 0o755)
        for tls in (True, False):
            port = self.listen(answers, tls=tls)
            server = f"https://localhost:{port}" if tls else f"http://localhost:{port}"
            at = ("--server", server, "--ca-file", self.certificate)
            self.done("submit", program, "--track", "t", "--team", "alpha", *at)
            self.assertGreater(len([b for _, p, b in Handler.heard if "artefacts" in p][-1]), 2_000_000)
            copy = self.path(f"copy-{tls}")
            self.done("store", "backup", copy, *at)
            self.assertEqual(os.path.getsize(copy), 3_000_000)

    def test_words_of_a_server_do_not_command_the_terminal(self):
        port = self.listen({"GET /v1/submissions/7": (403, {
            "error": {"code": "forbidden", "message": "No\x1b[2J.\nmyograde: error: Yes."}})})
        self.told(2, "No?[2J.?myograde: error: Yes.", "status", "7", "--server",
                  f"https://localhost:{port}", "--ca-file", self.certificate)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
