"""What an organiser sets and sees: quotas, marks, explanations, exports, imports, backups."""

import contextlib
import json
import os
import re
import shutil
import signal
import sqlite3
import subprocess
import unittest
import urllib.parse

from support.client import Connection, exchange
from daemon_test import SOURCE, DaemonCase
from support.schemas import validate
from support.waiting import stay_within_a_day, wait_until

TRACK = "demo-manipulation"


class OrganiserCase(DaemonCase):
    def cli(self, *words, data=None, check=True):
        result = self.daemon.run_verb(*words, "--data", data or self.data, timeout_s=60, text=True)
        if check:
            self.assertEqual(result.returncode, 0, result.stderr)
        return result

    def ask(self, *words, schema=None, data=None):
        answer = json.loads(self.cli(*words, "--json", data=data).stdout)
        if schema:
            validate(answer, schema)
        return answer

    def played(self, mode, team="alpha", **more):
        submission = self.submit(mode, team, **more)
        self.ended(submission)
        return submission

    def feed(self):
        with contextlib.closing(Connection(self.daemon.socket_path)) as connection:
            status, text = exchange(connection, "GET", f"/v1/leaderboard/feed?track={TRACK}")
        self.assertEqual(status, 200, text)
        return text.decode()

    def board(self, data=None):
        return self.ask("leaderboard", "--track", TRACK, schema="leaderboard", data=data)

    def places(self):
        return [(row["rank"], row["submission"]) for row in self.board()["rows"]]

    def quota(self, team="alpha"):
        answer = self.ask("quota", "--team", team, "--track", TRACK, schema="quota")
        return answer["tracks"][0], answer["ledger"]


