"""Webhooks: what is told, in which order, how it is signed, and that nothing waits for them."""

import json
import os
import pathlib
import re
import signal
import sqlite3
import stat
import time
import unittest

from daemon_test import FINAL, SOURCE
from organiser_test import OrganiserCase
from support.receiver import Receiver
from support.waiting import wait_until

SECRET = "s3cret-" * 4
EVERYTHING = ["submission.finished", "submission.failed", "submission.cancelled",
              "submission.grader_error", "paused", "resumed", "host.paused", "host.resumed",
              "self_test.failed"]
# Of a result: what a phase may withhold, wherever it would be.
WITHHELD = re.compile(r"score|rate|success|seed|outcome|metric|aggregate|episode|reason\": \"every")


def receiver_check():
    """The function of the page for operators, as a receiver would copy it."""
    page = (SOURCE / "server/daemon/OPERATIONS.md").read_text()
    code = re.search(r"^```\n(import hashlib.*?)^```$", page, re.MULTILINE | re.DOTALL).group(1)
    names = {}
    exec(code, names)
    return names["is_from_myograde"]


class WebhookCase(OrganiserCase):
    hooks = (("hook", "ok"),)
    timeout_s = 1

    def setUp(self):
        self.receivers = {name: Receiver(how) for name, how in self.hooks}
        for receiver in self.receivers.values():
            self.addCleanup(receiver.close)
        self.receiver = next(iter(self.receivers.values()))
        super().setUp()

    def start(self):
        self.secret_file = self.folder / "hook.secret"
        self.secret_file.write_text(SECRET + "\n")
        self.secret_file.chmod(0o600)
        self.configure(webhooks=[self.hook(name, r) for name, r in self.receivers.items()])
        super().start()

    def hook(self, name, receiver, **more):
        return {"name": name, "url": receiver.url, "secret_file": str(self.secret_file),
                "events": EVERYTHING, "timeout_s": self.timeout_s, **more}

    def told(self, count, receiver=None, seconds=60):
        receiver = receiver or self.receiver
        return wait_until(lambda: receiver.events, seconds, f"{count} events do not come",
                          lambda events: len(events) >= count)

    def listed(self, name="hook"):
        answer = self.ask("webhook", "list", schema="webhooks")
        return next(hook for hook in answer["webhooks"] if hook["webhook"] == name)


class Events(WebhookCase):
    def test_each_end_and_each_pause_is_told_once_and_in_order(self):
        for mode in ("ok", "crash", "grader"):
            self.ended(self.submit(mode, team="Team \"x\" \\\u00e4"))
        slow = self.submit("slow")
        self.wait(f"/v1/submissions/{slow}", lambda b: b["state"] == "running")
        self.call("POST", f"/v1/submissions/{slow}/cancel", {"reason": "wrong file"})
        self.call("POST", "/v1/pause", {"reason": "a slot is broken"})
        self.call("POST", "/v1/resume", {"reason": "it is mended"})
        self.call("POST", "/v1/submissions/1/rerun", {})
        self.wait("/v1/evaluations/5", lambda b: b["state"] in FINAL)
        events = self.told(6)
        self.assertEqual([event["event"] for event in events], [
            "submission.finished", "submission.failed", "submission.grader_error",
            "submission.cancelled", "paused", "resumed"])
        self.assertEqual({key: events[0][key] for key in events[0] if key not in ("id", "at")}, {
            "event": "submission.finished", "submission": 1, "evaluation": 1, "state": "done",
            "team": "Team \"x\" \\\u00e4", "track": "demo-manipulation", "profile": "paper",
            "phase": None, "ranked": True})
        self.assertEqual((events[4]["phase"], events[4]["reason"]), (None, "a slot is broken"))
        self.assertEqual(len({event["id"] for event in events}), 6)
        for event in events[:4]:
            self.assertNotRegex(json.dumps(event), WITHHELD)
        hook = wait_until(self.listed, 30, "not all are recorded", lambda h: h["delivered"] == 6)
        self.assertEqual((hook["waiting"], hook["given_up"], hook["url"]),
                         (0, 0, self.receiver.url))
        # The rerun was told to nobody, and nothing twice.
        time.sleep(1)
        self.assertEqual(len(self.receiver.events), 6)

    def test_a_receiver_can_check_who_sent_it(self):
        check = receiver_check()
        self.ended(self.submit("ok"))
        self.told(1)
        path, headers, body = self.receiver.requests[0]
        signature = headers["X-MyoGrade-Signature"]
        self.assertEqual((path, headers["Content-Type"]), ("/hook", "application/json"))
        self.assertEqual(headers["Idempotency-Key"], json.loads(body)["id"])
        self.assertTrue(check(SECRET.encode(), signature, body))
        self.assertFalse(check(SECRET.encode() + b"x", signature, body))
        self.assertFalse(check(SECRET.encode(), signature, body + b" "))
        self.assertFalse(check(SECRET.encode(), signature, body, max_age_s=-1))
        shifted = re.sub(r"t=(\d+)", lambda m: f"t={int(m[1]) + 1}", signature)
        for wrong in (shifted, "", "t=,v1=", "v1=" + "0" * 64, "t=\u0661,v1=x", signature[:-1]):
            self.assertFalse(check(SECRET.encode(), wrong, body), wrong)

    def test_what_is_not_taken_comes_again_in_order_with_its_id(self):
        self.receiver.fail_first = 2
        self.call("POST", "/v1/pause", {"reason": "one"})
        self.call("POST", "/v1/resume", {"reason": "two"})
        events = self.told(4, seconds=60)
        self.assertEqual([e["reason"] for e in events[:4]], ["one", "one", "one", "two"])
        self.assertEqual(len({(e["id"]) for e in events[:3]}), 1)
        self.assertEqual(len({body for _, _, body in self.receiver.requests[:3]}), 1)

    def test_the_host_is_told_of(self):
        self.configure(scheduler={"suspect_after": 1, "self_test_every_s": 1, "max_retries": 100})
        self.stop(signal.SIGTERM)
        runner = self.folder / "bin" / "myograde-runner"
        text = runner.read_text()
        runner.write_text("#!/bin/sh\nexit 3\n")
        self.start()
        submission = self.submit("ok")
        wait_until(lambda: [e["event"] for e in self.receiver.events], 60, "nobody is told",
                   lambda names: "host.paused" in names and "self_test.failed" in names)
        runner.write_text(text)
        wait_until(lambda: [e["event"] for e in self.receiver.events], 60, "nobody is told",
                   lambda names: names.count("host.resumed") == 1)
        self.ended(submission)
        names = [e["event"] for e in self.receiver.events]
        self.assertEqual(names.count("host.paused"), 1)


