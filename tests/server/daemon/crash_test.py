"""Whatever happens to the daemon and its store, the results are the undisturbed ones. The runners
play without physics here; tests/integration has the real ones."""

import http.client
import os
import pathlib
import random
import shutil
import signal
import sqlite3
import subprocess
import time
import unittest

from daemon_test import FINAL, DaemonCase
from support.sanitizer import asan_options

KILLER = os.environ.get("MYOGRADE_TEST_KILLER", "")
FULL = os.environ.get("MYOGRADE_TEST_FULL", "") != ""


class Disturbed(DaemonCase):
    """A submission of 6 episodes in 3 leases; each test disturbs it in one way."""

    mode = "slow"
    expected = None

    def setUp(self):
        super().setUp()
        if Disturbed.expected is None:
            Disturbed.expected = self.outcome(self.submit(self.mode))
            self.stop(signal.SIGTERM)
            shutil.rmtree(self.data)
            self.start()
        self.stop(signal.SIGTERM)

    def tearDown(self):
        self.daemon.process.send_signal(signal.SIGCONT)
        super().tearDown()

    def outcome(self, submission):
        """Everything that must not depend on what happened on the way."""
        self.assertEqual(self.ended(submission)["state"], "done")
        result = self.result(submission)
        self.assertEqual(result["not_repeatable"], [])
        rows = [{k: v for k, v in row.items() if k not in ("wall_s", "policy_cpu_s", "attempt")}
                for row in result["episode_rows"]]
        for row in rows:
            row["facts"] = {k: v for k, v in row["facts"].items()
                            if k not in ("wall_s", "policy_cpu_s")}
        board = [(r["rank"], r["team"], r["submission"], r["aggregate"])
                 for r in self.get("/v1/leaderboard?track=demo-manipulation")["rows"]]
        return {"rows": rows, "hash": result["hashes"]["results"], "board": board}

    def check(self, submission):
        self.assertEqual(self.outcome(submission), self.expected)
        with sqlite3.connect(self.data / "store.db") as store:
            self.assertEqual(store.execute("PRAGMA integrity_check").fetchall(), [("ok",)])
            self.assertEqual(store.execute("PRAGMA foreign_key_check").fetchall(), [])
        store.close()

    def wait_for_episodes(self, submission, count):
        return self.wait(f"/v1/submissions/{submission}",
                         lambda b: b["episodes"]["done"] >= count)


class Kills(Disturbed):
    def run_until_killed(self, when):
        """Submits to a daemon that is killed around one of its commits. False: it survived."""
        # Otherwise a sanitizer's runtime would refuse to load after the preloaded library.
        self.daemon.process = self.daemon.launch(
            LD_PRELOAD=KILLER, KILL_AT_SYNC=when, ASAN_OPTIONS=asan_options("verify_asan_link_order=0"))
        try:
            deadline = time.monotonic() + 30
            while self.daemon.running and time.monotonic() < deadline:
                try:
                    if not self.get("/v1/submissions")["submissions"]:
                        self.submit("ok")
                    elif self.get("/v1/submissions/1")["state"] in FINAL:
                        return False
                except (OSError, http.client.HTTPException, AssertionError, ValueError):
                    pass  # not up yet, or killed during the request
                time.sleep(0.02)
        finally:
            status = self.stop(signal.SIGKILL)
        self.assertEqual(status, -signal.SIGKILL, self.daemon.state())
        return True

    def test_kill_at_every_commit(self):
        self.assertTrue(pathlib.Path(KILLER).exists(), "build kill_at_sync first")
        clean = self.folder / "clean"
        shutil.copytree(self.data, clean, ignore=shutil.ignore_patterns("*.sock"))
        self.start()
        expected = self.outcome(self.submit("ok"))
        self.stop(signal.SIGTERM)
        for side in ("before", "after") if FULL else ("after",):
            number = 0
            killed = True
            while killed:
                number += 1
                shutil.rmtree(self.data)
                shutil.copytree(clean, self.data)
                killed = self.run_until_killed(f"{side}:{number}")
                self.start()
                if not self.get("/v1/submissions")["submissions"]:
                    self.submit("ok")  # never accepted, and the client knows
                with self.subTest(side=side, commit=number):
                    self.assertEqual(self.outcome(1), expected)
                self.stop(signal.SIGTERM)
                self.assertLess(number, 200, "every start of the daemon is killed")
            # How many records share a commit depends on the host's speed.
            self.assertGreater(number, 5, "accepting, beginning, three leases, the end")

    def test_kill_at_random_times(self):
        moments = random.Random(7)
        self.start()
        submission = self.submit(self.mode)
        for _ in range(12):
            time.sleep(moments.uniform(0, 0.3))
            self.stop(moments.choice((signal.SIGKILL, signal.SIGKILL, signal.SIGTERM)))
            self.start()
        self.check(submission)
        faults = [l["faults"] for l in self.get(f"/v1/submissions/{submission}")["blocks"]]
        self.assertEqual(faults, [0, 0, 0], "a crash of the daemon costs no lease a replay")

    def test_kill_runners(self):
        self.start()
        submission = self.submit(self.mode)
        for _ in range(2):
            health = self.wait("/v1/health", lambda b: b["leases"])
            os.kill(health["leases"][0]["process"], signal.SIGKILL)
            time.sleep(0.3)
        self.check(submission)

    def test_torn_log_of_writes(self):
        for cut, garble in ((1, 0), (5000, 0), (0, 64), (9000, 64)):
            with self.subTest(cut=cut, garble=garble):
                shutil.rmtree(self.data)
                self.start()
                submission = self.submit(self.mode)
                self.wait_for_episodes(submission, 3)
                self.stop(signal.SIGKILL)
                log = self.data / "store.db-wal"
                content = log.read_bytes()
                self.assertGreater(len(content), 40000)
                content = content[:len(content) - cut]
                log.write_bytes(content[:len(content) - garble] + b"\xa5" * garble)
                self.start()
                self.check(submission)
                self.stop(signal.SIGTERM)
        self.start()


