"""plot and report against canned answers: what they refuse, what they ask, the numbers that they
print, and what becomes of the file. usage: plot_test.py BIN_DIR SOURCE_DIR"""
import json
import os
import signal
import subprocess
import sys
import time
import unittest
import urllib.parse

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
from cli_case import (  # pylint: disable=wrong-import-position
    BIN_DIR, BOARD, RESULT, TIME, CliCase, Handler, myograde, validate)

HAS_MATPLOTLIB = subprocess.run(["/usr/bin/python3", "-I", "-c", "import matplotlib"],
                                capture_output=True, check=False).returncode == 0
REFUSED = {"error": {"code": "not_found", "message": "There is no evaluation 19."}}


def rows(times, successes):
    return [{"index": index, "seed": 1000 + index, "outcome": "success" if success else "failure",
             "reason": "" if success else "time", "fault": None, "steps": 10, "sim_time_s": time,
             "metrics": {"success": int(success), "time_s": time, "effort": 0.5},
             "facts": {"peak_force": 10.0}, "log": None, "digest": "0" * 64}
            for index, (time, success) in enumerate(zip(times, successes))]


def result(submission, times, successes, **more):
    return {**RESULT, "submission": submission, "track_kind": "t", "name": "walker",
            "output": [], "episode_rows": rows(times, successes), **more}


def path_of(submission):
    return f"GET /v1/submissions/{submission}/result?episodes=1"


def entry(index, kind, at, **more):
    return {"index": index, "chain": "0" * 64, "entry": {"kind": kind, "at": at, **more}}


def at(moment):
    return "2026-12-0%dT00:00:00.000Z" % moment


def board_at(moment, *teams):
    """A board of the past, or of now (None)."""
    name = "" if moment is None else f"&at={urllib.parse.quote(at(moment), safe='')}"
    shown = [{**BOARD["rows"][0], "team": team, "rank": rank, "submission": 6 + rank,
              "evaluation": 8 + rank} for rank, team in enumerate(teams, 1)]
    return {f"GET /v1/leaderboard?board=main&phase=final{name}": (
        200, {**BOARD, "phase": "final", "rows": shown})}


STATISTICS = {"criteria": [TIME], "rows": [], "statistics": {"level": 0.05, "tests": 0, "places": 10}}
OF_BOARD = {"track": "t", "profile": "paper", "phase": "final"}
RECORD = [
    entry(0, "accepted", at(1), submission=7, **OF_BOARD),
    entry(1, "graded", at(2), submission=7),
    entry(2, "accepted", at(3), submission=3, track="t", profile="paper", phase=None),
    entry(3, "graded", at(4), submission=3),  # of another board
    entry(4, "accepted", at(5), submission=8, **OF_BOARD),
    entry(5, "graded", at(6), submission=8),
    entry(6, "marked", at(7), submission=8)]
OF_PHASE = {
    **board_at(2, "alpha"), **board_at(6, "alpha", "beta"), **board_at(7, "alpha", "beta"),
    **board_at(None, "alpha", "beta"),
    "GET /v1/leaderboard/statistics?board=main&phase=final": (200, STATISTICS),
    "GET /v1/record?limit=1000&from=0": (200, {"entries": RECORD[:4], "next_from": 4}),
    "GET /v1/record?limit=1000&from=4": (200, {"entries": RECORD[4:], "next_from": None}),
    "GET /v1/challenges": (200, {"now": at(9), "challenges": [{"title": "Cup", "phases": [
        {"phase": "final", "title": "Final", "opens_at": None, "closes_at": None,
         "seeds": {"kind": "public", "commitment": None}}]}]}),
    "GET /v1/evaluations/9?episodes=1": (200, result(7, [1.0, 2.0], [1, 0])),
    "GET /v1/evaluations/10?episodes=1": (404, REFUSED)}


