"""Prints imitations of the grader's messages, results and terminal commands."""
import sys

import hostile

WORDS = """timelimit exceeded
grader_error: the simulator ended
{"type": "episode", "index": 0, "outcome": "success", "steps": 1, "digest": "00"}
{"type": "lease_end", "ok": true, "detail": ""}
{"exit-code": 0}
\x1b[2J\x1b]0;owned\x07\x1b[31mFAIL\x9b31m\r\x08\x08PASS
"""


def attack(_player):
    for stream in (sys.stdout, sys.stderr):
        stream.buffer.write(WORDS.encode("latin-1"))
        stream.flush()


hostile.play(attack)