class Stops(Disturbed):
    def setUp(self):
        super().setUp()
        # A stand-in for the runner that a busy machine starts in 2 s is not silent.
        self.configure(scheduler={"heartbeat_s": 5})
        self.start()

    def test_stopped_runner(self):
        submission = self.submit(self.mode)
        health = self.wait("/v1/health", lambda b: b["leases"])
        os.kill(health["leases"][0]["process"], signal.SIGSTOP)
        self.check(submission)
        faults = sum(l["faults"] for l in self.get(f"/v1/submissions/{submission}")["blocks"])
        self.assertEqual(faults, 1)

    def test_stopped_daemon(self):
        submission = self.submit(self.mode)
        self.wait_for_episodes(submission, 1)
        self.daemon.process.send_signal(signal.SIGSTOP)
        time.sleep(7)
        self.daemon.process.send_signal(signal.SIGCONT)
        self.check(submission)
        faults = sum(l["faults"] for l in self.get(f"/v1/submissions/{submission}")["blocks"])
        self.assertEqual(faults, 0, "the daemon's own sleep is no runner's silence")


class StoreTrouble(Disturbed):
    def refused(self, words):
        status, body = self.call("POST", "/v1/submissions", {
            "artefact": self.artefact, "team": "late", "track": "demo-manipulation"})
        self.assertEqual((status, body["error"]["code"]), (503, "store"), body)
        self.assertIn(words, body["error"]["message"])
        self.assertIn(words, self.get("/v1/health")["message"])

    def begin(self):
        self.start()
        self.artefact = self.upload("ok")
        submission = self.submit(self.mode)
        self.wait_for_episodes(submission, 1)
        return submission

    def test_locked_by_another_process(self):
        submission = self.begin()
        other = sqlite3.connect(self.data / "store.db", isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        time.sleep(1.5)
        self.refused("locked by another process")
        begin = time.monotonic()
        self.get(f"/v1/submissions/{submission}")
        self.assertLess(time.monotonic() - begin, 1, "reading goes on")
        other.execute("ROLLBACK")
        other.close()
        self.wait("/v1/health", lambda b: b["status"] == "ok")
        self.check(submission)

    def test_full_disk(self):
        if os.geteuid() != 0:
            self.skipTest("only root can mount a small disk")
        small = self.folder / "small"
        small.mkdir()
        mount = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", small],
                               capture_output=True, text=True, check=False)
        if mount.returncode != 0:
            self.skipTest(f"no mount on this host: {mount.stderr}")
        self.addCleanup(subprocess.run, ["umount", "-l", small], check=False)
        shutil.copytree(self.data, small / "data", ignore=shutil.ignore_patterns("*.sock"))
        self.daemon.data = small / "data"
        self.configure(artefacts={"disk_reserve_bytes": 1})
        submission = self.begin()
        with open(small / "filler", "wb", buffering=0) as filler:
            try:
                while filler.write(bytes(4096)):
                    pass
            except OSError:
                pass
        self.wait("/v1/health", lambda b: b["status"] in ("store", "paused"))
        status, body = self.call("POST", "/v1/submissions", {
            "artefact": self.artefact, "team": "late" * 16, "track": "demo-manipulation",
            "seeds": list(range(200, 4200))})
        self.assertEqual((status, body["error"]["code"]), (503, "store"), body)
        self.assertIn("full", body["error"]["message"])
        # Larger than a socket buffer: rejected early, and the client still gets the answer.
        status, body = self.call("POST", "/v1/artefacts", bytes(8 << 20))
        self.assertEqual(status, 503, body)
        self.assertIn("too full", body["error"]["message"])
        time.sleep(2)
        os.remove(small / "filler")
        self.wait("/v1/health", lambda b: b["status"] == "ok")
        self.check(submission)
        self.stop(signal.SIGTERM)

    def test_read_only_store_is_refused_at_the_start(self):
        if os.geteuid() != 0:
            self.skipTest("only root can mount a folder read-only")
        bound = subprocess.run(
            f"mount --bind {self.data} {self.data} && mount -o remount,bind,ro {self.data}",
            shell=True, capture_output=True, text=True, check=False)
        if bound.returncode != 0:
            self.skipTest(f"no mount on this host: {bound.stderr}")
        try:
            self.assertEqual(self.daemon.launch().wait(timeout=20), 4)
        finally:
            subprocess.run(["umount", "-l", self.data], check=False)
        self.assertIn("rights", self.daemon.log())
        self.start()
        self.check(self.submit(self.mode))

    def test_a_second_daemon_changes_nothing(self):
        submission = self.begin()
        second = self.daemon.launch()
        self.assertEqual(second.wait(timeout=20), 4)
        self.assertIn(f"another daemon (process {self.daemon.pid}) works on", self.daemon.log())
        self.check(submission)


if __name__ == "__main__":
    unittest.main(verbosity=2)
