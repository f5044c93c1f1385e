"""Asks for all processors and the highest priority, and uses what it gets with four children."""
import os
import time

import hostile

CHILDREN = 4
WALL_S = 1.5


def spin():
    while True:
        pass


def attack(_player):
    hostile.attempt("nice", lambda: os.setpriority(os.PRIO_PROCESS, 0, -5))
    hostile.attempt("fifo", lambda: os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1)))
    hostile.attempt("round_robin",
                    lambda: os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1)))
    try:
        os.sched_setaffinity(0, range(os.cpu_count()))
    except OSError:
        pass  # measured by what can be used of them
    begin = time.monotonic()
    children = [hostile.spawn(spin) for _ in range(CHILDREN)]
    time.sleep(WALL_S)
    wall = time.monotonic() - begin
    for pid in children:
        os.kill(pid, 9)
        os.waitpid(pid, 0)
    used = os.times()
    hostile.report("busy_tenths", int(10 * (used.children_user + used.children_system) / wall))


hostile.play(attack)
