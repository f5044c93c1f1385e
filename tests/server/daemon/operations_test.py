"""What operators see: metrics, readiness and the log."""

import json
import re
import signal
import sqlite3
import unittest

import jsonschema

from daemon_test import SOURCE, DaemonCase
from roles_test import TRACK, AccessCase
from support import prometheus
from support.schemas import validate
from support.waiting import wait_until

PAGE = "server/daemon/OPERATIONS.md"
HOSTILE = 'a"} 1\nmyograde_ready 0\n{"level":"critical"}\u2028\u202e\x1b[2J\\'


def documented():
    """The metrics of the page's table: {name: set of labels}."""
    metrics = {}
    for line in (SOURCE / PAGE).read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 3 and cells[0].startswith("`myograde_"):
            for name in re.findall(r"`(\w+)`", cells[0]):
                metrics[name] = set(re.findall(r"`(\w+)`", cells[1]))
    return metrics


class Metrics(AccessCase):
    def start(self):
        self.token_file = self.folder / "metrics.token"
        self.token_file.write_text("0123456789abcdef" * 2 + "\n")
        self.token_file.chmod(0o600)
        self.configure(metrics={"token_file": str(self.token_file)})
        super().start()

    def scrape(self, token=None):
        status, headers, text = self.ask_as(token or "0123456789abcdef" * 2, "GET", "/metrics")
        self.assertEqual(status, 200, text)
        self.assertEqual(headers["Content-Type"], "text/plain; version=0.0.4; charset=utf-8")
        return prometheus.parse(text.decode())

    def value(self, name, **labels):
        return prometheus.value_of(self.scrape(), name, **labels)

    def test_each_is_described_and_nothing_else(self):
        families = self.scrape()
        known = documented()
        self.assertLessEqual(set(families), set(known))
        # Those that have a label may have no value yet.
        self.assertLessEqual({name for name, labels in known.items() if not labels}, set(families))
        for name, family in families.items():
            self.assertRegex(name, "^myograde_")
            self.assertEqual(name.endswith("_total"), family["type"] == "counter", name)
            self.assertGreater(len(family["help"]), 10, name)
            for _, labels, _ in family["samples"]:
                self.assertEqual(set(labels) - {"le"}, known[name], name)

    def test_they_count_what_happens(self):
        before = self.scrape()
        self.ended(self.submit_as("alpha", "ok", "counted"))
        self.ended(self.submit_as("alpha", "crash", "crashing"))
        self.ended(self.submit_as("alpha", "once", "flaky"))
        self.ask_as(self.tokens["beta"], "GET", "/v1/tokens")
        after = self.scrape()

        def grown(name, **labels):
            return ((prometheus.value_of(after, name, **labels) or 0)
                    - (prometheus.value_of(before, name, **labels) or 0))
        self.assertEqual(grown("myograde_episodes_total", track=TRACK, outcome="crash"), 6)
        self.assertEqual(grown("myograde_participant_faults_total", kind="crash"), 6)
        # Three each, and three that were played again after a fault.
        self.assertEqual(grown("myograde_episodes_total", track=TRACK, outcome="success"), 9)
        self.assertEqual(grown("myograde_grader_faults_total", kind="report"), 3)
        self.assertEqual(grown("myograde_lease_duration_seconds_count", track=TRACK), 9)
        self.assertEqual(grown("myograde_submissions", state="done"), 2)
        self.assertEqual(grown("myograde_submissions", state="failed"), 1)
        self.assertEqual(grown("myograde_denials_total", reason="role"), 1)
        self.assertEqual(grown("myograde_http_requests_total", action="submit", code="201"), 3)
        self.assertEqual(grown("myograde_http_requests_total", action="manage tokens", code="403"), 1)
        self.assertGreater(grown("myograde_store_write_duration_seconds_count"), 6)
        self.assertGreater(grown("myograde_store_read_duration_seconds_count"), 6)
        self.assertGreater(prometheus.value_of(after, "myograde_store_size_bytes"), 100_000)
        self.assertGreater(prometheus.value_of(after, "myograde_disk_free_bytes", folder="data"), 0)
        self.assertEqual(prometheus.value_of(after, "myograde_slots"), self.slots)
        self.assertEqual(prometheus.value_of(after, "myograde_store_writable"), 1)

    def series(self):
        """The names and labels of all, without buckets."""
        return {(name, tuple(sorted((k, v) for k, v in labels.items() if k != "le")))
                for name, family in self.scrape().items() for _, labels, _ in family["samples"]}

    def test_the_queue_has_its_length_and_age(self):
        for name in ("x", "y"):
            self.submit_as("alpha", "stubborn", name)
        self.submit_as("beta", "ok", "waits")
        wait_until(lambda: self.value("myograde_slots_busy"), 30, "no slot is busy",
                   lambda busy: busy == self.slots)
        families = self.scrape()
        self.assertGreaterEqual(
            prometheus.value_of(families, "myograde_queue_evaluations", **{"class": "ranked"}), 1)
        self.assertGreaterEqual(
            prometheus.value_of(families, "myograde_queue_blocks", **{"class": "ranked"}), 3)
        first = prometheus.value_of(families, "myograde_queue_oldest_wait_seconds")
        running = prometheus.value_of(families, "myograde_lease_oldest_running_seconds")
        later = wait_until(self.scrape, 30, "the oldest stays young", lambda now:
                           prometheus.value_of(now, "myograde_queue_oldest_wait_seconds") > first)
        self.assertGreater(prometheus.value_of(later, "myograde_lease_oldest_running_seconds"),
                           running)

    def test_the_scrapers_token_opens_nothing_else(self):
        token = self.token_file.read_text().strip()
        for path in ("/v1/events", "/v1/tracks", "/v1/whoami"):
            status, _, text = self.ask_as(token, "GET", path)
            self.assertEqual((status, json.loads(text)["error"]["code"]), (401, "bad_token"))
        self.scrape()
        self.scrape(self.tokens["organiser"])
        self.assertEqual(self.ask_as(self.tokens["alpha"], "GET", "/metrics")[0], 403)
        self.assertEqual(self.ask_as(None, "GET", "/metrics")[0], 401)
        for wrong in (token[:-1], token + "0", token.upper(), ""):
            self.assertIn(self.ask_as(wrong, "GET", "/metrics")[0], (401, 429))
        # Guesses cost the address time, and not the scraper that was there before.
        for _ in range(6):
            self.ask_as("wrong" * 8, "GET", "/metrics")
        self.scrape()

    def test_no_text_of_others_is_a_label(self):
        before = self.series()
        for path in ("/v1/nothing%0a%22", "/v1/teams/" + "x" * 60, "/metrics%22%7d"):
            self.ask_as(self.tokens["operator"], "GET", path)
        self.call("POST", "/v1/teams", {"team": HOSTILE})
        self.ask_as("myo_" + "0" * 64, "GET", "/v1/nothing")
        after = self.series()
        for name, labels in after:
            for _, value in labels:
                self.assertNotRegex(value, r'["\n{}]|nothing|xxx', name)
        self.assertLessEqual(len(after - before), 10)

    def test_a_token_that_others_can_read_keeps_the_daemon_from_starting(self):
        self.stop(signal.SIGTERM)
        self.token_file.chmod(0o644)
        self.assertEqual(self.daemon.launch().wait(timeout=30), 2)
        self.assertIn(f"metrics: token_file: {self.token_file}: others than its owner may read or "
                      f'write this secret; run "chmod 600 {self.token_file}"', self.daemon.log())