class PlotTest(CliCase):
    def test_what_can_not_be_drawn_is_told_before_anything_is_asked(self):
        out = ("-o", self.path("figure.svg"))
        for sentence, *words in (
                ("plot survival shows 1 to 8 submissions", "plot", "survival", *out),
                ("plot distributions shows 1 submission:", "plot", "distributions", "7", "8", *out),
                ("plot paired shows 2 submissions", "plot", "paired", "7", *out),
                ("named twice", "plot", "paired", "7", "7", *out),
                ("not a submission's number", "plot", "survival", "0", *out),
                ("give --track or --phase", "plot", "board", *out),
                ("shows a board, not submissions", "plot", "board", "7", "--track", "t", *out),
                ("leave out --track", "plot", "survival", "7", "--track", "t", *out),
                ("ends in .svg or .pdf", "plot", "survival", "7", "-o", self.path("a.png")),
                ("the file to write", "plot", "survival", "7"),
                ("KIND", "plot", "pie", "7", *out),
                ("name what to report on", "report", *out),
                ("covers one submission or one board", "report", "7", "--phase", "final", *out),
                ("ends in .html", "report", "7", *out),
                ("the file to write", "report", "7")):
            self.refused(2, sentence, *words, "--socket", self.path("none"))
        self.assertEqual(os.listdir(self.temp), [])

    def test_errors_of_the_daemon_leave_no_file(self):
        socket = self.serve({})
        file = self.path("figure.svg")
        self.refused(2, "There is no such thing", "plot", "survival", "7", "-o", file, "--socket",
                     socket)
        self.refused(3, "", "plot", "survival", "7", "-o", file, "--socket", self.path("none"))
        self.assertFalse(os.path.exists(file))

    def test_numbers_are_printed_without_a_file(self):
        socket = self.serve({path_of(7): (200, result(7, [1.0, 2.0], [1, 0]))})
        for kind in ("survival", "distributions"):
            found = self.checked("plot", "plot", kind, "7", "--socket", socket)
            self.assertEqual((found["kind"], found["file"]), (kind, None))
            self.assertEqual(found["numbers"][0]["submission"], 7)
        curves = self.checked("plot", "plot", "survival", "7", "--socket", socket)["numbers"]
        self.assertEqual(curves[0]["numbers"]["curves"]["time_s"]["share"], [1.0, 0.5])

    def test_paired_differences_have_the_boards_test_and_an_interval(self):
        first = result(7, [1.0] * 10, [1] * 10)
        second = result(8, [1.5] * 10, [0] * 10)
        second["episode_rows"][9]["seed"] = 1  # another episode
        socket = self.serve({path_of(7): (200, first), path_of(8): (200, second)})
        found = self.checked("plot", "plot", "paired", "7", "8", "--socket", socket)["numbers"]
        self.assertEqual(found["pairs"], 9)
        success, time = found["metrics"][:2]
        self.assertEqual((success["difference"], success["p"], success["method"]),
                         (1.0, 2 / 2 ** 9, "exact"))
        # Bonett and Price: (10 - 1)/11, and its error
        self.assertAlmostEqual(success["low"], 9 / 11 - 1.959964 * ((1 - (9 / 11) ** 2) / 11) ** 0.5,
                               5)
        self.assertEqual(success["high"], 1)
        self.assertEqual((time["difference"], time["low"], time["high"]), (-0.5, -0.5, -0.5))

    def test_submissions_on_other_seeds_can_not_be_paired(self):
        second = result(8, [1.0, 2.0], [1, 0])
        for row in second["episode_rows"]:
            row["seed"] = None
        socket = self.serve({path_of(7): (200, result(7, [1.0, 2.0], [1, 0])),
                             path_of(8): (200, second)})
        self.refused(2, "no episodes on the same seeds", "plot", "paired", "7", "8", "-o",
                     self.path("a.svg"), "--socket", socket)

    def test_what_a_phase_withholds_is_no_figure(self):
        hidden = result(7, [1.0], [1], withheld=["metrics", "outcomes"])
        hidden["episode_rows"][0].update(metrics=None, outcome=None, sim_time_s=None, facts=None)
        socket = self.serve({path_of(7): (200, hidden)})
        self.refused(2, "withholds the metrics", "plot", "distributions", "7", "-o",
                     self.path("a.svg"), "--socket", socket)

    def test_a_boards_history_is_asked_where_something_changed(self):
        socket = self.serve(OF_PHASE)
        found = self.checked("plot", "plot", "board", "--phase", "final", "--socket", socket)
        asked = [path for _, path, _ in Handler.heard if "&at=" in path]
        self.assertEqual([path.split("=")[-1][:10] for path in asked],
                         [at(2)[:10], at(6)[:10], at(7)[:10]])
        numbers = found["numbers"]
        self.assertEqual(numbers["moments"], [at(2), at(6), at(9)])  # the mark changed nothing
        self.assertEqual([team["values"] for team in numbers["teams"]],
                         [[7.5, 7.5, 7.5], [None, 7.5, 7.5]])

    def test_the_report_of_a_phase_has_what_the_caller_may_see(self):
        socket = self.serve(OF_PHASE)
        found = self.checked("report", "report", "--phase", "final", "--socket", socket)
        numbers = found["numbers"]
        self.assertEqual(found["of"], "board")
        self.assertEqual([row["team"] for row in numbers["ranking"]], ["alpha", "beta"])
        self.assertTrue(any("There is no evaluation 19." in one for one in numbers["missing"]))

    def test_a_figure_is_written_or_the_lack_of_matplotlib_told(self):
        socket = self.serve({path_of(7): (200, result(7, [1.0, 2.0], [1, 0]))})
        file = self.path("figure.svg")
        words = ("plot", "survival", "7", "-o", file, "--socket", socket)
        if not HAS_MATPLOTLIB:
            self.refused(4, "install Debian's package python3-matplotlib", *words)
            self.assertFalse(os.path.exists(file))
            # Nothing is asked for what can't be drawn.
            silent = self.serve({})
            for words in (("plot", "board", "--track", "demo", "-o", file), ("report", "7", "-o", self.path("r.html"))):
                self.refused(4, "install Debian's package python3-matplotlib", *words, "--socket", silent)
            return
        done = myograde(*words, "--json")
        self.assertEqual(done.returncode, 0, done.stderr)
        told = json.loads(done.stdout)
        validate(told, "plot")
        with open(file, "rb") as written:
            data = written.read()
        self.assertEqual((len(data), data[:5]), (told["bytes"], b"<?xml"))

    def test_a_report_without_receipt_or_pictures_says_why(self):
        if not HAS_MATPLOTLIB:
            self.skipTest("this host has no matplotlib")
        socket = self.serve({path_of(7): (200, result(7, [1.0, 2.0], [1, 0])),
                             "GET /v1/submissions/7/receipt": (409, {"error": {
                                 "code": "withheld", "message": "The phase <withholds> it."}})})
        file = self.path("report.html")
        done = myograde("report", "7", "-o", file, "--socket", socket)
        self.assertEqual(done.returncode, 0, done.stderr)
        with open(file, encoding="utf-8") as written:
            text = written.read()
        self.assertIn("There is no receipt: The phase &lt;withholds&gt; it.", text)
        self.assertIn("There are no pictures: ", text)
        self.assertNotIn("There are no pictures: myograde", text)

    def test_an_interrupt_leaves_nothing(self):
        pages = {f"GET /v1/record?limit=1000&from={index}": (200, {"entries": [],
                                                                  "next_from": index + 1})
                 for index in range(100_000)}  # asked one after the other, for minutes
        socket = self.serve({**OF_PHASE, **pages})
        file = self.path("figure.svg")
        verb = subprocess.Popen([f"{BIN_DIR}/myograde", "plot", "board", "--phase", "final", "-o",
                                 file, "--socket", socket], stdin=subprocess.DEVNULL,
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        deadline = time.monotonic() + 60
        while not any("/v1/record" in path for _, path, _ in Handler.heard):
            self.assertLess(time.monotonic(), deadline)
            time.sleep(0.02)
        verb.send_signal(signal.SIGINT)
        out, errors = verb.communicate(timeout=60)
        self.assertEqual((verb.returncode, out, errors),
                         (1, "", "myograde: interrupted; nothing was written\n"))
        self.assertEqual(os.listdir(self.temp), ["sock"])

    def test_a_program_that_fails_is_a_sentence(self):
        broken = {**result(7, [1.0], [1]), "metrics": [{"name": 7}]}
        socket = self.serve({path_of(7): (200, broken)})
        self.refused(4, "can't draw the figure: the drawing program exited with status 1",
                     "plot", "distributions", "7", "-o", self.path("a.svg"), "--socket", socket)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
