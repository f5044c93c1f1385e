"""Prints what would break a log: a flood, very long lines, NULs, invalid UTF-8."""
import os
import sys

import hostile

WHAT = {
    "flood": b"flood \n" * 10000,
    "lines": b"x" * (128 << 10) + b"\n",
    "nul": b"before\0after\0\0\n" * 5000,
    "invalid": bytes(range(128, 256)) * 500 + b"\xc3\xed\xa0\x80\xf4\x90\x80\x80\n",
}


def attack(_player):
    for _ in range(8):
        os.write(2, WHAT[sys.argv[1]])


hostile.play(attack, step=5)
