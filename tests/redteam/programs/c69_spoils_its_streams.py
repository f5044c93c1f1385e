"""Closes its streams, changes their flags and sizes, and lets another process keep them open."""
import fcntl
import os
import time

import hostile

F_SETPIPE_SZ = 1031


def hold():
    os.setsid()
    while True:
        try:
            os.write(1, b"held\n")
        except OSError:
            pass
        time.sleep(0.01)


def attack(_player):
    for fd in (1, 2):
        fcntl.fcntl(fd, fcntl.F_SETFL, os.O_NONBLOCK | os.O_APPEND)
        try:
            fcntl.fcntl(fd, F_SETPIPE_SZ, 1 << 20)
        except OSError:
            pass
    hostile.spawn(hold)
    hostile.report("streams", "spoiled")
    os.closerange(0, 3)
    os._exit(0)


hostile.play(attack)
