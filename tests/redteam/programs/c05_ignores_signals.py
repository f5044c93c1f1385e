"""Ignores every signal that can be ignored, in itself and in children of its own session."""
import os
import signal
import time

import hostile


def ignore_all():
    for number in range(1, signal.NSIG):
        if number not in (signal.SIGKILL, signal.SIGSTOP):
            try:
                signal.signal(number, signal.SIG_IGN)
            except (OSError, ValueError):
                pass  # the C library keeps some for itself


def linger():
    os.setsid()
    while True:
        time.sleep(10)


def attack(_player):
    ignore_all()
    for _ in range(5):
        hostile.spawn(linger)
    while True:
        time.sleep(10)


hostile.play(attack)