class Quotas(OrganiserCase):
    def setUp(self):
        super().setUp()
        stay_within_a_day(90)

    def test_cancelling_says_what_stays_charged(self):
        running = self.submit("slow")
        self.wait(f"/v1/submissions/{running}", lambda b: b["episodes"]["done"] >= 1)
        cancelled = self.ask("cancel", running, schema="cancel")
        self.assertEqual(cancelled["cancel"]["charged"], "official")
        self.assertEqual(self.quota()[0]["official"]["per_day"]["used"], 1)
        # One that has not started yet: others have all the slots.
        stubborn = [self.submit("stubborn", team=team) for team in ("x", "y")]
        for other in stubborn:
            self.wait(f"/v1/submissions/{other}", lambda b: b["state"] == "running")
        waiting = self.submit("ok")
        cancelled = self.ask("cancel", waiting)
        self.assertIsNone(cancelled["cancel"]["charged"])
        self.assertEqual(self.quota()[0]["official"]["per_day"]["used"], 1)

    def test_a_submission_is_charged_and_the_graders_fault_is_not(self):
        self.played("ok")
        self.played("grader")
        self.played("once")
        self.played("crash")
        self.played("ok", episodes=2)
        track, ledger = self.quota()
        self.assertEqual((track["official"]["per_day"]["used"], track["practice"]["total"]["used"],
                          track["failed"]["per_day"]["used"]), (2, 1, 1))
        entries = [(row["submission"], row["entry"], row["budget"]) for row in reversed(ledger)]
        self.assertEqual(entries[:2], [(1, "charge", "official"), (3, "charge", "official")])
        self.assertEqual(sorted(e for e in entries if e[0] == 4), [
            (4, "charge", "failed"), (4, "charge", "official"), (4, "refund", "official")])
        self.assertNotIn(2, [row["submission"] for row in ledger])
        text = self.cli("quota", "--team", "alpha").stdout
        self.assertIn("Ledger, newest first", text)
        self.assertEqual(self.cli("quota", check=False).returncode, 2)

    def test_what_is_over_a_quota_is_refused_until_a_grant(self):
        self.stop(signal.SIGTERM)
        self.configure(quota={"tracks": {TRACK: {"official_per_day": 1}}})
        self.start()
        self.played("ok")
        body = {"artefact": self.upload("slow"), "team": "alpha", "track": TRACK}
        status, answer = self.call("POST", "/v1/submissions", body)
        self.assertEqual((status, answer["error"]["code"]), (409, "quota"), answer)
        self.assertIn("used up its 1 ranked evaluation of", answer["error"]["message"])
        self.assertIn("the next day begins at", answer["error"]["message"])
        self.assertEqual(self.cli("team", "grant", "alpha", "--units", 1,
                                  check=False).returncode, 2)
        granted = self.ask("team", "grant", "alpha", "--track", TRACK, "--units", 1,
                           "--reason", "a broken host", schema="quota")
        self.assertEqual(granted["ledger"][0]["why"], "a broken host")
        self.assertEqual(self.call("POST", "/v1/submissions", body)[0], 201)

    def test_a_refused_upload_is_a_failed_try(self):
        self.stop(signal.SIGTERM)
        self.configure(quota={"failed_per_day": 2})
        self.start()
        path = f"/v1/artefacts?team=alpha&track={TRACK}"
        for _ in range(2):
            self.assertEqual(self.call("POST", path, b"junk" * 100)[0], 400)
        status, answer = self.call("POST", path, b"junk" * 100)
        self.assertEqual((status, answer["error"]["code"]), (409, "quota"), answer)
        self.assertEqual(self.quota()[0]["failed"]["per_day"]["left"], 0)
        self.assertEqual(self.call("POST", "/v1/artefacts?team=alpha", b"junk")[0], 400)

    def test_a_look_alike_is_no_team_and_costs_nobody_anything(self):
        self.played("ok")
        artefact = self.upload("ok")
        for team, status, code, words in (
                ("\u0430lpha", 409, "look_alike", 'looks like that of team "alpha"'),
                ("ALPHA", 409, "look_alike", 'looks like that of team "alpha"'),
                ("alpha\u3164", 400, "bad_request", "has U+3164, which is not seen"),
                ("alpha\u2800", 400, "bad_request", "has U+2800, which looks like a space")):
            body = {"artefact": artefact, "team": team, "track": TRACK}
            query = urllib.parse.urlencode({"team": team, "track": TRACK})
            grant = {"team": team, "track": TRACK, "budget": "official", "amount": 1, "reason": "r"}
            for method, path, sent in (("POST", "/v1/submissions", body),
                                       ("POST", f"/v1/artefacts?{query}", b"junk"),
                                       ("POST", "/v1/quota/grants", grant)):
                answer = self.call(method, path, sent)
                self.assertEqual((answer[0], answer[1]["error"]["code"]), (status, code), answer)
                self.assertIn(words, answer[1]["error"]["message"])
        # The same name as typed on another keyboard is the same team.
        status, answer = self.call("POST", "/v1/submissions", {
            "artefact": artefact, "team": "\uff41lpha", "track": TRACK, "episodes": 1})
        self.assertEqual((status, answer["team"]), (201, "alpha"))
        for team in ("alpha", "\uff41lpha"):
            query = urllib.parse.urlencode({"team": team})
            self.assertEqual(len(self.get(f"/v1/submissions?{query}")["submissions"]), 2)
            self.assertEqual(self.get(f"/v1/quota?{query}")["team"], "alpha")
        self.assertEqual(self.quota()[0]["failed"]["total"]["used"], 0)

    def test_a_limit_can_not_be_switched_off(self):
        self.stop(signal.SIGTERM)
        for quota, word in (({"waiting": 0}, '"waiting" is 0'), ({"waiting": None}, '"waiting"'),
                            ({"tracks": {TRACK: {"official_total": -1}}}, '"official_total"'),
                            ({"tracks": {TRACK: {"colour": 1}}}, '"colour"')):
            self.configure(quota={"waiting": 200, "tracks": {}})
            self.configure(quota=quota)
            self.assertEqual(self.daemon.launch().wait(timeout=20), 2)
            self.assertIn(word, self.daemon.log().splitlines()[-1])

    def test_a_second_official_evaluation_is_the_first(self):
        first = self.submit("ok")
        status, again = self.call("POST", "/v1/submissions", {
            "artefact": self.upload("ok"), "team": "alpha", "track": TRACK})
        self.assertEqual((status, again["linked"], again["submission"]), (200, True, first))
        self.assertNotEqual(self.submit("ok", team="beta"), first)
        self.assertNotEqual(self.submit("ok", episodes=2), first)


