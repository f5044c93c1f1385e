"""The connector between a real daemon and a stand-in for EvalAI: what both sides say in the end, whatever
goes wrong on the way and wherever it is killed."""

import io
import json
import os
import signal
import subprocess
import sys
import time
import unittest
import zipfile

from connect_support import COLUMNS, FAST, LONG_S, SCHEMA, TRACK, WithBoth
from myograde.client import MyogradeError, WrongUse
from myograde.connect import evalai as site
from myograde.connect.settings import Settings
from myograde.connect.worker import Worker
from support.submission import played_by_stand_in as manifest
from support.waiting import wait_until


class Grading(WithBoth):
    def test_three_teams_in_two_phases_are_graded_and_ranked_as_here(self):
        made = self.start()
        numbers = {}
        for place, team in enumerate(("alpha", "beta", "gamma")):
            for phase in (3001, 3002):
                numbers[team, phase] = self.evalai.submit(
                    (10 + place, team), phase, manifest(f"skill-{3 + 3 * place}-0-10-{2 + place}", f"{team}{phase}"),
                    "agent.tar")
        self.turn_until(made, self.all_over)
        for (team, phase), number in numbers.items():
            found = self.evalai.submissions[number]
            self.assertEqual(self.evalai.statuses[number], ["submitted", "running", "finished"])
            (known,) = self.here(team, {3001: "warm-up", 3002: "final"}[phase])
            self.assertIn(f"https://grader.example.org/submission?id={known['submission']}\n", found["stdout_file"])
            self.assertIn("hello from the policy", found["stderr_file"])
            aggregate = self.client.show(known["submission"])["aggregate"]
            columns = self.evalai.results[number, "test"]
            self.assertEqual(columns["Success"], aggregate["success_rate"])
            spread = aggregate["spread"]["success_rate"]
            self.assertAlmostEqual(columns["Success error"], (spread["high"] - spread["low"]) / 2)
            self.assertIn(str(columns["Score"]), found["submission_result_file"])
            self.assertEqual(json.loads(found["metadata"])["submission"], known["submission"])
        for phase, name in ((3001, "warm-up"), (3002, "final")):
            board = [row["team"] for row in self.client.leaderboard(phase=name) if row["team"] in ("alpha", "beta", "gamma")]
            self.assertEqual([team for team, _ in self.evalai.leaderboard(phase, "test")], board)
            self.assertEqual(board, ["gamma", "beta", "alpha"])

    def test_a_faster_one_moves_the_bands(self):
        made = self.start()
        first = self.evalai.submit((15, "band"), 3001, manifest("skill-9-0-10-1", "band"), "agent.tar")
        self.turn_until(made, self.all_over)
        alone = self.evalai.results[first, "test"]["Score"]
        second = self.evalai.submit((16, "faster"), 3001, manifest("skill-10-0-10-1", "faster"), "agent.tar")
        self.turn_until(made, self.all_over)
        self.turn_until(made, lambda: self.evalai.results[first, "test"]["Score"] != alone)
        self.assertEqual(*(int(self.evalai.results[number, "test"]["Score"] * 10**6) for number in (first, second)))

    def test_what_is_delivered_or_submitted_again_is_graded_once(self):
        made = self.start()
        content = manifest("slow", "again")
        first = self.evalai.submit((20, "again"), 3001, content, "agent.tar")
        second = self.evalai.submit((20, "again"), 3001, content, "agent.tar")
        for _ in range(3):
            self.evalai.send(first)
        self.turn_until(made, self.all_over)
        (known,) = self.here("again")
        self.assertEqual(self.status(first), "finished")
        self.assertEqual(self.evalai.results[first, "test"], self.evalai.results[second, "test"])
        self.assertEqual(self.evalai.statuses[first], ["submitted", "running", "finished"])

    def test_run_again_and_resumed(self):
        made = self.start()
        first = self.evalai.submit((21, "rerun"), 3001, manifest("ok", "rerun"), "agent.tar")
        self.turn_until(made, self.all_over)
        second = self.evalai.rerun(first)
        self.turn_until(made, self.all_over)
        made.survey()
        self.turn_until(made, self.all_over)
        self.assertEqual([self.status(first), self.status(second)], ["cancelled", "finished"])
        (known,) = self.here("rerun")
        self.assertFalse(self.client.status(known["submission"])["marks"])
        failed = self.evalai.submit((21, "rerun"), 3001, manifest("crash", "broken"), "agent.tar")
        self.turn_until(made, self.all_over)
        self.evalai.resume(failed)
        self.turn_until(made, self.all_over)
        self.assertEqual(self.evalai.statuses[failed], ["submitted", "running", "failed", "resuming", "running", "failed"])
        self.assertEqual(len(self.here("rerun")), 2)
        self.assertIn("the policy died of signal 11", self.evalai.submissions[failed]["stderr_file"]
                      + json.dumps(self.client.episodes(self.here("rerun")[1]["submission"])))

    def test_what_was_cancelled_there_is_taken_back_here(self):
        made = self.start()
        blockers = [self.evalai.submit((22, "cancels"), 3001, manifest("slow", f"block{place}"), "agent.tar")
                    for place in range(3)]
        waits = self.evalai.submit((22, "cancels"), 3001, manifest("slow", "waits"), "agent.tar")
        self.turn_until(made, lambda: self.status(waits) == "running")
        self.evalai.set_status(waits, "cancelled")
        self.turn_until(made, lambda: not made.rows("SELECT 1 FROM submission WHERE pk = ? AND step != 'done'", waits))
        self.turn_until(made, self.all_over)
        states = {known["name"]: known for known in self.here("cancels")}
        self.assertEqual(self.status(waits), "cancelled")
        marks = self.client.status(states["waits"]["submission"])["marks"]
        self.assertTrue(states["waits"]["state"] == "cancelled" or marks[-1]["mark"] == "hidden")
        # A finished one, which its host cancels without a message, and has run again later.
        self.evalai.set_status(blockers[0], "cancelled")
        made.survey()
        self.turn_until(made, lambda: not made.rows("SELECT 1 FROM submission WHERE step != 'done'"))
        number = states["block0"]["submission"]
        self.assertEqual(self.client.status(number)["marks"][-1]["reason"],
                         f"Cancelled on EvalAI (submission {blockers[0]})")
        again = self.evalai.rerun(blockers[0])
        self.turn_until(made, self.all_over)
        self.assertEqual(self.status(again), "finished")
        self.assertFalse(self.client.status(number)["marks"][-1]["set"])

    def test_disqualified_banned_and_back(self):
        made = self.start()
        number = self.evalai.submit((23, "cheats"), 3001, manifest("ok", "cheats"), "agent.tar")
        self.turn_until(made, self.all_over)
        (known,) = self.here("cheats")
        for path, change, undo, reason in (
                (f"/v1/submissions/{known['submission']}/marks", {"mark": "disqualified", "set": True, "reason": "reads seeds"},
                 {"mark": "disqualified", "set": False}, "reads seeds"),
                ("/v1/teams/cheats/ban", {"banned": True, "reason": "two accounts"}, {"banned": False}, "two accounts")):
            self.client.ask(path, change)
            self.turn_until(made, lambda: self.status(number) == "cancelled")
            self.assertIn(reason, self.evalai.submissions[number]["stderr_file"])
            self.assertNotIn("cheats", [team for team, _ in self.evalai.leaderboard(3001, "test")])
            self.client.ask(path, undo)
            self.turn_until(made, lambda: self.status(number) == "finished")
        self.client.ask("/v1/teams/cheats/ban", {"banned": True, "reason": "again"})
        later = self.evalai.submit((23, "cheats"), 3001, manifest("ok", "later"), "agent.tar")
        self.turn_until(made, lambda: self.status(later) == "failed")
        self.assertIn("banned", self.evalai.submissions[later]["stderr_file"])
        self.assertEqual(len(self.here("cheats")), 1)
        puts = [body for method, _, body in self.evalai.requests if method == "PUT"]
        made.turn()
        self.assertEqual(puts, [body for method, _, body in self.evalai.requests if method == "PUT"])

    def test_practice_is_taken_back_too(self):
        made = self.start(phases={"3001": {"track": TRACK, "episodes": 4, "splits": {"test": COLUMNS}}})
        number = self.evalai.submit((25, "trains"), 3001, manifest("ok", "trains"), "agent.tar")
        other = self.evalai.submit((25, "trains"), 3002, manifest("ok", "no phase"), "agent.tar")
        self.turn_until(made, self.all_over)
        self.assertEqual((self.status(number), self.status(other)), ("finished", "failed"))
        self.evalai.set_status(number, "cancelled")
        made.survey()
        self.turn_until(made, lambda: not made.rows("SELECT 1 FROM submission WHERE step != 'done'"))
        self.assertEqual([known["ranked"] for known in self.here("trains")], [False])  # it is on no board
        # A phase that is no longer in the file is left as it was.
        made.state.close()
        made = self.start(phases={})
        made.turn()
        self.assertEqual(made.rows("SELECT 1 FROM submission WHERE step != 'done'"), [])

    def test_a_team_name_is_given_to_nobody_else(self):
        self.client.ask("/v1/teams", {"team": "local", "reason": "ours"})
        made = self.start(teams={"32": "local"})
        for pk, name, wanted in ((30, "local", "local (30)"), (31, "lоcal", "lоcal (31)"), (32, "guest", "local"),
                                 (33, "\u202eevil", "EvalAI team 33"), (34, "x" * 100, "EvalAI team 34")):
            number = self.evalai.submit((pk, name), 3001, manifest("ok", f"named{pk}"), "agent.tar")
            self.turn_until(made, self.all_over)
            self.assertEqual((self.status(number), len(self.here(wanted))), ("finished", 1), wanted)

    def test_a_rejudge_is_reported_and_undone(self):
        made = self.start()
        number = self.evalai.submit((26, "rejudged"), 3002, manifest("skill-2-7-10-1", "rejudged"), "agent.tar")
        self.turn_until(made, self.all_over)
        rejudge = self.client.ask("/v1/rejudges", {"phase": "final", "reason": "longer", "config": {
            "extends": TRACK, "rules": {"max_time_s": 20}}})["rejudge"]
        wait_until(lambda: self.client.ask(f"/v1/rejudges/{rejudge}")["complete"], LONG_S, "not played again")
        made.turn()
        self.assertEqual(self.evalai.results[number, "test"]["Success"], 0.2)
        for act, success in (("apply", 0.7), ("drop", 0.2)):
            self.client.ask(f"/v1/rejudges/{rejudge}/{act}", {"reason": "as announced"})
            self.turn_until(made, lambda: self.evalai.results[number, "test"]["Success"] == success, act)

    def test_changed_columns_are_reported_anew(self):
        made = self.start()
        number = self.evalai.submit((24, "columns"), 3001, manifest("ok", "columns"), "agent.tar")
        self.turn_until(made, self.all_over)
        made.state.close()
        made = self.start(phases={"3001": {"phase": "warm-up", "splits": {"test": {"Score": "score", "Time": "effort"}}}})
        made.turn()
        self.assertEqual(set(self.evalai.results[number, "test"]), {"Score", "Time"})


