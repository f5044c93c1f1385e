"""Works in children that nobody waits for, so that no parent's account includes their time."""
import os
import signal
import sys
import time

import hostile

LIFE_S = {"long": 0.1, "short": 0.004, "grandchildren": 0.02, "some": 0.01}[sys.argv[1]]


def work():
    while time.process_time() < LIFE_S:
        pass
    os._exit(0)


def churn(_player):
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    number = 0
    while True:
        number += 1
        if sys.argv[1] == "some":
            # Waits for some, as if for all.
            signal.signal(signal.SIGCHLD, signal.SIG_IGN if number % 20 else signal.SIG_DFL)
        if os.fork() == 0:
            if sys.argv[1] == "grandchildren" and os.fork():
                os._exit(0)
            work()
        try:
            os.wait()
        except ChildProcessError:
            # A grandchild may outlive its parent, so that no wait returns at its end.
            time.sleep(LIFE_S if sys.argv[1] == "grandchildren" else 0)


hostile.play(churn)