class Hostile(WebhookCase):
    hooks = (("good", "ok"), ("hang", "hang"), ("reset", "reset"), ("endless", "endless"),
             ("head", "endless_head"), ("dribble", "dribble"), ("redirect", "redirect"),
             ("fail", "fail"))
    timeout_s = 2

    def test_grading_requests_and_the_stop_wait_for_none(self):
        undisturbed = self.submit("ok", team="calm")
        self.ended(undisturbed)
        # By now each of them has been told, and holds on to it as long as it can.
        for name, receiver in self.receivers.items():
            self.told(1, receiver)
        begin = time.monotonic()
        submission = self.submit("ok", team="shaken")
        self.ended(submission)
        self.assertLess(time.monotonic() - begin, 30)
        first, second = (self.result(n) for n in (undisturbed, submission))
        self.assertEqual(first["aggregate"], second["aggregate"])
        self.assertEqual([row["digest"] for row in first["episode_rows"]],
                         [row["digest"] for row in second["episode_rows"]])
        self.told(2, self.receivers["good"])
        status = pathlib.Path(f"/proc/{self.daemon.pid}/status").read_text()
        memory = int(re.search(r"VmHWM:\s+(\d+) kB", status).group(1))
        self.assertLess(memory, 1 << 20, "an endless answer is kept")
        problems = {}
        for hook in self.ask("webhook", "list", schema="webhooks")["webhooks"]:
            oldest = hook["deliveries"][-1]
            problems[hook["webhook"]] = oldest["problem"]
            self.assertEqual(oldest["state"],
                             "delivered" if hook["webhook"] == "good" else "waiting", hook)
        self.assertIsNone(problems["good"])
        self.assertIn("it answered 302, and redirects are not followed", problems["redirect"])
        self.assertIn("it answered 500", problems["fail"])
        self.assertTrue(all(path == "/hook" for path, _, _ in self.receivers["redirect"].requests))
        begin = time.monotonic()
        self.assertEqual(self.stop(signal.SIGTERM), 0)
        self.assertLess(time.monotonic() - begin, 6)
        self.assertNotIn("without waiting for blocked threads", self.daemon.log())

    def test_a_test_tells_how_it_went(self):
        for name, delivered in (("good", True), ("fail", False), ("hang", False)):
            done = self.cli("webhook", "test", name, "--json", check=False)
            self.assertEqual(done.returncode, 0 if delivered else 1, done.stderr)
            self.assertEqual(json.loads(done.stdout)["delivered"], delivered)
        self.assertEqual(self.receivers["good"].events[0]["event"], "test")
        self.assertIn("it was not done within 2s", self.cli("webhook", "test", "hang",
                                                           check=False).stdout)
        unknown = self.cli("webhook", "test", "nobody", check=False)
        self.assertEqual(unknown.returncode, 2)
        self.assertIn('server.json has no webhook "nobody"', unknown.stderr)
        self.assertIn("good at http://127.0.0.1", self.cli("webhook", "list").stdout)


