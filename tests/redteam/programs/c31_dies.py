"""Ends in one of several ways."""
import os
import signal
import sys
import time

import hostile


def by_signal(number):
    def attack(_player):
        if number != signal.SIGKILL:
            signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)
        time.sleep(10)
    return attack


def catches_xcpu(_player):
    """Ignores the kernel's first warning, and is killed at the second."""
    import resource
    signal.signal(signal.SIGXCPU, lambda _number, _frame: hostile.report("caught", "SIGXCPU"))
    used = int(time.process_time()) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (used, used + 1))
    while True:
        pass


WAYS = {
    "exit-0": lambda _player: os._exit(0),
    "exit-1": lambda _player: sys.exit(1),
    "exit-255": lambda _player: os._exit(255),
    "raises": lambda _player: 1 // 0,
    "abort": lambda _player: os.abort(),
    "xcpu-caught": catches_xcpu,
}
WAY = sys.argv[1]
hostile.play(WAYS[WAY] if WAY in WAYS else by_signal(getattr(signal, WAY)))
