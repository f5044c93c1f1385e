"""The real daemon on its real socket, with runners that play without physics."""

import concurrent.futures
import os
import pathlib
import signal
import socket
import time
import unittest

from support.client import Connection, exchange
from support.daemon import Daemon
from support.submission import played_by_stand_in
from support.waiting import wait_until

BIN = pathlib.Path(os.environ["MYOGRADE_TEST_BIN"])
SOURCE = pathlib.Path(os.environ["MYOGRADE_TEST_SOURCE"])
FINAL = ("done", "failed", "cancelled", "grader_error")


class DaemonCase(unittest.TestCase):
    slots = 2

    def setUp(self):
        self.daemon = Daemon(BIN, SOURCE, "daemon")
        self.addCleanup(self.daemon.close)
        self.folder, self.configs = self.daemon.root, self.daemon.configs
        self.daemon.use_stand_in_runner()
        # Run directly, not by the command line tool, whose start would be disturbed as well.
        self.daemon.command = [BIN / "myograded"]
        self.daemon.environment["MYOGRADE_CACHE"] = str(self.folder / "cache")
        self.daemon.change_config("tracks/demo-manipulation.json", episodes_per_lease=2,
                                  seeds={"first": 0, "count": 6},
                                  practice_seeds={"first": 100, "count": 6})
        self.configure(slots=self.slots)
        self.start()

    def tearDown(self):
        self.daemon.kill()

    @property
    def data(self):
        return self.daemon.data

    def configure(self, **changes):
        scheduler = {"retry_delay_s": 0.01, **changes.pop("scheduler", {})}
        self.daemon.configure(scheduler=scheduler, **changes)

    def start(self):
        self.daemon.start()

    def stop(self, how):
        return self.daemon.stop(how)

    def call(self, method, path, body=None, kind=None, uid=None):
        return self.daemon.call(method, path, body, kind, uid)

    def get(self, path):
        status, body = self.call("GET", path)
        self.assertEqual(status, 200, body)
        return body

    def upload(self, mode, name="fake"):
        status, body = self.call("POST", "/v1/artefacts", played_by_stand_in(mode, name))
        self.assertIn(status, (200, 201), body)
        return body["artefact"]

    def submit(self, mode, team="alpha", **more):
        status, body = self.call("POST", "/v1/submissions", {
            "artefact": self.upload(mode), "team": team, "track": "demo-manipulation", **more})
        self.assertEqual(status, 201, body)
        return body["submission"]

    def wait(self, path, condition):
        return wait_until(lambda: self.get(path), 60, f"{path} stays", condition)

    def ended(self, submission):
        return self.wait(f"/v1/submissions/{submission}", lambda b: b["state"] in FINAL)

    def result(self, submission):
        return self.get(f"/v1/submissions/{submission}/result?episodes=1")


