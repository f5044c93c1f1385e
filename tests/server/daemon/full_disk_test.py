"""A data folder on a disk that fills up: nothing is lost, everybody is told, and it goes on by
itself once there is room. Needs root, for a disk of its own."""

import json
import os
import subprocess
import unittest

from daemon_test import FINAL, DaemonCase
from support import prometheus
from support.client import Connection
from support.waiting import wait_until

MIB = 1 << 20


@unittest.skipUnless(os.geteuid() == 0, "only root can mount a small disk")
class SmallDisk(DaemonCase):
    reserve = 1

    def setUp(self):
        self.mounted = False
        self.addCleanup(self.unmount)
        super().setUp()

    def start(self):
        if not self.mounted:
            self.data.mkdir(exist_ok=True)
            done = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=24m,mode=0700", "small",
                                   str(self.data)], capture_output=True, text=True, check=False)
            if done.returncode != 0:
                self.skipTest(f"no disk can be mounted here: {done.stderr.strip()}")
            self.mounted = True
        self.configure(artefacts={"disk_reserve_bytes": self.reserve})
        super().start()

    def unmount(self):
        if self.mounted:
            subprocess.run(["umount", "--lazy", str(self.data)], check=False)

    @property
    def ballast(self):
        return self.data / "ballast"

    def free(self):
        space = os.statvfs(self.data)
        return space.f_bavail * space.f_frsize

    def fill(self, until=0):
        """Until no more fits, or only so many bytes are free."""
        with open(self.ballast, "ab", buffering=0) as file:
            for size in (MIB, 4096):
                while self.free() > until:
                    try:
                        file.write(b"x" * size)
                    except OSError:
                        break

    def metrics(self):
        connection = Connection(self.daemon.socket_path)
        connection.request("GET", "/metrics")
        text = connection.getresponse().read().decode()
        connection.close()
        return prometheus.parse(text)

    def rows(self, submission):
        rows = self.result(submission)["episode_rows"]
        return [{k: v for k, v in row.items() if k not in ("wall_s", "attempt")} for row in rows]


class FullDisk(SmallDisk):
    def test_nothing_is_lost_and_it_goes_on(self):
        undisturbed = self.submit("ok", team="calm")
        self.ended(undisturbed)
        submission = self.submit("slow", team="shaken")
        self.wait(f"/v1/submissions/{submission}", lambda b: b["episodes"]["done"] >= 1)
        before = self.get(f"/v1/submissions/{submission}")["episodes"]["done"]
        self.fill()
        # Asked for a change, it says why there is none.
        status, body = wait_until(
            lambda: self.call("POST", "/v1/teams", {"team": "late"}), 30, "it is taken",
            lambda answer: answer[0] == 503)
        self.assertEqual(body["error"]["code"], "store")
        self.assertIn("the disk is full; make room", body["error"]["message"])
        health = self.get("/v1/health")
        self.assertEqual(health["status"], "store")
        self.assertIn("the disk is full; make room", health["message"])
        status, ready = self.call("GET", "/v1/ready")
        self.assertEqual(status, 503)
        self.assertIn("store", [reason["code"] for reason in ready["reasons"]])
        families = wait_until(self.metrics, 30, "no event waits", lambda f:
                              prometheus.value_of(f, "myograde_journal_entries") > 0)
        self.assertEqual(prometheus.value_of(families, "myograde_store_writable"), 0)
        self.assertEqual(prometheus.value_of(families, "myograde_not_ready", reason="store"), 1)
        self.assertLess(prometheus.value_of(families, "myograde_disk_free_bytes", folder="data"),
                        MIB)
        self.assertGreater(prometheus.value_of(families, "myograde_store_write_failures_total"), 0)
        # What can be read is still there.
        self.assertGreaterEqual(
            self.get(f"/v1/submissions/{submission}")["episodes"]["done"], before)
        self.assertEqual(len(self.get("/v1/leaderboard?track=demo-manipulation")["rows"]), 1)
        self.ballast.unlink()
        wait_until(lambda: self.call("GET", "/v1/ready"), 30, "it does not go on",
                   lambda answer: answer == (200, {"ready": True, "reasons": []}))
        status = self.ended(submission)
        self.assertEqual(status["state"], "done")
        self.assertEqual(self.rows(submission), self.rows(undisturbed))
        self.assertEqual(self.result(submission)["not_repeatable"], [])
        status, body = self.call("POST", "/v1/teams", {"team": "late"})
        self.assertEqual(status, 201, body)
        self.assertEqual(prometheus.value_of(self.metrics(), "myograde_journal_entries"), 0)

    def test_a_daemon_that_is_killed_on_a_full_disk_comes_back(self):
        submission = self.submit("slow", team="shaken")
        self.wait(f"/v1/submissions/{submission}", lambda b: b["episodes"]["done"] >= 1)
        self.fill()
        wait_until(lambda: self.call("POST", "/v1/teams", {"team": "late"}), 30, "it is taken",
                   lambda answer: answer[0] == 503)
        self.stop(9)
        self.ballast.unlink()
        self.start()
        status = self.wait(f"/v1/submissions/{submission}", lambda b: b["state"] in FINAL)
        self.assertEqual(status["state"], "done", json.dumps(status))
        self.assertEqual(self.result(submission)["not_repeatable"], [])

    def test_a_start_on_a_full_disk_says_so(self):
        self.stop(15)
        for name in ("store.db-shm", "store.db-wal", "lock"):
            (self.data / name).unlink(missing_ok=True)
        self.fill()
        begin = len(self.daemon.log())
        self.assertNotEqual(self.daemon.launch().wait(timeout=60), 0)
        words = self.daemon.log()[begin:]
        self.assertIn("the disk is full; make room", words)
        self.assertEqual(words.count("error"), 1, words)
        self.ballast.unlink()
        self.start()


