"""Clients that do harm without breaking HTTP: they are silent, slow, many, never submit, or
repeat the same request again and again. Meanwhile an organiser and another user are answered."""

import concurrent.futures
import json
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import tempfile
import time
import unittest

from daemon_test import BIN, DaemonCase
from support import client, proc
from support.crowd import UPLOAD, crowd
from support.submission import played_by_stand_in
from support.waiting import wait_until

ROOT = os.geteuid() == 0
STRANGER = 64099  # a user of no daemon and no slot
# A healthy answer takes milliseconds; without the limits these would take minutes or never end.
SOON_S = 20


class Attacked(DaemonCase):
    """A daemon with a socket that everybody may use."""

    def setUp(self):
        self.open = pathlib.Path(tempfile.mkdtemp(prefix="myograde-open-"))
        self.open.chmod(0o755)
        self.addCleanup(shutil.rmtree, self.open, ignore_errors=True)
        super().setUp()

    def start(self):
        self.daemon.socket = self.open / "socket"
        # Crowds are about places and time: the limit on requests (roles_test.py) would end them.
        self.configure(http={"socket_mode": "0666", "requests_per_s": 1e6, "burst": 1e6})
        super().start()

    def crowd(self, count, text=b"", uid=None, slow=False):
        return crowd(self.daemon.socket, count, text, uid, slow)

    def users(self):
        """The daemon's own user, who is an organiser, and where possible another one."""
        return (None, STRANGER) if ROOT else (None,)

    def others_are_answered(self):
        for uid in self.users():
            begun = time.monotonic()
            status, body = self.call("GET", "/v1/health", uid=uid)
            self.assertEqual((status, body.get("status")), (200, "ok"), (uid, body))
            status, body = self.call("POST", "/v1/artefacts", played_by_stand_in("ok", str(uid)),
                                     uid=uid)
            self.assertIn(status, (200, 201), (uid, body))
            self.assertLess(time.monotonic() - begun, SOON_S)