class Grading(DaemonCase):
    def test_a_submission_is_graded_and_ranked(self):
        submission = self.submit("ok")
        status = self.ended(submission)
        self.assertEqual(status["state"], "done")
        self.assertEqual([(l["first"], l["last"]) for l in status["blocks"]],
                         [(0, 1), (2, 3), (4, 5)])
        result = self.result(submission)
        self.assertEqual(result["aggregate"]["successes"], 3)
        self.assertEqual(result["aggregate"]["success_rate"], 0.5)
        self.assertEqual(result["outcomes"], {"failure": 3, "success": 3})
        self.assertEqual([row["index"] for row in result["episode_rows"]], list(range(6)))
        self.assertEqual(result["output"][0]["stderr_tail"], "hello from the policy")
        self.submit("ok", team="alpha", episodes=4)
        self.submit("crash", team="faulty")
        for other in (2, 3):
            self.ended(other)
        self.assertEqual(self.get("/v1/submissions/3")["state"], "failed")
        board = self.get("/v1/leaderboard?track=demo-manipulation")
        self.assertEqual([(r["rank"], r["team"], r["submission"]) for r in board["rows"]],
                         [(1, "alpha", 1)])
        listed = self.get("/v1/submissions?state=done&limit=1")
        self.assertEqual((listed["submissions"][0]["submission"], listed["next_before"]), (2, 2))
        self.assertFalse(listed["submissions"][0]["ranked"])

    def test_every_track_has_its_boards(self):
        tracks = self.get("/v1/tracks")["tracks"]
        self.assertIn("reorientation", {track["track"] for track in tracks}, "one by score, without settings")
        for track in tracks:
            for board in track["boards"]:
                with self.subTest(track=track["track"], board=board):
                    asked = f"track={track['track']}&board={board}"
                    shown = self.get(f"/v1/leaderboard?{asked}")
                    self.assertTrue(shown["order"])
                    self.assertIsInstance(shown["rules"], dict)
                    self.get(f"/v1/leaderboard/statistics?{asked}")

    def test_a_rerun_plays_whole_leases_and_is_compared(self):
        submission = self.submit("ok")
        self.ended(submission)
        status, rerun = self.call("POST", f"/v1/submissions/{submission}/rerun",
                                  {"first": 3, "last": 3})
        self.assertEqual((status, rerun["first"], rerun["last"]), (201, 2, 3))
        path = f"/v1/evaluations/{rerun['evaluation']}"
        comparison = self.wait(path, lambda b: b["state"] in FINAL)["comparison"]
        self.assertEqual((comparison["compared"], comparison["equal"], comparison["missing"]),
                         (2, 2, 0))
        other = self.submit("unrepeatable")
        self.ended(other)
        _, rerun = self.call("POST", f"/v1/submissions/{other}/rerun", {})
        comparison = self.wait(f"/v1/evaluations/{rerun['evaluation']}",
                               lambda b: b["state"] in FINAL)["comparison"]
        self.assertEqual((comparison["compared"], comparison["equal"]), (6, 0))
        self.assertEqual(comparison["episodes"][0]["differs"], ["digest"])
        self.assertEqual(len(self.get("/v1/leaderboard?track=demo-manipulation")["rows"]), 1)

    def test_the_graders_faults_are_played_again_and_then_given_up(self):
        once, never, garbage, dies = (self.submit(mode) for mode in (
            "once", "grader", "garbage", "dies"))
        status = self.ended(once)
        self.assertEqual(status["state"], "done")
        self.assertEqual([(l["attempt"], l["faults"]) for l in status["blocks"]], [(2, 1)] * 3)
        self.assertEqual(self.result(once)["not_repeatable"], [])
        for submission, why in ((never, "vanished"), (garbage, "record"), (dies, "out of luck")):
            status = self.ended(submission)
            self.assertEqual(status["state"], "grader_error")
            self.assertIn(why, status["reason"])
        board = self.get("/v1/leaderboard?track=demo-manipulation")
        self.assertEqual([r["submission"] for r in board["rows"]], [once])

    def test_cancel_kills_within_a_second_and_keeps_what_is_there(self):
        submission = self.submit("slow", seeds=list(range(200, 300)))
        self.wait(f"/v1/submissions/{submission}", lambda b: b["episodes"]["done"] >= 2)
        begin = time.monotonic()
        status, body = self.call("POST", f"/v1/submissions/{submission}/cancel",
                                 {"reason": "wrong file"})
        self.assertLess(time.monotonic() - begin, 2)
        self.assertEqual((status, body["state"], body["reason"]), (200, "cancelled", "wrong file"))
        self.assertGreaterEqual(body["episodes"]["done"], 2)
        self.assertEqual(self.get("/v1/health")["running"], 0)
        status, body = self.call("POST", f"/v1/submissions/{submission}/cancel", {})
        self.assertEqual((status, body["error"]["code"]), (409, "conflict"))
        self.assertEqual(os.listdir(self.data / "work"), [])


