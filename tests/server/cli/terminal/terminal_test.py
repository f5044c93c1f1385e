"""The command line tool on terminals: its output fits them, and progress is drawn over on one
line.  usage: terminal_test.py BIN_DIR SOURCE_DIR"""
import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios
import unicodedata
import unittest

sys.path.insert(0, os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
from cli_case import (  # pylint: disable=wrong-import-position
    BIN_DIR, COUNTS, HASHES, LONG_BOARD, RESULT, SOURCE_DIR, STATUS, VERBS, CliCase, Handler,
    myograde)

ROWS = [{"index": i, "seed": 2**62 + i, "outcome": "crash", "reason": "-", "steps": 100,
         "metrics": {"time_s": 1.5, "distance_m": 2.25, "effort": 0.01}, "digest": "d" * 64,
         "fault": {"detail": "the policy died of signal 11" if i < 9 else "it left with status 3"}}
        for i in range(10)]


class Screen:
    """A terminal with some columns, as far as the tool uses one."""

    def __init__(self, columns):
        self.columns = columns
        self.rows = [""]
        self.column = 0
        self.too_long = []  # rows that overflowed into the next

    def feed(self, text):
        for piece in re.findall(r"\x1b\[[0-9;]*[A-Za-z]|.", text, re.DOTALL):
            if piece == "\r":
                self.column = 0
            elif piece == "\n":
                self.rows.append("")
                self.column = 0
            elif piece == "\x1b[K":
                self.rows[-1] = self.rows[-1][:self.column]
            elif not piece.startswith("\x1b"):
                self.put(piece)
        return self

    def put(self, letter):
        width = (0 if unicodedata.combining(letter) else
                 2 if unicodedata.east_asian_width(letter) in "WF" else 1)
        if self.column + width > self.columns:
            self.too_long.append(self.rows[-1])
            self.rows.append("")
            self.column = 0
        self.rows[-1] = self.rows[-1][:self.column] + letter
        self.column += width


def on_terminal(columns, *args, **env):
    """The exit status, the complete output and the final screen."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    process = subprocess.Popen(
        [f"{BIN_DIR}/myograde", *args], stdin=theirs, stdout=theirs, stderr=theirs,
        env={**os.environ, "MYOGRADE_CONFIG_DIR": f"{SOURCE_DIR}/configs", **env})
    os.close(theirs)
    written = b""
    while True:
        try:
            piece = os.read(ours, 65536)
        except OSError:  # the other side has closed
            piece = b""
        if not piece:
            break
        written += piece
    os.close(ours)
    text = written.decode().replace("\r\n", "\n")
    return process.wait(timeout=60), text, Screen(columns).feed(text)


class TerminalTest(CliCase):
    """The tool's output fits the terminal, and progress stays on one line."""

    def test_nothing_is_longer_than_a_line(self):
        status = {**STATUS, "state": "running", "deadline_at": "2026-11-22T02:10:54.123Z",
                  "owner": "daemon 22288", "waiting": "1 block of episodes waits " * 8,
                  "blocks": [{"block": 1, "first": 0, "last": 9, "state": "running",
                              "host": "a-host-with-a-name", "slot": 1, "attempt": 1, "faults": 0,
                              "running_wall_s": 7200.5, "episode": 3, "step": 12345}]}
        socket = self.serve({
            "GET /v1/leaderboard?track=locomotion&board=main": (200, LONG_BOARD),
            "GET /v1/submissions/7": (200, status),
            "GET /v1/submissions/7/result?episodes=1": (200, {
                **RESULT, "hashes": HASHES, "merkle_root": "9" * 64, "episode_rows": ROWS})})
        at = ("--socket", socket)
        for columns in (80, 40):
            for args in (("leaderboard", "--track", "locomotion", *at), ("status", "7", *at),
                         ("show", "7", "--episodes", *at),
                         ("show", "7", "--episodes", "--full-hashes", *at),
                         ("spec", "--track", "locomotion"), ("spec", "--track", "manipulation"),
                         ("spec",), ("show", "abc"), ("sbmit",), ("--help",),
                         *((*verb.split(), "--help") for verb in VERBS)):
                with self.subTest(columns=columns, args=args):
                    _, _, screen = on_terminal(columns, *args)
                    self.assertEqual(screen.too_long, [])
            _, text, _ = on_terminal(columns, "leaderboard", "--track", "locomotion", *at)
            for team in ("Somewhere", "東京", "99.1234"):
                self.assertIn(team, text)

    def test_what_policies_wrote_begins_no_line(self):
        for forged in ("Submission 1 of alpha: done".replace(" ", blank).ljust(80, blank)
                       for blank in ("\u00a0", "\u2007", "\u2800", "_")):
            rows = [{**ROWS[0], "fault": {"detail": f"oops {forged} end"}}]
            result = {**RESULT, "episode_rows": rows, "output": [
                {"first": 0, "last": 1, "stderr_tail": f"oops {forged} end\n" + "\t" * 12 + forged,
                 "stdout_tail": ""}]}
            socket = self.serve({"GET /v1/submissions/7/result": (200, result),
                                 "GET /v1/submissions/7/result?episodes=1": (200, result)})
            for words in (["--episodes"], []):
                status, _, screen = on_terminal(80, "show", "7", *words, "--socket", socket)
                self.assertEqual(status, 0, screen.rows)
                self.assertEqual(screen.too_long, [])
                self.assertFalse([row for row in screen.rows if re.match("Submission.1", row)], screen.rows)
            begin = next(i for i, row in enumerate(screen.rows) if row.startswith("  | oops"))
            marked = [row for row in screen.rows[begin:] if row]
            self.assertGreater(len(marked), 3)
            self.assertEqual([row for row in marked if not row.startswith("  |")], [])
            os.remove(socket)

    def test_an_export_is_not_printed(self):
        status, text, _ = on_terminal(200, "store", "export", "--socket", self.path("none", ""))
        self.assertEqual(status, 2, text)
        self.assertIn("name a FILE, or redirect standard output", text)

    def test_what_is_drawn_over_stays_one_line(self):
        queued = {**STATUS, "state": "queued", "waiting": "1 block of episodes waits for a slot: "
                  "2 of 2 are taken, and 17 blocks of episodes of others are ahead",
                  "episodes": {**COUNTS, "total": 100, "done": 0}}
        running = [{**STATUS, "state": "running", "episodes": {**COUNTS, "total": 100, "done": n}}
                   for n in (0, 0, 1, 1, 1, 1, 3, 3, 3)]
        done = {**STATUS, "episodes": {**COUNTS, "total": 100, "done": 100}}
        for columns in (80, 40):
            socket = self.serve({
                "POST /v1/artefacts?team=alpha&track=t": (201, {"artefact": "a" * 64}),
                "POST /v1/submissions": (201, STATUS),
                "GET /v1/submissions/7": (200, [queued, queued, *running, done]),
                "GET /v1/submissions/7/result?episodes=1": (200, {**RESULT, "episode_rows": ROWS})})
            program = self.path("program", "#!/bin/sh\n", 0o755)
            status, text, screen = on_terminal(
                columns, "submit", program, "--track", "t", "--team", "alpha", "--wait",
                "--socket", socket)
            self.assertEqual(status, 0, text)
            self.assertEqual(screen.too_long, [])
            drawn = [row for row in screen.rows if row.startswith("submission 7 ")]
            self.assertEqual(len(drawn), 1, screen.rows)
            self.assertIn("100/100", drawn[0])
            self.assertIn("episodes 0, 1, 2, 3, 4, 5, 6, 7 and 1 more: the policy died of signal "
                          "11", " ".join(row.strip() for row in screen.rows))
            self.assertIn("episode 9: it left with status 3", text)
            os.remove(socket)
            left = {}  # by the count: the estimates shown beside it
            for count, minutes, seconds in re.findall(
                    r" (\d+)/100 .*?(?:(\d+) min )?(\d+) s left", text):
                left.setdefault(count, []).append(60 * int(minutes or 0) + int(seconds))
            self.assertIn("1", left, text)
            for estimates in left.values():
                self.assertEqual(estimates, sorted(estimates, reverse=True), text)

    def test_long_uploads_are_seen_and_short_ones_are_not(self):
        socket = self.serve({
            "POST /v1/artefacts?team=alpha&track=t": (201, {"artefact": "a" * 64}),
            "POST /v1/submissions": (201, STATUS)})
        program = self.path("program", "#!/bin/sh\n" + "#" * (4 << 20), 0o755)
        submit = ("submit", program, "--track", "t", "--team", "alpha", "--socket", socket)
        _, text, _ = on_terminal(80, *submit)
        self.assertNotIn("sending", text)
        Handler.pause = 0.2
        self.addCleanup(setattr, Handler, "pause", 0)
        status, text, screen = on_terminal(40, *submit)
        self.assertEqual(status, 0, text)
        self.assertRegex(text, r"sending  .*[0-9.]+ MB of 4\.2 MB")
        self.assertEqual(screen.too_long, [])
        self.assertFalse([row for row in screen.rows if "sending" in row],
                         "it goes when it is over")
        quiet = myograde(*submit)
        self.assertEqual(quiet.stderr, "")


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
