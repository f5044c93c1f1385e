"""Deadlines, leases, priorities and the host's health in the real daemon, with runners that
play without physics."""

import concurrent.futures
import os
import signal
import time
import unittest

from daemon_test import DaemonCase


class Scheduling(DaemonCase):
    """Deadlines, priorities and the host's health, as a user sees them."""

    def restart(self, **changes):
        self.configure(**changes)
        self.stop(signal.SIGTERM)
        self.start()

    def test_a_cancel_waits_for_nobody_and_tells_what_it_killed(self):
        stubborn = self.submit("stubborn", episodes=2, seeds=[200, 201])
        self.wait("/v1/health", lambda b: any(l["step"] for l in b["leases"]))
        with concurrent.futures.ThreadPoolExecutor(1) as pool:
            begin = time.monotonic()
            cancel = pool.submit(self.call, "POST", f"/v1/submissions/{stubborn}/cancel", {})
            # Meanwhile the loop serves others, whose changes of the store need it. Were it to wait, one
            # would have come before the cancel, and one be answered after it.
            served = 0
            while not cancel.done():
                self.assertEqual(self.call("POST", "/v1/teams", {"team": f"other-{served}"})[0], 201)
                served += 1
            self.assertGreater(served, 2)
            status, body = cancel.result()
            self.assertLess(time.monotonic() - begin, 1.5)
        self.assertEqual((status, body["state"]), (200, "cancelled"))
        self.assertEqual((body["cancel"]["killed"], body["cancel"]["still_ending"]), (1, 0))
        self.assertLess(body["cancel"]["took_wall_s"], 1)
        self.assertGreater(body["cancel"]["took_wall_s"], 0.6, "it had its time to clean up")

    def test_a_silent_runner_loses_its_lease(self):
        self.restart(scheduler={"heartbeat_s": 2})
        submission = self.submit("mute")
        status = self.wait(f"/v1/submissions/{submission}",
                           lambda b: b["blocks"][0]["attempt"] == 2)
        self.assertEqual(status["blocks"][0]["faults"], 1)
        self.assertIn("was not renewed", status["blocks"][0]["detail"])

    def test_a_stopped_runner_is_replaced_and_the_result_is_the_same(self):
        self.restart(scheduler={"heartbeat_s": 2})
        submission = self.submit("slow", seeds=list(range(200, 212)))
        status = self.wait(f"/v1/submissions/{submission}",
                           lambda b: any(l["process"] for l in b["blocks"]))
        running = [block for block in status["blocks"] if block["process"]][0]
        os.kill(running["process"], signal.SIGSTOP)
        status = self.ended(submission)
        self.assertEqual(status["state"], "done")
        again = [l for l in status["blocks"] if l["block"] == running["block"]][0]
        self.assertEqual((again["attempt"], again["faults"]), (2, 1))
        self.assertEqual(self.result(submission)["not_repeatable"], [])

    def test_status_tells_place_owner_deadline_and_history(self):
        self.restart(slots=1)
        self.ended(self.submit("ok"))
        first = self.submit("slow", team="a", seeds=list(range(200, 240)))
        practice = self.submit("slow", team="b", episodes=2)
        official = self.submit("slow", team="c")
        places = {}
        for submission in (first, practice, official):
            status = self.get(f"/v1/submissions/{submission}")
            self.assertIsNotNone(status["deadline_at"])
            self.assertIn("daemon", status["owner"])
            self.assertEqual(status["history"][0]["of"], "submission")
            places[submission] = status["queue"] and status["queue"]["position"]
        self.assertLess(places[official], places[practice], "official goes before practice")
        # Between two leases the slot is free for a moment.
        waits = self.wait(f"/v1/submissions/{practice}",
                          lambda b: "1 of 1 is taken" in (b["waiting"] or ""))
        self.assertIsNotNone(waits["estimated_end_at"])
        health = self.get("/v1/health")
        self.assertEqual([l["slot"] for l in health["leases"]], [0])
        self.call("POST", f"/v1/submissions/{first}/cancel", {"reason": "enough"})
        status = self.get(f"/v1/submissions/{first}")
        self.assertEqual([status["owner"], status["deadline_at"]], [None, None])
        last = status["history"][-1]
        self.assertEqual((last["to"], last["why"]), ("cancelled", "enough"))
        self.assertTrue(last["who"].startswith("uid"))
        for submission in (official, practice):
            self.assertEqual(self.ended(submission)["state"], "done")

    def test_what_waits_too_long_goes_ahead_and_says_so(self):
        self.restart(slots=1, scheduler={"queue_wait_s": 1})
        official = [self.submit("slow", team=team) for team in "cde"]
        waits = self.submit("slow", team="b", episodes=2)
        status = self.ended(waits)
        self.assertEqual(status["state"], "done")
        self.assertIn("goes first", " ".join(row["why"] or "" for row in status["history"]))
        self.assertEqual([self.ended(other)["state"] for other in official], ["done"] * 3)

    def test_a_broken_host_pauses_and_resumes_by_itself(self):
        self.restart(scheduler={"self_test_every_s": 2, "retry_delay_s": 0.2})
        broken = self.folder / "bin" / "broken"
        broken.write_text("the models are gone")
        submission = self.submit("ok")
        health = self.wait("/v1/health", lambda b: b["host"]["state"] == "paused")
        self.assertEqual(health["status"], "paused")
        self.assertIn("the models are gone", health["host"]["reason"])
        status = self.get(f"/v1/submissions/{submission}")
        self.assertIn("is paused", status["waiting"])
        doctor = self.daemon.ask("doctor", check=False)
        check = {c["name"]: c for c in doctor["checks"]}["daemon"]
        self.assertEqual(check["state"], "missing")
        self.assertIn("the models are gone", check["found"])
        time.sleep(3)
        later = self.get(f"/v1/submissions/{submission}")
        self.assertEqual([l["attempt"] for l in later["blocks"]],
                         [l["attempt"] for l in status["blocks"]], "nothing starts")
        broken.unlink()
        self.assertEqual(self.ended(submission)["state"], "done")
        self.assertEqual(self.get("/v1/health")["host"]["state"], "well")

    def test_a_faulty_submission_does_not_pause_a_host_that_passes(self):
        bad, good = self.submit("grader", team="bad"), self.submit("slow", team="good")
        self.assertEqual(self.ended(bad)["state"], "grader_error")
        self.assertEqual(self.ended(good)["state"], "done")
        self.assertEqual(self.get("/v1/health")["host"]["state"], "well")


if __name__ == "__main__":
    unittest.main(verbosity=2)