class Stopping(DaemonCase):
    def rows(self, submission):
        rows = self.result(submission)["episode_rows"]
        return [{k: v for k, v in row.items() if k not in ("wall_s", "attempt")} for row in rows]

    def test_kills_at_any_time_lose_nothing(self):
        undisturbed = self.submit("ok", team="calm")
        self.ended(undisturbed)
        submission = self.submit("slow", team="shaken")
        for how in (signal.SIGTERM, signal.SIGKILL, signal.SIGKILL, signal.SIGTERM):
            time.sleep(0.25)
            code = self.stop(how)
            self.assertEqual(code, 0 if how == signal.SIGTERM else -signal.SIGKILL)
            self.start()
        status = self.ended(submission)
        self.assertEqual(status["state"], "done")
        self.assertEqual([l["faults"] for l in status["blocks"]], [0, 0, 0])
        # The same policy in another artefact has the same policy seeds, so the same digests.
        self.assertEqual(self.rows(submission), self.rows(undisturbed))
        self.assertEqual(self.result(submission)["not_repeatable"], [])
        self.call("POST", f"/v1/submissions/{submission}/rerun", {})
        comparison = self.wait("/v1/evaluations/3", lambda b: b["state"] in FINAL)["comparison"]
        self.assertEqual(comparison["equal"], 6)

    def test_an_unrepeatable_policy_is_told_from_a_disturbance(self):
        self.configure(slots=1)
        self.stop(signal.SIGTERM)
        self.start()
        submission = self.submit("unrepeatable")
        self.wait(f"/v1/submissions/{submission}", lambda b: b["episodes"]["done"] == 1)
        self.stop(signal.SIGKILL)
        self.start()
        self.ended(submission)
        self.assertEqual(self.result(submission)["not_repeatable"],
                         [{"index": 0, "differs": ["digest"]}])

    def test_a_second_daemon_refuses(self):
        second = self.daemon.launch()
        self.assertEqual(second.wait(timeout=20), 4)
        self.assertIn(f"another daemon (process {self.daemon.pid}) works on", self.daemon.log())
        self.get("/v1/health")

    def test_a_broken_receipt_key_stops_receipts_alone(self):
        path = self.data / "receipts.key"
        self.assertEqual(path.stat().st_mode & 0o777, 0o600, "made before anybody asks for it")
        with concurrent.futures.ThreadPoolExecutor(40) as pool:
            keys = set(pool.map(lambda _: self.get("/v1/key")["key"], range(200)))
        self.assertEqual(len(keys), 1)
        self.stop(signal.SIGTERM)
        good = path.read_bytes()
        path.write_bytes(good[:60])
        self.start()
        submission = self.submit("ok")
        self.assertEqual(self.ended(submission)["state"], "done")
        for address in ("/v1/key", f"/v1/submissions/{submission}/receipt"):
            status, body = self.call("GET", address)
            self.assertEqual((status, body["error"]["code"]), (500, "internal"))
            self.assertIn("receipts.key: holds no Ed25519 private key", body["error"]["message"])
        self.assertEqual(path.read_bytes(), good[:60])
        path.write_bytes(good)
        self.assertEqual({self.get("/v1/key")["key"]}, keys)

    def test_a_broken_config_is_told_at_the_start(self):
        self.stop(signal.SIGTERM)
        self.configure(slots=0)
        self.assertEqual(self.daemon.launch().wait(timeout=20), 2)
        self.configure(slots=1, http={"colour": "red"})
        self.assertEqual(self.daemon.launch().wait(timeout=20), 2)
        log = self.daemon.log()
        self.assertIn('"slots" is 0, must be from 1 to 1024', log)
        self.assertIn('"colour" is not a known key', log)