class Store(WebhookCase):
    hooks = (("hook", "hang"), ("other", "ok"))

    def test_what_waits_survives_a_kill_and_is_delivered_then(self):
        self.ended(self.submit("ok"))
        self.told(1)
        self.stop(signal.SIGKILL)
        self.receiver.how = "ok"
        before = len(self.receiver.events)
        self.start()
        events = self.told(before + 1)
        self.assertEqual(len({event["id"] for event in events}), 1)
        wait_until(self.listed, 30, "it waits", lambda hook: hook["waiting"] == 0)

    def test_an_old_event_is_given_up_with_a_line_and_a_number(self):
        self.stop(signal.SIGTERM)
        original = self.hook

        def hasty(name, receiver, **more):
            return original(name, receiver, give_up_after_h=0.001, **more)
        self.hook = hasty
        self.start()
        self.call("POST", "/v1/pause", {"reason": "x"})
        wait_until(self.listed, 60, "it is never given up", lambda hook: hook["given_up"] == 1)
        self.assertRegex(self.daemon.log(), r"webhook hook: delivery \d+ \(paused\) is given up after")

    def test_what_waits_for_a_webhook_that_is_no_more_is_given_up(self):
        self.call("POST", "/v1/pause", {"reason": "x"})
        self.told(1)
        self.stop(signal.SIGTERM)
        del self.receivers["hook"]
        self.start()
        self.assertIn("whose webhooks are no longer in server.json", self.daemon.log())
        states = sqlite3.connect(self.data / "store.db").execute(
            "SELECT state FROM delivery WHERE webhook = 'hook'").fetchall()
        self.assertEqual(states, [("given_up",)])

    def test_a_damaged_row_is_given_up_and_the_others_go_on(self):
        self.call("POST", "/v1/pause", {"reason": "x"})
        self.told(1)
        self.stop(signal.SIGKILL)
        db = sqlite3.connect(self.data / "store.db")
        db.execute("UPDATE delivery SET body_json = 'garbage', state = 'waiting' WHERE "
                   "webhook = 'other'")
        db.commit()
        db.close()
        self.start()
        self.call("POST", "/v1/resume", {"reason": "y"})
        other = self.receivers["other"]
        wait_until(lambda: [e["event"] for e in other.events], 30, "it stops there",
                   lambda names: names[-1:] == ["resumed"])
        self.assertEqual(self.listed("other")["given_up"], 1)

    def test_no_export_has_them(self):
        self.ended(self.submit("ok"))
        self.stop(signal.SIGTERM)
        self.start()
        self.assertNotIn("delivery", self.get("/v1/export")["data"])


class Mistakes(WebhookCase):
    def refused(self, message, **changes):
        self.configure(webhooks=[{**self.hook("hook", self.receiver), **changes}])
        self.assertEqual(self.daemon.launch().wait(timeout=30), 2)
        self.assertIn(message, self.daemon.log())

    def test_each_is_one_sentence_at_the_start(self):
        self.stop(signal.SIGTERM)
        self.refused('webhook "hook": its "url" must begin with https://; plain http is for this '
                     "host only", url="http://192.0.2.1/x")
        self.refused('its "url" must begin with https://', url="ftp://example.org/x")
        self.refused('its "url" must have no user or password', url="https://a:b@example.org/x")
        self.refused('its "url" is not a URL', url="https://[")
        self.refused('webhooks[0]: "events" has "finished"', events=["finished"])
        self.refused('must name at least one event', events=[])
        self.refused('must be 1 to 64 letters', name="a b")
        self.refused('"timeout_s" is 0', timeout_s=0)
        self.refused("the authority's certificate can't be read", ca_file="/nonexistent")
        self.refused("the secret can't be read (No such file or directory)",
                     secret_file="/nonexistent")
        self.refused("is not a file", secret_file="/tmp")
        self.secret_file.write_text("short")
        self.refused("must hold one line of 16 to 1024 printable characters")
        self.secret_file.write_text(SECRET)
        self.secret_file.chmod(0o640)
        self.refused(f'others than its owner may read or write this secret; run "chmod 600 '
                     f'{self.secret_file}"')
        os.mkfifo(self.folder / "pipe")
        self.refused("is not a file", secret_file=str(self.folder / "pipe"))
        self.assertEqual(stat.S_IMODE(self.secret_file.stat().st_mode), 0o640)

    def test_two_of_a_name_are_one_too_many(self):
        self.stop(signal.SIGTERM)
        self.configure(webhooks=[self.hook("hook", self.receiver)] * 2)
        self.assertEqual(self.daemon.launch().wait(timeout=30), 2)
        self.assertIn('webhooks[1]: "name" is "hook", as is an earlier one\'s', self.daemon.log())


if __name__ == "__main__":
    unittest.main(verbosity=2)