class Alerts(unittest.TestCase):
    def test_rules_name_metrics_that_there_are_and_the_page_has_each(self):
        rules = (SOURCE / "configs/operations/alerts.yml").read_text()
        suffixed = {name + end for name in documented() for end in ("", "_bucket", "_count", "_sum")}
        used = set(re.findall(r"\bmyograde_\w+", rules))
        self.assertLessEqual(used, suffixed)
        self.assertGreater(len(used), 10)
        alerts = set(re.findall(r"alert: (\w+)", rules))
        page = (SOURCE / PAGE).read_text()
        self.assertEqual(set(re.findall(r"^\| `(MyoGrade\w+)`", page, re.MULTILINE)), alerts)


class Schema(unittest.TestCase):
    def test_it_takes_the_shipped_settings_and_those_of_the_page(self):
        shipped = json.loads((SOURCE / "configs/server.json").read_text())
        validate(shipped, "server")
        page = (SOURCE / PAGE).read_text()
        example = json.loads(re.search(r"^```\n(\{\"webhooks.*?)^```$", page,
                                       re.MULTILINE | re.DOTALL).group(1))
        validate({**shipped, **example}, "server")
        for key, value in (("events", ["finished"]), ("url", "ftp://x"), ("timeout_s", 61),
                           ("secret_file", "x"), ("colour", 1)):
            broken = {"webhooks": [{**example["webhooks"][0], key: value}]}
            with self.assertRaises(jsonschema.ValidationError, msg=key):
                validate({**shipped, **broken}, "server")


