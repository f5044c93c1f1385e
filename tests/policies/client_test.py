"""The Python client against a real daemon, over its socket and over TLS, with leases that play
without physics; and against servers that answer badly."""

import concurrent.futures
import contextlib
import io
import json
import os
import pathlib
import socket
import stat
import subprocess
import sys
import tarfile
import tempfile
import threading
import time
import unittest
import unittest.mock
import zipfile

from myograde.client import (Client, DeadlinePassed, ServerError, Unreachable, WrongUse,
                             choose_server)
from myograde.client import client as implementation
from myograde.client.server import login_file
from support import images
from support.certificates import make_certificate
from support.daemon import Daemon

BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
TRACK, LONG_S = "demo-manipulation", 120
VARIABLES = ("MYOGRADE_SERVER", "MYOGRADE_TOKEN", "MYOGRADE_CA_FILE", "MYOGRADE_DATA")


def alone(**variables):
    """The environment of a participant, with only these of MyoGrade's variables."""
    kept = {key: value for key, value in os.environ.items() if key not in VARIABLES}
    return unittest.mock.patch.dict(os.environ, {**kept, **variables}, clear=True)


class WithDaemon(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.daemon = Daemon(BIN, SOURCE, "client")
        cls.addClassCleanup(cls.daemon.close)
        cls.folder = cls.daemon.root
        cls.daemon.use_stand_in_runner()
        cls.daemon.command = [BIN / "myograded"]
        cls.daemon.environment["MYOGRADE_CACHE"] = str(cls.folder / "cache")
        cls.daemon.change_config(f"tracks/{TRACK}.json", episodes_per_lease=2,
                                 seeds={"first": 0, "count": 6},
                                 practice_seeds={"first": 100, "count": 6})
        certificate, key = make_certificate(cls.folder)
        cls.ca_file = certificate
        listen = {"address": "127.0.0.1", "port": 0, "certificate": str(certificate),
                  "key": str(key)}
        cls.daemon.configure(slots=2, http={"listen": listen})
        cls.daemon.start()
        cls.url = (cls.daemon.data / "listen").read_text().strip()

    def setUp(self):
        self.configs = self.folder / "participant"
        patch = alone(XDG_CONFIG_HOME=str(self.configs))
        patch.start()
        self.addCleanup(patch.stop)
        self.here = Client(data=self.daemon.data)

    def policy(self, name, mode="ok"):
        """A submission's folder that plays in a mode of fake_runner.py."""
        folder = self.folder / name
        if not folder.exists():
            (folder / "empty").mkdir(parents=True)
            (folder / "policy.json").write_text(json.dumps(
                {"name": name, "command": ["./policy", mode]}))
            (folder / "policy").write_text("#!/bin/sh\n")
            (folder / "policy").chmod(0o755)
            (folder / "link").symlink_to("policy")
            # Longer than the fields of an old tar, and not of ASCII.
            (folder / ("long" * 40 + "é")).write_text("kept")
        return folder

    def token(self, team):
        self.daemon.post("/v1/teams", {"team": team})
        return self.daemon.post("/v1/tokens", {"role": "participant", "team": team,
                                               "label": "laptop"})["token"]

    def graded(self, client, name, team, mode="ok", **options):
        submission = client.submit(self.policy(name, mode), track=TRACK, team=team, **options)
        return client.wait(submission["submission"], timeout_s=LONG_S)


class Grading(WithDaemon):
    def test_any_address_can_be_asked(self):
        self.assertEqual(self.here.ask("/v1/whoami"), self.here.whoami())
        self.assertEqual(self.here.ask("/v1/teams", {"team": "asked"})["team"], "asked")
        artefact = self.here.upload(self.policy("asked"), track=TRACK, team="asked")["artefact"]
        request = {"artefact": artefact, "team": "asked", "track": TRACK}
        answers = [self.here.ask("/v1/submissions", request, key="a-key") for _ in range(2)]
        self.assertEqual([answer["repeated"] for answer in answers], [False, True])
        with self.assertRaisesRegex(ServerError, "there is no /v1/nothing"):
            self.here.ask("/v1/nothing")

    def test_a_submission_is_graded_over_the_socket(self):
        seen = []
        submission = self.here.submit(self.policy("walker"), track=TRACK, team="socket")
        self.assertFalse(submission["repeated"])
        status = self.here.wait(submission["submission"], timeout_s=LONG_S, on_change=seen.append)
        self.assertEqual((status["state"], status["episodes"]["done"]), ("done", 6))
        self.assertEqual(seen[-1], status)
        self.assertEqual(len({json.dumps([s["state"], s["episodes"], s["waiting"]])
                              for s in seen}), len(seen))
        number = status["submission"]
        records = self.here.episodes(number)
        self.assertEqual([record["index"] for record in records], list(range(6)))
        result = self.here.show(number)
        self.assertEqual(sum(record["success"] for record in records),
                         result["aggregate"]["successes"])
        for record in records:
            self.assertFalse([key for key, value in record.items() if isinstance(value, dict)])
            self.assertLessEqual({"outcome", "reason", "time_s", "digest", "seed"}, set(record))
            self.assertTrue([key for key in record if key.startswith("facts.")])
        board = self.here.leaderboard(track=TRACK)
        row = next(row for row in board if row["team"] == "socket")
        self.assertEqual((row["submission"], row["successes"]),
                         (number, result["aggregate"]["successes"]))
        self.assertEqual(self.here.receipt(number)["receipt"]["submission"], number)
        self.assertIn(TRACK, {track["track"] for track in self.here.tracks()})
        self.assertEqual(self.here.phases(), [])

    def test_a_participant_submits_over_tls_with_a_token(self):
        away = Client(self.url, token=self.token("remote"), ca_file=self.ca_file)
        self.assertEqual((away.whoami()["role"], away.whoami()["teams"]),
                         ("participant", ["remote"]))
        status = self.graded(away, "remote-walker", "remote", episodes=4)
        self.assertEqual((status["state"], status["ranked"], status["episodes"]["total"]),
                         ("done", False, 4))
        self.daemon.post("/v1/teams", {"team": "strangers"})
        with self.assertRaises(ServerError) as refused:
            away.submit(self.policy("remote-walker"), track=TRACK, team="strangers")
        self.assertEqual(refused.exception.code, "not_found")
        with self.assertRaises(ServerError) as refused:
            Client(self.url, ca_file=self.ca_file).status(status["submission"])
        self.assertEqual((refused.exception.status, refused.exception.code), (401, "no_token"))

    def test_the_program_and_the_client_pack_the_same_submission(self):
        folder = self.policy("same")
        told = self.here.upload(folder, team="packer", track=TRACK)
        self.assertTrue(told["new"])
        archives = []
        for ending, mode in ((".tar.gz", "w:gz"), (".tar", "w")):
            archives.append(self.folder / f"same{ending}")
            with tarfile.open(archives[-1], mode) as archive:
                archive.add(folder, ".")
        with zipfile.ZipFile(self.folder / "same.zip", "w") as archive:
            for path in sorted(folder.rglob("*")):
                name = path.relative_to(folder).as_posix()
                if path.is_symlink():
                    entry = zipfile.ZipInfo(name)
                    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
                    archive.writestr(entry, os.readlink(path))
                else:
                    archive.write(path, name)
        for archive in (*archives, self.folder / "same.zip"):
            again = self.here.upload(archive, team="packer", track=TRACK)
            self.assertEqual((again["artefact"], again["new"]), (told["artefact"], False), archive)
        by_program = self.daemon.ask("submit", folder, "--track", TRACK, "--team", "packer",
                                     "--episodes", "1")
        self.assertEqual(by_program["artefact"], told["artefact"])
        program = self.here.upload(folder / "policy", team="packer", track=TRACK)
        self.assertEqual((program["name"], program["command"]), ("policy", ["./policy"]))

    def test_a_given_name_comes_over_the_submissions(self):
        folder = self.policy("first-name")
        image = self.folder / "agent.tar"
        image.write_bytes(images.image([images.program_layer("/bin/true")]))
        for place in (folder, folder / "policy", image):
            told = self.here.upload(place, team="namer", track=TRACK, name="second name")
            self.assertEqual(told["name"], "second name", place)
            self.assertEqual(told["image"] is not None, place == image)
        self.assertEqual(told["image"]["working_dir"], "/")
        accepted = self.here.submit(folder, track=TRACK, team="namer", episodes=1, name="third")
        by_program = self.daemon.ask("submit", folder, "--track", TRACK, "--team", "namer",
                                     "--episodes", "1", "--name", "third")
        self.assertEqual((accepted["name"], by_program["name"]), ("third", "third"))
        for number in (accepted["submission"], by_program["submission"]):
            self.here.wait(number, timeout_s=LONG_S)

    def test_lists_come_in_pages(self):
        numbers = [self.here.submit(self.policy("many"), track=TRACK, team="pages",
                                    seeds=[1000 + seed])["submission"] for seed in range(5)]
        with unittest.mock.patch.object(implementation, "PAGE", 2):
            listed = list(self.here.submissions(team="pages"))
        self.assertEqual([record["submission"] for record in listed], numbers[::-1])
        self.assertIn("episodes.total", listed[0])
        for number in numbers:
            self.here.wait(number, timeout_s=LONG_S)

    def test_a_submission_is_cancelled(self):
        number = self.here.submit(self.policy("mute", "mute"), track=TRACK,
                                  team="canceller")["submission"]
        begun = time.monotonic()
        with self.assertRaises(DeadlinePassed) as passed:
            self.here.wait(number, timeout_s=1)
        self.assertLess(time.monotonic() - begun, 10)
        self.assertIn("is still", str(passed.exception))
        self.assertIn("cancel", self.here.cancel(number, "a mistake"))
        self.assertEqual(self.here.wait(number, timeout_s=LONG_S)["state"], "cancelled")
        with self.assertRaises(ServerError) as refused:
            self.here.cancel(number)
        self.assertEqual((refused.exception.status, refused.exception.code), (409, "conflict"))

    def test_many_threads_may_share_a_client(self):
        with concurrent.futures.ThreadPoolExecutor(8) as pool:
            roles = [future.result()["role"]
                     for future in [pool.submit(self.here.whoami) for _ in range(24)]]
        self.assertEqual(set(roles), {"operator"})

    def test_pandas_takes_the_records(self):
        try:
            import pandas
        except ImportError:
            self.skipTest("pandas is not installed")
        number = self.graded(self.here, "walker", "pandas", episodes=2)["submission"]
        table = pandas.DataFrame(self.here.episodes(number))
        self.assertEqual(len(table), 2)
        self.assertTrue(table["time_s"].mean() > 0)

    def test_what_the_server_says_is_what_the_caller_reads(self):
        for call, status, code, words in (
                (lambda: self.here.submit(self.policy("walker"), track="runing", team="x"), 400,
                 "unknown_track", "runing"),
                (lambda: self.here.status(10**6), 404, "not_found", "1000000"),
                (lambda: self.here.leaderboard(track="elbow", board="side"), 400, "bad_request",
                 "side")):
            with self.assertRaises(ServerError) as refused:
                call()
            self.assertEqual((refused.exception.status, refused.exception.code), (status, code))
            self.assertIn(words, str(refused.exception))


class Choice(WithDaemon):
    """Which server is asked, and what is shown to it."""

    def login(self, token):
        """As a participant does it, with the program."""
        done = subprocess.run([BIN / "myograde", "login", self.url, "--ca-file", self.ca_file],
                              input=token + "\n", text=True, capture_output=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)

    def test_the_login_of_the_program_is_the_clients(self):
        token = self.token("logged-in")
        self.login(token)
        self.assertEqual(login_file().parent.parent, self.configs)
        client = Client()
        self.assertEqual((str(client.server), client.server.token), (self.url, token))
        self.assertNotIn(token, repr(client.server))
        self.assertEqual(client.whoami()["teams"], ["logged-in"])
        # The token goes to no other server, and other choices win.
        self.assertEqual(choose_server("https://example.org").token, "")
        self.assertEqual(choose_server(data=self.daemon.data).token, "")
        self.assertEqual(choose_server(self.url).token, token)
        with alone(XDG_CONFIG_HOME=str(self.configs), MYOGRADE_DATA="/somewhere"):
            self.assertEqual(choose_server().socket, "/somewhere/myograde.sock")
        login_file().chmod(0o644)
        with self.assertRaisesRegex(WrongUse, "chmod 600"):
            Client()
        login_file().chmod(0o600)
        login_file().write_text('{"server": "https://x", "token": "secret"')
        with self.assertRaisesRegex(WrongUse, "is not a login") as wrong:
            Client()
        self.assertNotIn("secret", str(wrong.exception))
        login_file().unlink()

    def test_the_variables_choose_as_for_the_program(self):
        token = self.token("by-variables")
        with alone(MYOGRADE_SERVER=self.url, MYOGRADE_TOKEN=token,
                   MYOGRADE_CA_FILE=str(self.ca_file)):
            self.assertEqual(Client().whoami()["teams"], ["by-variables"])
            self.assertEqual(choose_server("https://example.org").token, "")
            self.assertEqual(choose_server(data=self.daemon.data).token, "")
        with alone(MYOGRADE_TOKEN="two words"), self.assertRaisesRegex(WrongUse, "MYOGRADE_TOKEN"):
            Client(self.url)

    def test_addresses_are_read_as_the_program_reads_them(self):
        for text, shown in (("https://Grader.Example.ORG:443/", "https://grader.example.org"),
                            ("https://[2001:DB8::7]:8443", "https://[2001:db8::7]:8443"),
                            ("http://127.0.0.1:8080", "http://127.0.0.1:8080"),
                            ("unix:a.sock", "a.sock"), ("./a.sock", "./a.sock")):
            self.assertEqual(str(choose_server(text)), shown)
        for text, words in (("grader", "is not a server's address"), ("ftp://x", "is not a server's"),
                            ("https://x/path", "is not a server's"), ("https://x:99999", "is no"),
                            ("https://user@x", "password out"), ("https://", "is not a server's"),
                            ("http://example.org", "without TLS"), ("https://x:0", "is not a server's")):
            with self.assertRaisesRegex(WrongUse, words, msg=text):
                choose_server(text)
        with self.assertRaisesRegex(WrongUse, "not both"):
            choose_server("https://x", data="y")

    def test_a_server_that_cant_be_trusted_hears_no_token(self):
        for client, words in (
                (lambda: Client(self.url, token="t"), "can't be trusted"),
                (lambda: Client(self.url.replace("127.0.0.1", "[::1]"), token="t"), "can't reach a server"),
                (lambda: Client(socket=self.folder / "none.sock"), "can't reach a daemon"),
                (lambda: Client("http://127.0.0.1:1"), "can't reach a server")):
            with self.assertRaisesRegex(Unreachable, words):
                client().whoami()
        with self.assertRaisesRegex(WrongUse, "none.pem"):
            Client(self.url, ca_file=self.folder / "none.pem")


class Answers(unittest.TestCase):
    """Servers that answer badly, or not at all."""

    def serve(self, *answers):
        """A server on this host that gives these answers, one a connection: bytes, or a function of
        the connection. Returns a client of it and the list of requests."""
        door = socket.create_server(("127.0.0.1", 0))
        self.addCleanup(door.close)
        requests = []

        def run():
            for answer in answers:
                with contextlib.suppress(OSError):
                    wire, _ = door.accept()
                    with wire:
                        wire.settimeout(30)
                        requests.append(self.request(wire))
                        answer(wire) if callable(answer) else wire.sendall(answer)

        threading.Thread(target=run, daemon=True).start()
        with alone():
            client = Client(f"http://127.0.0.1:{door.getsockname()[1]}", token="t")
        return client, requests

    def request(self, wire):
        """Head and body of a request, as bytes."""
        text = b""
        while b"\r\n\r\n" not in text:
            text += wire.recv(65536)
        head, body = text.split(b"\r\n\r\n", 1)
        length = [int(line.split(b":")[1]) for line in head.split(b"\r\n")
                  if line.lower().startswith(b"content-length:")]
        while length and len(body) < length[0]:
            body += wire.recv(65536)
        return head, body

    def ok(self, body, status=b"200 OK", more=b""):
        return (b"HTTP/1.1 " + status + b"\r\nContent-Length: " + str(len(body)).encode() + b"\r\n"
                + more + b"\r\n" + body)

    def test_a_submission_whose_answer_is_lost_is_sent_again_with_its_key(self):
        uploaded, accepted = self.ok(b'{"artefact": "5e88"}'), self.ok(b'{"submission": 7}')
        client, requests = self.serve(uploaded, b"", accepted[:-4], accepted)
        with unittest.mock.patch.object(implementation, "BEFORE_RETRY_S", 0.01):
            program = pathlib.Path(sys.executable).resolve()
            self.assertEqual(client.submit(program, track="elbow", team="a")["submission"], 7)
        keys = [[line for line in head.split(b"\r\n") if line.startswith(b"Idempotency-Key")]
                for head, _ in requests]
        self.assertEqual(keys[0], [])
        self.assertEqual(len(keys[1]), 1)
        self.assertEqual(keys[1], keys[2])
        self.assertEqual(keys[2], keys[3])
        self.assertEqual({body for _, body in requests[1:]}, {requests[1][1]})

    def test_a_runtime_that_the_server_lacks_is_told_before_the_upload(self):
        listed = self.ok(b'{"runtimes": [{"runtime": "python"}, {"runtime": "jax"}]}')
        manifest = json.dumps({"name": "a", "command": ["x"], "runtimes": ["python", "torch"]})
        with tempfile.TemporaryDirectory() as folder:
            (pathlib.Path(folder) / "policy.json").write_text(manifest)
            packed = pathlib.Path(folder) / "a.tar.gz"
            with tarfile.open(packed, "w:gz") as archive:
                archive.add(pathlib.Path(folder) / "policy.json", "./policy.json")
            for path in (folder, packed):
                client, requests = self.serve(listed)
                with self.assertRaisesRegex(WrongUse, '"torch", which .* it has python, jax'):
                    client.submit(path, track="elbow", team="a")
                self.assertEqual([head.split()[1] for head, _ in requests], [b"/v1/runtimes"])
            # A stranger's archive is opened by the server alone.
            client, requests = self.serve(self.ok(b'{"artefact": "5e"}'))
            client.upload(packed, track="elbow", team="a", check_runtimes=False)
            self.assertEqual([head.split()[1] for head, _ in requests], [b"/v1/artefacts?team=a&track=elbow"])

    def test_a_server_that_sends_a_byte_now_and_then_holds_nobody(self):
        def trickle(wire):
            for _ in range(200):
                wire.sendall(b"H")
                time.sleep(0.1)

        client, _ = self.serve(trickle)
        begun = time.monotonic()
        with self.assertRaisesRegex(Unreachable, "did not answer within 1 s"):
            client._transport.ask("GET", "/v1/health", timeout_s=1)
        self.assertLess(time.monotonic() - begun, 5)

    def test_a_silent_server_ends_a_wait_at_its_deadline(self):
        silent = [lambda wire: time.sleep(3)] * 8
        client, _ = self.serve(*silent)
        with self.assertRaises(DeadlinePassed):
            client.wait(1, timeout_s=0.5)

    def test_bad_answers_are_told_in_a_sentence(self):
        for answer, code, words in (
                (self.ok(b"", b"302 Found", b"Location: https://evil.example/\r\n"), "redirect",
                 "not followed"),
                (self.ok(b"<html>"), "unreadable", "HTTP status 200"),
                (self.ok(b"[]", b"500 X"), "unreadable", "HTTP status 500"),
                (self.ok(b'{"error": {"code": 5}}', b"400 X"), "unreadable", "HTTP status 400"),
                (self.ok(b"[" * 100000), "unreadable", "HTTP status 200"),
                (self.ok(b"{}"), "unreadable", 'lacks "tracks"'),
                (self.ok(b'{"error": {"code": "x", "message": "a\\u001b[2Jb"}}', b"400 X"), "x",
                 "^a\ufffd\\[2Jb$")):
            client, _ = self.serve(answer)
            with self.assertRaisesRegex(ServerError, words) as refused:
                client.tracks()
            self.assertEqual(refused.exception.code, code)

    def test_a_refusal_in_the_middle_of_an_upload_is_read(self):
        def refuse(wire):
            wire.sendall(self.ok(b'{"error": {"code": "too_large", "message": "too large"}}',
                                 b"413 X"))

        door = socket.create_server(("127.0.0.1", 0))
        self.addCleanup(door.close)

        def run():
            wire, _ = door.accept()
            with wire:
                refuse(wire)
                while wire.recv(65536):
                    pass

        threading.Thread(target=run, daemon=True).start()
        with alone():
            client = Client(f"http://127.0.0.1:{door.getsockname()[1]}")
        with self.assertRaises(ServerError) as refused:
            client._transport.ask("POST", "/v1/artefacts", io.BytesIO(bytes(8 << 20)), size=8 << 20)
        self.assertEqual(refused.exception.code, "too_large")


if __name__ == "__main__":
    unittest.main(verbosity=2)