class BadRequests(DaemonCase):
    def test_each_gets_a_sentence_and_changes_nothing(self):
        known = self.upload("ok")
        good = {"artefact": known, "team": "a", "track": "demo-manipulation"}
        posts = [
            ({**good, "track": "runing"}, 400, "unknown_track"),
            ({**good, "profile": "none"}, 400, "unknown_profile"),
            ({**good, "artefact": "f" * 64}, 404, "not_found"),
            ({**good, "artefact": "../../etc"}, 400, "bad_request"),
            ({**good, "team": ""}, 400, "bad_request"),
            ({**good, "team": "a\u001b[31m"}, 400, "bad_request"),
            ({**good, "team": "a\u202eb"}, 400, "bad_request"),
            ({**good, "team": 7}, 400, "bad_request"),
            ({**good, "episodes": 0}, 400, "bad_request"),
            ({**good, "episodes": -3}, 400, "bad_request"),
            ({**good, "episodes": 7}, 400, "bad_request"),
            ({**good, "episodes": 10**9}, 400, "bad_request"),
            ({**good, "episodes": 1.5}, 400, "bad_request"),
            ({**good, "seeds": []}, 400, "bad_request"),
            ({**good, "seeds": [1, 1]}, 400, "bad_request"),
            ({**good, "seeds": [-1]}, 400, "bad_request"),
            ({**good, "seeds": [2**63]}, 400, "bad_request"),
            ({**good, "color": "red"}, 400, "bad_request"),
            ({"team": "a"}, 400, "bad_request"),
            ([], 400, "bad_request"),
            ("{", 400, "bad_request"),
            ('{"team": "a", "team": "b"}', 400, "bad_request"),
            (b'{"team": "\xff"}', 400, "bad_request"),
            ("", 400, "bad_request"),
            ("[" * 2000, 400, "bad_request"),
            (" " * (1 << 21), 413, "too_large"),
        ]
        for body, status, code in posts:
            answer = self.call("POST", "/v1/submissions", body)
            self.assertEqual((answer[0], answer[1]["error"]["code"]), (status, code),
                             (str(body)[:80], answer))
            self.assertTrue(answer[1]["error"]["message"])
        gets = [("/v1/submissions/1", 404), ("/v1/submissions/x", 404), ("/nothing", 404),
                ("/v1/submissions/99999999999999999999", 404), ("/v1/evaluations/1", 404),
                ("/v1/submissions?limit=0", 400), ("/v1/submissions?colour=red", 400),
                ("/v1/submissions?state=odd", 400), ("/v1/leaderboard", 400),
                ("/v1/leaderboard?track=demo-manipulation&board=physiological", 400)]
        for path, status in gets:
            answer = self.call("GET", path)
            self.assertEqual(answer[0], status, (path, answer))
            self.assertIn("message", answer[1]["error"])
        self.assertEqual(self.get("/v1/submissions")["submissions"], [])

    def test_bad_archives(self):
        for body in (b"", b"junk" * 1000, played_by_stand_in("ok")[:700]):
            status, answer = self.call("POST", "/v1/artefacts", body)
            self.assertEqual((status, answer["error"]["code"]), (400, "bad_artefact"), answer)
        self.assertEqual(os.listdir(self.data / "spool"), [])
        self.assertEqual(os.listdir(self.data / "artefacts"), [])
        # A long request that is rejected early is read to its end, so that the client gets the
        # reason.
        status, answer = self.call("POST", "/v1/artefacts?team=a&track=none", bytes(80 << 20))
        self.assertEqual((status, answer["error"]["code"]), (400, "unknown_track"), answer)
        self.assertNotEqual(self.upload("ok"), self.upload("slow"))
        status, answer = self.call("POST", "/v1/artefacts", played_by_stand_in("ok"))
        self.assertEqual((status, answer["new"]), (200, False))

    def test_rerun_needs_an_end_and_a_range(self):
        submission = self.submit("slow")
        path = f"/v1/submissions/{submission}/rerun"
        self.assertEqual(self.call("POST", path, {})[0], 409)
        self.ended(submission)
        for body in ({"first": 3}, {"first": 3, "last": 2}, {"first": 0, "last": 6},
                     {"first": -1, "last": 2}):
            self.assertEqual(self.call("POST", path, body)[0], 400, body)


class ManyClients(DaemonCase):
    def test_silent_and_slow_clients_do_not_keep_others_waiting(self):
        path = str(self.daemon.socket_path)
        silent = [socket.socket(socket.AF_UNIX) for _ in range(100)]
        for index, client in enumerate(silent):
            client.connect(path)
            if index < 8:
                client.send(b"GET /v1/hea")  # and no more
        try:
            begin = time.monotonic()
            with concurrent.futures.ThreadPoolExecutor(64) as pool:
                answers = list(pool.map(lambda _: self.get("/v1/health"), range(256)))
            self.assertTrue(all(answer["status"] == "ok" for answer in answers))
            self.assertLess(time.monotonic() - begin, 20)
        finally:
            for client in silent:
                client.close()

    def test_one_connection_carries_many_requests(self):
        connection = Connection(self.daemon.socket_path)
        for _ in range(20):
            self.assertEqual(exchange(connection, "GET", "/v1/tracks")[0], 200)
        connection.close()


if __name__ == "__main__":
    unittest.main(verbosity=2)