class Trouble(WithBoth):
    def kept_alive(self, made):
        """Turns as the loop does, which ends for no trouble."""
        try:
            made.turn()
        except MyogradeError as error:
            return str(error)
        return ""

    def test_files_that_can_not_be_taken(self):
        made = self.start(largest_bytes=100_000)
        bomb = io.BytesIO()
        with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("policy.json", b"{}" + b" " * 1_000_000)
        torn = io.BytesIO()
        with zipfile.ZipFile(torn, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("policy.json", os.urandom(100) + b" " * 1000)
        torn = torn.getvalue()[:60] + b"torn" + torn.getvalue()[64:]
        gone = self.evalai.submit((40, "files"), 3001, b"")
        self.evalai.files.clear()
        numbers = {gone: "gone from EvalAI"}
        for content, name, reason in ((b"x" * 100_001, "a.tar", "more than 100000 bytes"),
                                      (bomb.getvalue(), "a.zip", "^a.zip: unpacked, it has more than 100000 bytes"),
                                      (torn, "a.zip", "can't be read"),
                                      (b"PK\3\4 no archive", "a.zip", "^a.zip: can't be read as a zip archive"),
                                      (b"[1, 2]", "results.json", "^results.json: is not a program"),
                                      (b"", "..", "is not a program"),
                                      (manifest("ok")[:700], "cut.tar", "archive")):
            numbers[self.evalai.submit((40, "files"), 3001, content, name)] = reason
        none = self.evalai.submit((40, "files"), 3001, b"")
        self.evalai.submissions[none]["input_file"] = None
        numbers[none] = "no file on EvalAI"
        foreign = self.evalai.submit((40, "files"), 3009, b"")
        numbers[foreign] = "phase 3009 is not graded here"
        self.turn_until(made, self.all_over)
        for number, reason in numbers.items():
            found = self.evalai.submissions[number]
            self.assertEqual(found["status"], "failed", reason)
            self.assertRegex(found["stderr_file"], reason)
        self.assertFalse(self.here("files"))
        self.assertEqual([path.name for path in self.folder.iterdir() if "download" in path.name], [])

    def test_a_day_without_evalai_an_expired_token_and_limits(self):
        made = self.start()
        number = self.evalai.submit((41, "patient"), 3001, manifest("ok", "patient"), "agent.tar")
        for refused, words in (
                (("", 503, "<h1>503</h1>"), "503"),
                (("", 401, {"detail": "Token has expired"}), "Token has expired.*evalai.token_file"),
                (("", 403, {"detail": "Please verify your email!"}), "verify your email"),
                (("", 429, {"detail": "Request was throttled."}), "throttled"),
                (("queues", 400, {"error": "Challenge with queue name x does not exist"}), "queue name x"),
                (("PATCH", 502, "<h1>bad gateway</h1>"), "bad gateway"),
                (("PUT", 500, "<h1>Server Error (500)</h1>"), "Server Error")):
            with self.evalai.refusing(*refused):
                said = wait_until(lambda: self.kept_alive(made), LONG_S, words, every_s=FAST)
                self.assertRegex(said, words)
        with self.evalai.refusing("", 429, {"detail": "Request was throttled."}, Retry_After=7):
            with self.assertRaises(site.NotNow) as caught:
                made.turn()
            self.assertEqual(caught.exception.pause_s, 7)
        (self.folder / "evalai.token").write_text("another")
        self.assertRegex(self.kept_alive(made), "Token has expired")
        (self.folder / "evalai.token").write_text("two\nlines")
        self.assertRegex(self.kept_alive(made), "evalai.token: not a token")
        (self.folder / "evalai.token").unlink()
        self.assertRegex(self.kept_alive(made), "evalai.token: can't be read")
        (self.folder / "evalai.token").write_text(self.evalai.token)
        url, made.evalai._transport = made.evalai._transport, site.Transport(site.parse_server("http://127.0.0.1:9", ""))
        self.assertRegex(self.kept_alive(made), "can't reach a server")
        made.evalai._transport = url
        self.turn_until(made, self.all_over)
        self.assertEqual((self.status(number), len(self.here("patient"))), ("finished", 1))

    def test_one_submission_does_not_hold_up_others(self):
        made = self.start()
        first = self.evalai.submit((42, "first"), 3001, manifest("ok", "first"), "agent.tar")
        second = self.evalai.submit((43, "second"), 3001, manifest("ok", "second"), "agent.tar")
        with self.evalai.refusing(f"GET /media/submission_{first}/", 503, "<h1>no</h1>"):
            self.turn_until(made, lambda: self.status(second) == "finished")
            self.assertEqual(self.status(first), "submitted")
        self.evalai.splits[3002] = {}
        third = self.evalai.submit((43, "second"), 3002, manifest("ok", "third"), "agent.tar")
        self.turn_until(made, lambda: made.waits.get(third, (0,))[0] > 1 and self.status(first) == "finished")
        self.assertEqual(self.status(third), "running")
        self.evalai.splits[3002] = {"test": SCHEMA}
        self.turn_until(made, self.all_over)

    def test_the_daemon_goes_and_comes(self):
        made = self.start()
        number = self.evalai.submit((44, "restart"), 3001, manifest("slow", "restart"), "agent.tar")
        self.turn_until(made, lambda: self.status(number) == "running")
        self.client.ask("/v1/phases/final/pause", {"reason": "lunch"})
        paused = self.evalai.submit((44, "restart"), 3002, manifest("ok", "paused"), "agent.tar")
        self.turn_until(made, lambda: made.waits.get(paused, (0,))[0] > 1)
        self.daemon.stop()
        with self.assertRaisesRegex(Exception, "can't reach a daemon"):
            made.turn()
        self.daemon.start()
        self.client.ask("/v1/phases/final/resume", {"reason": "fed"})
        self.turn_until(made, self.all_over)
        self.assertEqual([self.status(number), self.status(paused)], ["finished", "finished"])

    def test_a_lost_queue_and_a_lost_state(self):
        number = self.evalai.submit((45, "lost"), 3001, manifest("slow", "lost"), "agent.tar")
        self.evalai.messages.clear()
        made = self.start()
        self.turn_until(made, lambda: self.status(number) == "running")
        made.state.close()
        (self.folder / "connect.sqlite").unlink()
        made = self.start()
        self.turn_until(made, self.all_over)
        self.assertEqual((self.status(number), len(self.here("lost"))), ("finished", 1))
        made.state.close()
        (self.folder / "connect.sqlite").unlink()
        self.evalai.send(number)
        puts = len([1 for method, *_ in self.evalai.requests if method == "PUT"])
        self.turn_until(self.start(), self.all_over)
        self.assertEqual(puts, len([1 for method, *_ in self.evalai.requests if method == "PUT"]))

    def test_an_answer_lost_for_longer_than_keys_are_kept(self):
        self.settings(phases={"3001": {"track": TRACK, "episodes": 2, "splits": {"test": COLUMNS}}})
        made = Worker(Settings(str(self.folder / "connect.json")))
        self.addCleanup(made.state.close)
        number = self.evalai.submit((46, "late"), 3001, manifest("ok", "late"), "agent.tar")
        self.turn_until(made, self.all_over)
        made.rows("UPDATE submission SET step = 'sending', number = NULL, digest = NULL, status = NULL, attempt = 9, "
                  "sent_at = sent_at - 100000")
        self.evalai.set_status(number, "running")
        self.turn_until(made, self.all_over)
        self.assertEqual((self.status(number), len(self.here("late"))), ("finished", 1))

    def test_two_connectors_and_wrong_files(self):
        self.start()
        with self.assertRaisesRegex(WrongUse, "another connector works with it"):
            Worker(Settings(str(self.folder / "connect.json")))
        for changes, words in (({"polls_s": 1}, 'unknown key "polls_s"'), ({"poll_s": "1"}, '"poll_s" has the wrong type'),
                               ({"phases": {"1": {"splits": {}}}}, 'give "phase" alone'),
                               ({"phases": {"1": {"track": TRACK}}}, '"splits" is missing'),
                               ({"phases": {"1": {"track": "x", "splits": {"s": {"l": 1}}}}}, "as a text"),
                               ({"evalai": {"challenge": 1, "queue": "q"}}, '"token_file" is missing')):
            with self.assertRaisesRegex(WrongUse, words):
                self.settings(**changes)
        for phase, words in (({"phase": "winter"}, 'no phase "winter"'), ({"track": "runing"}, 'no track "runing"'),
                             ({"track": TRACK, "profile": "x"}, 'no profile "x"')):
            settings = self.settings(phases={"3001": {**phase, "splits": {"test": COLUMNS}}})
            settings.file = self.folder / f"{words}.json"  # so with a state of its own
            with self.assertRaisesRegex(WrongUse, f"connect.json, phases, 3001: .*{words}"):
                Worker(settings)


class Kills(WithBoth):
    """A process that is killed before each thing that it does, and another one that goes on."""

    def points(self, kill_at):
        """Forks a connector that kills itself at its `kill_at`th point; True if it did."""
        child = os.fork()
        if child == 0:
            try:
                self._run_killed(kill_at)
            finally:
                os._exit(0)
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL

    def _run_killed(self, kill_at):
        left = [kill_at]

        def point():
            left[0] -= 1
            if left[0] == 0:
                os.kill(os.getpid(), signal.SIGKILL)

        def between(function, counts=lambda *_: True):
            def run(*words, **options):
                if not counts(*words):
                    return function(*words, **options)
                point()
                return function(*words, **options)
            return run

        made = Worker(Settings(str(self.folder / "connect.json")))
        made.rows = between(made.rows, lambda sql, *_: not sql.startswith("SELECT"))
        # Every request: to EvalAI, to where its files are, and to the server.
        made.evalai.ask = between(made.evalai.ask)
        made.evalai.download = between(made.evalai.download)
        made.client._transport.ask = between(
            made.client._transport.ask, lambda method, path, *_: method != "GET" or "record" not in path)
        deadline = time.monotonic() + LONG_S
        while not self.evalai_is_done() and time.monotonic() < deadline:
            made.turn()
            time.sleep(FAST)

    def evalai_is_done(self):
        """Asked over the network, as the stand-in is in another process."""
        evalai = site.Evalai(Settings(str(self.folder / "connect.json")))
        return (evalai.ask("GET", f"jobs/submission/{self.number}")["status"] in ("finished", "failed")
                and evalai.ask("GET", f"jobs/challenge/7/submission/?status={'running'}") == [])

    def test_at_every_point(self):
        killed, kill_at = True, 0
        while killed:
            kill_at += 1
            with self.subTest(point=kill_at):
                team = f"killed {kill_at}"
                self.number = self.evalai.submit((1000 + kill_at, team), 3001 + kill_at % 2,
                                                 manifest("ok", team), "agent.tar")
                killed = self.points(kill_at)
                made = Worker(Settings(str(self.folder / "connect.json")))
                self.turn_until(made, self.all_over)
                made.state.close()
                self.assertEqual(self.status(self.number), "finished")
                (known,) = self.here(team)
                self.assertEqual(len(self.client.status(known["submission"])["evaluations"]), 1)
                self.assertEqual(self.evalai.results[self.number, "test"]["Success"], 0.5)
        self.assertGreater(kill_at, 25)

    def test_the_program_itself(self):
        number = self.evalai.submit((50, "program"), 3001, manifest("ok", "program"), "agent.tar")
        words = [sys.executable, "-B", "-m", "myograde.connect", "evalai", str(self.folder / "connect.json")]
        with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as process:
            wait_until(lambda: self.status(number) == "finished", LONG_S, "not graded")
            with self.evalai.refusing("", 401, {"detail": "Token has expired"}):
                self.assertIn("Token has expired", process.stderr.readline())
            process.send_signal(signal.SIGTERM)
            self.assertEqual(process.wait(LONG_S), 0)
            self.assertEqual(process.stderr.read(), "")
        done = subprocess.run([*words[:-1], str(self.folder / "none.json")], capture_output=True, text=True, timeout=LONG_S)
        self.assertEqual(done.returncode, 2)
        self.assertRegex(done.stderr, r"^myograde.connect: error: .*none.json: can't be read as JSON \(No such file or directory\)$")


if __name__ == "__main__":
    unittest.main()