class Crowds(Attacked):
    def test_silent_uploads(self):
        with self.crowd(70, UPLOAD % 1000):
            self.others_are_answered()
        with self.crowd(70, UPLOAD % 1000, uid=STRANGER - 1 if ROOT else None):
            self.others_are_answered()

    def test_slow_uploads(self):
        for attacker in (None, STRANGER - 1) if ROOT else (None,):
            with self.crowd(80, UPLOAD % (1 << 20), uid=attacker, slow=True):
                self.others_are_answered()

    def test_idle_connections_and_half_heads(self):
        for attacker in (None, STRANGER - 1) if ROOT else (None,):
            for text in (b"", b"GET /v1/hea", b"GET /v1/tracks HTTP/1.1\r\nHost: localhost\r\n\r\n"):
                with self.crowd(300, text, uid=attacker):
                    self.others_are_answered()

    def test_pipelined_requests_leave_their_own_user_a_place(self):
        text = b"GET /v1/tracks HTTP/1.1\r\nHost: localhost\r\n\r\n" * 100
        for user in self.users():
            with self.crowd(300, text, uid=user):
                for _ in range(5):
                    begun = time.monotonic()
                    status, body = self.call("GET", "/v1/health", uid=user)
                    self.assertEqual((status, body.get("status")), (200, "ok"), (user, body))
                    self.assertLess(time.monotonic() - begun, SOON_S)

    def test_what_a_crowd_needed_is_given_back(self):
        """One answer at a time needs no more memory after a crowd than before it."""
        if b"__asan_init" in (BIN / "myograded").read_bytes():
            self.skipTest("AddressSanitizer keeps what is freed")
        for mode in ("ok", "slow"):
            self.ended(self.submit(mode))
        paths = ("/v1/submissions?limit=100", "/v1/submissions/1/result?episodes=1", "/v1/queue",
                 "/v1/leaderboard?track=demo-manipulation")

        def ask(times):
            for path in paths * times:
                self.assertEqual(client.call(self.daemon.socket_path, "GET", path)[0], 200)

        def resident():
            return proc.memory_bytes(self.daemon.pid) / 2**20

        ask(3)
        before = resident()
        with concurrent.futures.ThreadPoolExecutor(64) as crowd_of_threads:
            for done in [crowd_of_threads.submit(ask, 6) for _ in range(64)]:
                done.result()
        wait_until(resident, 40, f"it had {before:.0f} MiB before",
                   lambda now: now < before + 16)

    def test_announced_gigabytes(self):
        with self.crowd(20, UPLOAD % (4 << 30)):
            status, body = self.call("GET", "/v1/health")
            self.assertEqual((status, body["status"]), (200, "ok"))

    def test_a_stop_waits_for_no_upload(self):
        with self.crowd(3, UPLOAD % (1 << 30), slow=True), self.crowd(3, UPLOAD % 1000), \
                self.crowd(3):
            time.sleep(1)
            begun = time.monotonic()
            self.assertEqual(self.stop(signal.SIGTERM), 0)
            # Five seconds on a quiet host; upload_s is 900.
            self.assertLess(time.monotonic() - begun, SOON_S)
        self.assertFalse(self.daemon.socket.exists())

    def test_a_stop_waits_for_no_unpacking(self):
        # Ten million entries, each of which is counted.
        self.stop(signal.SIGTERM)
        self.configure(artefacts={"files": 10_000_000, "unpack_memory_bytes": 8 << 30})
        self.start()
        import hostile_uploads_test
        sender = subprocess.Popen(
            client.command(self.daemon.socket, None, "POST",
                           "/v1/artefacts?team=alpha&track=demo-manipulation"),
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        try:
            sender.stdin.write(hostile_uploads_test.many())
            sender.stdin.close()
            wait_until(lambda: list((self.data / "spool").glob("*.folder")), 60,
                       "it is not being unpacked", every_s=0.02)
            begun = time.monotonic()
            self.assertEqual(self.stop(signal.SIGTERM), 0)
            self.assertLess(time.monotonic() - begun, SOON_S)
            told = sender.stdout.read()
            if told:
                self.assertEqual(json.loads(told)[0], 503, told)
        finally:
            sender.kill()
            sender.wait()
            sender.stdout.close()
        # Nobody is charged for the host's failures.
        self.start()
        quota = self.get("/v1/quota?team=alpha&track=demo-manipulation")
        self.assertEqual(quota["tracks"][0]["failed"]["total"]["used"], 0)
        self.assertEqual(os.listdir(self.data / "spool"), [])


class Charges(Attacked):
    def failed(self):
        quota = self.get("/v1/quota?team=alpha&track=demo-manipulation")
        return quota["tracks"][0]["failed"]["total"]["used"]

    def test_only_what_is_wrong_with_the_bytes_is_a_failed_try(self):
        address = "/v1/artefacts?team=alpha&track=demo-manipulation"
        broken = socket.socket(socket.AF_UNIX)
        broken.connect(str(self.daemon.socket))
        broken.sendall(f"POST {address} HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9000\r\n\r\nhalf".encode())
        broken.shutdown(socket.SHUT_WR)
        broken.settimeout(60)
        self.assertIn(b"did not arrive whole", broken.recv(4096))
        broken.close()
        gone = socket.socket(socket.AF_UNIX)
        gone.connect(str(self.daemon.socket))
        gone.sendall(f"POST {address} HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n".encode()
                     + b"186a0\r\n" + bytes(100_000) + b"\r\n")
        gone.close()
        for kind in ("multipart/form-data; boundary=x", "text/plain"):
            status, body = self.call("POST", address, b"x" * 100, kind)
            self.assertEqual((status, body["error"]["code"]), (415, "bad_type"))
        self.assertEqual(self.failed(), 0)
        status, body = self.call("POST", address, b"no archive at all" * 100)
        self.assertEqual((status, body["error"]["code"]), (400, "bad_artefact"))
        self.assertEqual(self.failed(), 1)

    def test_a_body_of_another_type_is_told_so(self):
        for kind in ("multipart/form-data; boundary=x", "application/x-www-form-urlencoded",
                     "text/html", "application/x-tar"):
            status, body = self.call("POST", "/v1/submissions", b"{}", kind)
            self.assertEqual((status, body["error"]["code"]), (415, "bad_type"), body)
            self.assertIn("application/json", body["error"]["message"])
        self.assertEqual(self.call("POST", "/v1/submissions", b"{}", "application/json")[0], 400)


class Hoards(Attacked):
    def start(self):
        self.configure(artefacts={"uploader_unsubmitted": 2, "unsubmitted": 3,
                                  "unsubmitted_s": 3600},
                       reruns={"of_organisers": 3, "of_a_submission": 1, "of_one": 2})
        return super().start()

    def try_upload(self, name, uid=None, query="", mode="ok"):
        return self.call("POST", "/v1/artefacts" + query, played_by_stand_in(mode, name), uid=uid)

    def test_uploads_that_are_never_submitted_are_bounded_and_go(self):
        team = "?team=alpha&track=demo-manipulation"
        artefacts = []
        for name in ("a", "b", "c"):
            status, body = self.try_upload(name)
            self.assertEqual(status, 201, body)
            artefacts.append(body["artefact"])
        status, body = self.try_upload("d")
        self.assertEqual((status, body["error"]["code"]), (409, "quota"), body)
        self.assertIn("never submitted", body["error"]["message"])
        self.assertEqual(len(os.listdir(self.data / "artefacts")), 3)
        self.assertEqual(self.try_upload("a")[0], 200)  # already there
        request = {"artefact": artefacts[0], "team": "alpha", "track": "demo-manipulation"}
        self.assertEqual(self.call("POST", "/v1/submissions", request)[0], 201)
        self.assertEqual(self.try_upload("d", query=team)[0], 201)  # one has been submitted
        # The limit survives a restart, and what is too old is removed.
        self.stop(signal.SIGTERM)
        self.start()
        self.assertEqual(self.try_upload("e")[0], 409)
        self.stop(signal.SIGTERM)
        self.configure(artefacts={"unsubmitted_s": 1}, retention={"every_s": 1})
        DaemonCase.start(self)
        wait_until(lambda: os.listdir(self.data / "artefacts"), 60, "more are left",
                   lambda names: names == [artefacts[0]])
        request["artefact"] = artefacts[1]
        self.assertEqual(self.call("POST", "/v1/submissions", request)[0], 404)

    @unittest.skipUnless(ROOT, "only root can be somebody else")
    def test_one_uploader_has_a_bound_of_its_own(self):
        for name in ("a", "b"):
            self.assertEqual(self.try_upload(name, uid=STRANGER)[0], 201)
        status, body = self.try_upload("c", uid=STRANGER)
        self.assertEqual((status, body["error"]["code"]), (409, "quota"))
        self.assertIn(f"uid {STRANGER} has 2 uploads", body["error"]["message"])
        self.assertEqual(self.try_upload("c", uid=STRANGER - 1)[0], 201)

    def test_reruns_that_have_not_ended_are_bounded(self):
        self.assertEqual(self.try_upload("hoarded", STRANGER if ROOT else None, mode="slow")[0],
                         201)
        status, body = self.call("POST", "/v1/submissions", {
            "artefact": self.upload("slow", "hoarded"), "team": "strangers",
            "track": "demo-manipulation", "seeds": list(range(700_000, 700_012))},
            uid=STRANGER if ROOT else None)
        self.assertEqual(status, 201, body)
        submission = body["submission"]
        self.ended(submission)
        path = f"/v1/submissions/{submission}/rerun"
        if ROOT:
            self.assertEqual(self.call("POST", path, {}, uid=STRANGER)[0], 201)
            status, body = self.call("POST", path, {}, uid=STRANGER)
            self.assertEqual((status, body["error"]["code"]), (409, "quota"), body)
            self.assertIn(f"submission {submission}", body["error"]["message"])
        answers = [self.call("POST", path, {}) for _ in range(5)]
        self.assertEqual([status for status, _ in answers].count(201), 2 if ROOT else 3, answers)
        self.assertEqual(answers[-1][1]["error"]["code"], "quota")
        self.assertEqual(self.call("POST", f"/v1/submissions/{submission}/cancel", {})[0], 200)
        self.assertEqual(self.call("POST", path, {})[0], 201)


class Descriptors(Attacked):
    def test_a_config_that_does_not_fit_is_told_at_the_start(self):
        self.stop(signal.SIGTERM)
        keep = (["setpriv", "--bounding-set=-sys_resource"] if ROOT else [])
        done = subprocess.run(
            keep + ["prlimit", "--nofile=300:300", BIN / "myograded",
                    "--data", self.data, "--configs", self.configs,
                    "--cache", self.folder / "cache"],
            capture_output=True, text=True, timeout=60, check=False)
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("256 clients", done.stderr)
        self.assertIn("this process may have 300", done.stderr)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)

    def test_it_does_not_spin_without_descriptors(self):
        # A sanitised daemon needs a pipe to inspect an object of a type that is new to it, and
        # reports an invalid object if it gets none: everything else must have finished before.
        wait_until(self.daemon.log, 60, "it is not done with its start",
                   lambda log: "the reference episodes" in log)
        pid = self.daemon.pid
        open_now = len(os.listdir(f"/proc/{pid}/fd"))
        subprocess.run(["prlimit", f"--pid={pid}", f"--nofile={open_now + 20}:"], check=True)
        with self.crowd(100, uid=STRANGER if ROOT else None):
            def cpu():
                fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
                return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
            before = cpu()
            time.sleep(3)
            self.assertLess(cpu() - before, 1.5)  # it would be 3
            if ROOT:
                self.assertEqual(self.call("GET", "/v1/health")[0], 200)
        self.others_are_answered()


if __name__ == "__main__":
    unittest.main(verbosity=2)
