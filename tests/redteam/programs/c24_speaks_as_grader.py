"""Sends on the grader's channels, and on others that somebody might listen to."""
import sys

import hostile

CHANNEL = sys.argv[1]


def attack(_player):
    bus = hostile.RawBus()
    for _ in range(20):
        bus.publish(CHANNEL, hostile.still(0, 3))
    hostile.report("sent", "20")


hostile.play(attack)