class Reserve(SmallDisk):
    reserve = 8 * MIB

    def state(self):
        return self.get("/v1/health")["status"]

    def test_no_lease_begins_below_it_and_logs_of_practice_give_way(self):
        practice = self.submit("logged", team="alpha", episodes=2)
        ranked = self.submit("logged", team="beta")
        for submission in (practice, ranked):
            self.ended(submission)
        artefact = self.upload("ok")
        # The stand-in names logs and writes none.
        logs = {}
        for submission in (practice, ranked):
            for row in self.result(submission)["episode_rows"]:
                path = self.data / "logs" / f"{row['log']['sha256']}.lcmlog.zst"
                path.write_bytes(b"x" * 400_000)
                logs.setdefault(submission, []).append(path)
        self.fill(until=self.reserve // 2)
        wait_until(lambda: [path.exists() for path in logs[practice]], 30, "they stay",
                   lambda there: not any(there))
        self.assertTrue(all(path.exists() for path in logs[ranked]))
        # There was not enough to remove.
        wait_until(self.state, 30, "it goes on", lambda state: state == "paused")
        status, body = self.call("POST", "/v1/submissions", {
            "artefact": artefact, "team": "gamma", "track": "demo-manipulation"})
        self.assertEqual(status, 201, body)
        waiting = body["submission"]
        status = self.wait(f"/v1/submissions/{waiting}", lambda b: b["state"] == "queued")
        self.assertIn("disk_reserve_bytes", json.dumps(status))
        self.assertIn("disk_reserve_bytes", self.get("/v1/health")["message"])
        ready = self.call("GET", "/v1/ready")[1]
        self.assertIn("disk", [reason["code"] for reason in ready["reasons"]])
        self.assertEqual(prometheus.value_of(self.metrics(), "myograde_not_ready", reason="disk"), 1)
        doctor = json.loads(self.daemon.run_verb("doctor", "--json").stdout)["checks"]
        disk = next(check for check in doctor if check["name"] == "disk_data")
        self.assertIn("no lease can start", json.dumps(disk))
        self.assertEqual(self.get(f"/v1/submissions/{waiting}")["state"], "queued")
        self.ballast.unlink()
        status = self.ended(waiting)
        self.assertEqual(status["state"], "done")
        self.assertEqual([block["faults"] for block in status["blocks"]],
                         [0] * len(status["blocks"]))
        self.assertEqual(self.state(), "ok")


if __name__ == "__main__":
    unittest.main(verbosity=2)