class Boards(OrganiserCase):
    def test_a_feed_says_when_the_board_last_changed(self):
        first, _ = (self.played("ok", team) for team in ("alpha", "beta"))
        updated = lambda: re.findall(r"<updated>(.*?)</updated>", self.feed())
        before = updated()
        self.assertEqual(len(set(before)), 1)
        self.assertEqual(updated(), before)
        self.played("ok", "gamma", episodes=2)
        self.assertEqual(updated(), before, "practice is on no board")
        self.ask("submission", "hide", first)
        after = updated()
        self.assertGreater(min(after), before[0])
        self.assertEqual(len(after), 2, "of the feed, and of beta's row that moved up")

    def test_marks_change_the_board_and_can_be_taken_back(self):
        first, second, third = (self.played("ok", team) for team in ("alpha", "beta", "gamma"))
        everything = self.board()
        self.assertEqual(self.places(), [(1, first), (2, second), (3, third)])
        marked = self.ask("submission", "hide", first, "--reason", "wrong file", schema="mark")
        self.assertTrue(marked["changed"])
        self.assertFalse(self.ask("submission", "hide", first)["changed"])
        self.assertEqual(self.places(), [(1, second), (2, third)])
        self.assertEqual(self.cli("submission", "disqualify", second, check=False).returncode, 2)
        self.ask("submission", "disqualify", second, "--reason", "reads the seeds", schema="mark")
        board = self.board()
        self.assertEqual([row["submission"] for row in board["rows"]], [third])
        self.assertEqual([(row["submission"], row["reason"]) for row in board["disqualified"]],
                         [(second, "reads the seeds")])
        self.ask("submission", "baseline", third, schema="mark")
        self.ask("submission", "unhide", first, schema="mark")
        self.assertEqual(self.places(), [(1, first), (None, third)])
        self.assertIn("baseline", self.cli("leaderboard", "--track", TRACK).stdout)
        self.ask("submission", "reinstate", second, schema="mark")
        self.ask("submission", "baseline", third, "--undo", schema="mark")
        self.assertEqual(self.board(), everything)
        history = self.get(f"/v1/submissions/{second}")["marks"]
        self.assertEqual([(m["mark"], m["set"], m["reason"]) for m in history],
                         [("disqualified", True, "reads the seeds"),
                          ("disqualified", False, None)])
        self.assertEqual(self.cli("submission", "hide", 99, check=False).returncode, 2)

    def test_the_order_is_explained(self):
        first, second = (self.played("ok", team) for team in ("alpha", "beta"))
        for pair in ((first, second), (second, first), ("alpha", "beta")):
            answer = self.ask("board", "explain", *pair, "--track", TRACK, schema="leaderboard")
            self.assertEqual((answer["above"]["submission"], answer["below"]["submission"]),
                             (first, second))
            self.assertIn("alpha (rank 1) stands above beta (rank 2)", answer["why"])
            self.assertIn("accepted first", answer["why"])
        self.assertIn("stands above", self.cli("board", "explain", first, second).stdout)
        for pair in ((first, 99), (first, first), ("alpha", "nobody")):
            result = self.cli("board", "explain", *pair, "--track", TRACK, check=False)
            self.assertEqual(result.returncode, 2, result.stdout)

    def test_a_board_that_is_made_anew_is_the_same(self):
        for team in ("alpha", "beta"):
            self.played("ok", team)
        before = self.call("GET", f"/v1/leaderboard?track={TRACK}")
        self.assertEqual(self.ask("board", "rebuild", schema="leaderboard"),
                         {"rebuilt": 2, "unreadable": []})
        self.assertEqual(self.call("GET", f"/v1/leaderboard?track={TRACK}"), before)
        self.stop(signal.SIGTERM)
        with sqlite3.connect(self.data / "store.db") as db:
            db.execute("DELETE FROM standing")
        self.start()
        self.assertEqual(self.call("GET", f"/v1/leaderboard?track={TRACK}"), before)