class Readiness(AccessCase):
    def ready(self, caller="operator"):
        status, _, text = self.ask_as(self.tokens.get(caller), "GET", "/v1/ready")
        return status, json.loads(text)

    def test_it_is_ready_and_tells_strangers_no_more(self):
        self.assertEqual(self.ready(), (200, {"ready": True, "reasons": []}))
        for caller in ("public", "alpha"):
            self.assertEqual(self.ready(caller), (200, {"ready": True}))
            status, _, text = self.ask_as(self.tokens[caller], "GET", "/v1/live")
            self.assertEqual((status, json.loads(text)), (200, {"live": True}))

    def test_a_locked_store_is_a_reason_until_it_is_free(self):
        lock = sqlite3.connect(self.data / "store.db", timeout=30)
        lock.execute("BEGIN IMMEDIATE")
        self.call("POST", "/v1/teams", {"team": "gamma"})
        status, body = wait_until(self.ready, 30, "it stays ready", lambda r: r[0] == 503)
        self.assertEqual([reason["code"] for reason in body["reasons"]], ["store"])
        self.assertIn("is locked by another process", body["reasons"][0]["message"])
        self.assertEqual(self.ready("public"), (503, {"ready": False}))
        self.assertEqual(self.ask_as(None, "GET", "/v1/live")[0], 200)
        lock.rollback()
        lock.close()
        wait_until(self.ready, 30, "it is not ready again", lambda r: r[0] == 200)

    def test_a_disk_without_room_for_uploads_is_a_reason(self):
        self.stop(signal.SIGTERM)
        self.configure(artefacts={"disk_reserve_bytes": 1 << 40})
        self.start()
        status, body = self.ready()
        self.assertEqual((status, [r["code"] for r in body["reasons"]]), (503, ["disk"]))

    def test_a_missing_program_is_a_reason(self):
        (self.folder / "bin" / "myograde-sim").unlink()
        status, body = self.ready()
        self.assertEqual((status, [r["code"] for r in body["reasons"]]), (503, ["simulator"]))
        self.assertIn("myograde-sim is missing", body["reasons"][0]["message"])


class Log(DaemonCase):
    def lines(self, start=0):
        text = self.daemon.log()[start:]
        self.assertTrue(text.endswith("\n"))
        return text.splitlines()

    def test_each_line_is_an_object(self):
        self.stop(signal.SIGTERM)
        self.configure(log_format="json")
        start = len(self.daemon.log())
        self.start()
        submission = self.submit("once", team="Team \"x\" \\ ä")
        self.ended(submission)
        self.stop(signal.SIGTERM)
        entries = [json.loads(line) for line in self.lines(start)]
        for entry in entries:
            self.assertLessEqual({"time", "level", "message"}, set(entry))
            self.assertRegex(entry["time"], r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$")
            self.assertIn(entry["level"], ("debug", "info", "warning", "error", "critical"))
        done = [entry for entry in entries if "episodes succeeded" in entry["message"]][0]
        self.assertEqual((done["submission"], done["evaluation"], done["team"]),
                         (submission, 1, "Team \"x\" \\ ä"))
        fault = [entry for entry in entries if "attempt 1: fault of the grader" in entry["message"]][0]
        self.assertEqual((fault["submission"], fault["attempt"]), (submission, 1))
        self.assertGreaterEqual(fault["lease"], 1)

    def test_text_of_others_forges_no_line(self):
        # The stand-in's runner writes to standard error, which the log quotes.
        for form in ("text", "json"):
            self.stop(signal.SIGTERM)
            self.configure(log_format=form, scheduler={"suspect_after": 100, "max_retries": 1})
            start = len(self.daemon.log())
            self.start()
            runner = self.folder / "bin" / "myograde-runner"
            text = runner.read_text()
            runner.write_text("#!/usr/bin/python3\nimport sys\nsys.stderr.write("
                              f"{ascii(HOSTILE)})\nsys.stderr.flush()\nsys.exit(3)\n")
            self.ended(self.submit("ok", team=f"team {form}"))
            runner.write_text(text)
            self.stop(signal.SIGTERM)
            lines = self.lines(start)
            self.assertTrue(any("myograde_ready 0" in line for line in lines), form)
            for line in lines:
                if form == "json":
                    self.assertNotEqual(json.loads(line).get("level"), "critical")
                    self.assertTrue(line.isascii() and line.isprintable(), line)
                else:
                    self.assertRegex(line, r"^\d{4}-\d\d-\d\dT\S+ (info|warning|error|debug) ")
                    self.assertTrue(line.isprintable(), ascii(line))


if __name__ == "__main__":
    unittest.main(verbosity=2)
