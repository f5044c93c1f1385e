"""Leaves daemons behind: fork, setsid and fork again, each ignoring the hang-up."""
import os
import signal
import time

import hostile


def daemon():
    os.setsid()
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    if os.fork() == 0:
        for fd in range(3):
            os.close(fd)
        while True:
            time.sleep(1)


def attack(_player):
    for _ in range(20):
        os.waitpid(hostile.spawn(daemon), 0)
    alive = sum(name.isdigit() for name in os.listdir("/proc"))
    hostile.report("daemons", "running" if alive >= 20 else alive)


hostile.play(attack)
