"""Sleeps in one of several ways instead of answering."""
import select
import signal
import sys
import time

import hostile


def nap(player):
    """A little in each step: every step is in time, the lease is not."""
    time.sleep(0.5)
    player.when = (player.now[0], player.now[1] + 1)


WAYS = {
    "sleep": lambda _player: time.sleep(3600),
    "pause": lambda _player: signal.pause(),
    "select": lambda _player: select.select([], [], [], 3600),
    "naps": nap,
}
hostile.play(WAYS[sys.argv[1]])