class Files(OrganiserCase):
    def fill(self):
        self.played("ok", "alpha")
        self.played("ok", "beta")
        self.played("crash", "gamma")
        self.cli("submission", "baseline", 1)
        self.cli("submission", "disqualify", 2, "--reason", "a \"test\", with commas")

    def test_an_import_on_another_host_gives_the_same_board(self):
        self.fill()
        out = self.folder / "export.json"
        summary = self.ask("store", "export", out, schema="export")
        json.loads(out.read_text())
        subprocess.run(["sha256sum", "-c", "--quiet", "export.json.sha256"], cwd=self.folder,
                       check=True)
        self.assertEqual(self.cli("store", "export").stdout, out.read_text())
        board, quota = self.board(), self.quota()
        other = self.folder / "other"
        imported = self.ask("store", "import", out, schema="import", data=other)
        self.assertEqual(imported["sha256"], summary["sha256"])
        again = self.cli("store", "import", out, data=other, check=False)
        self.assertEqual(again.returncode, 2, again.stderr)
        self.assertIn("has rows already", again.stderr)
        self.stop(signal.SIGTERM)
        third = self.folder / "third"
        for data, with_daemon in ((other, False), (third, True)):
            self.daemon.data = data
            self.start()
            if with_daemon:
                self.ask("store", "import", out, schema="import")
            self.assertEqual(self.board(), board)
            self.assertEqual(self.quota(), quota)
            self.check_copy(json.loads(self.cli("store", "export").stdout), json.loads(out.read_text()))
            self.stop(signal.SIGTERM)
        self.start()

    def check_copy(self, copy, original):
        """They are equal, but for the key of the host that holds the copy, which goes on the record."""
        size = len(original["data"]["journal"])
        added = copy["data"]["journal"][size:]
        self.assertLessEqual([entry["kind"] for entry in added], ["key"])
        copy["data"]["journal"] = copy["data"]["journal"][:size]
        for text in (copy, original):
            text.pop("sha256", None)
            text.pop("rows", None)
        self.assertEqual(copy, original)

    def test_what_is_not_a_whole_export_is_refused(self):
        self.fill()
        out = self.folder / "export.json"
        self.cli("store", "export", out)
        text = out.read_text()
        bad = self.folder / "bad.json"
        for content in (text[:-1], text[: len(text) // 2], text.replace("alpha", "omega"), "",
                        "{}"):
            bad.write_text(content)
            result = self.cli("store", "import", bad, data=self.folder / "new", check=False)
            self.assertEqual(result.returncode, 2, result.stderr)
            self.assertIn("bad.json", result.stderr)
        self.assertFalse((self.folder / "new").exists())

    def test_csv_has_a_file_for_each_table(self):
        self.fill()
        folder = self.folder / "csv"
        self.ask("store", "export", folder, "--format", "csv", schema="export")
        subprocess.run(["sha256sum", "-c", "--quiet", "SHA256SUMS"], cwd=folder, check=True)
        acts = (folder / "journal.csv").read_text()
        self.assertIn('"{""why"":""a \\""test\\"", with commas""}"', acts)
        self.ask("store", "export", self.folder / "marked", "--format", "csv", "--bom", schema="export")
        for table in ("journal", "episode"):
            self.assertEqual((self.folder / f"marked/{table}.csv").read_bytes(),
                             b"\xef\xbb\xbf" + (folder / f"{table}.csv").read_bytes())
        self.assertEqual((folder / "episode.csv").read_bytes().count(b"\r\n"), 19)

    def test_no_cell_of_a_csv_is_a_formula(self):
        self.fill()
        for text in ("=HYPERLINK(1)", "+1", "-1", "@SUM(1)"):
            self.call("POST", "/v1/quota/grants", {"team": "alpha", "track": TRACK, "amount": 1,
                                                   "budget": "official", "reason": text})
        folder = self.folder / "csv"
        self.ask("store", "export", folder, "--format", "csv", schema="export")
        ledger = (folder / "ledger.csv").read_text()
        for text in ("'=HYPERLINK(1)", "'+1", "'-1", "'@SUM(1)"):
            self.assertIn(f",{text}", ledger)

    def test_a_backup_is_a_store(self):
        self.fill()
        file = self.folder / "backup.db"
        self.ask("store", "backup", file, schema="backup")
        self.assertEqual(os.stat(file).st_mode & 0o777, 0o600)
        board = self.board()
        self.stop(signal.SIGKILL)
        shutil.rmtree(self.data)
        self.data.mkdir()
        shutil.copy(file, self.data / "store.db")
        self.start()
        self.assertEqual(self.board(), board)
        result = self.cli("store", "backup", self.folder / "nowhere" / "file", check=False)
        self.assertEqual(result.returncode, 2, result.stderr)
        self.assertEqual(list(self.data.glob("spool/*")), [])

    def removals(self):
        """The removal rows, once there are any: a file is moved within the transaction that adds
        its row, a moment before others see the row."""
        def rows():
            with contextlib.closing(sqlite3.connect(self.data / "store.db")) as db:
                return db.execute("SELECT kind, name, bytes > 0 FROM removal").fetchall()
        return wait_until(rows, 60, "nothing was removed")

    def test_files_that_no_board_needs_go_by_the_policy(self):
        official = self.upload("ok")
        self.ended(self.submit("ok"))
        self.ended(self.submit("crash"))
        failed = self.upload("crash")
        self.stop(signal.SIGTERM)
        self.configure(retention={"artefact_bytes": 1, "every_s": 1})
        self.start()
        self.wait("/v1/health", lambda _: not (self.data / "artefacts" / failed).exists())
        self.assertTrue((self.data / "artefacts" / official).exists())
        self.assertEqual(self.removals(), [("artefact", failed, 1)])
        status, answer = self.call("POST", "/v1/submissions/2/rerun", {})
        self.assertEqual(status, 404, answer)
        self.assertIn("upload it again", answer["error"]["message"])
        self.stop(signal.SIGTERM)
        self.configure(retention={"artefact_bytes": 1 << 30})
        self.start()
        self.upload("crash")
        self.assertEqual(self.call("POST", "/v1/submissions/2/rerun", {})[0], 201)


if __name__ == "__main__":
    unittest.main(verbosity=2)
