"""Sends signals to its parent, process 1, everybody, and every process number there is."""
import os
import signal
import sys

import hostile


def every_number(number):
    own = {int(name) for name in os.listdir("/proc/self/task")}  # a thread's number is ours too
    for pid in range(1, 65536):
        if pid not in own:
            try:
                os.kill(pid, number)
            except OSError:
                pass


def attack(_player):
    number = getattr(signal, sys.argv[1])
    if sys.argv[2] == "each":
        every_number(number)
    else:
        target = {"parent": os.getppid(), "first": 1, "all": -1}[sys.argv[2]]
        hostile.attempt(f"kill_{sys.argv[2]}", lambda: os.kill(target, number))
    hostile.report("survived", "yes")


hostile.play(attack)
