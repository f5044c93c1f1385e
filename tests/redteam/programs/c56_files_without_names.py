"""Fills its disk with files that are already unlinked, and waits."""
import os
import time

import hostile


def attack(_player):
    try:
        while True:
            fd = os.open("/tmp/gone", os.O_CREAT | os.O_RDWR | os.O_EXCL)
            os.unlink("/tmp/gone")
            for _ in range(4):
                os.write(fd, b"\1" * (1 << 20))
    except OSError as full:
        hostile.report("stopped", full.errno in (28, 24) and "full" or full.errno)
    time.sleep(3600)


hostile.play(attack)
