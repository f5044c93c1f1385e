"""Sends on channels that are the grader's, or that look as if somebody might listen."""
import sys

import hostile

CHANNEL = sys.argv[1]


def attack(_player):
    bus = hostile.RawBus()
    for _ in range(20):
        bus.publish(CHANNEL, hostile.still(0, 3))
    hostile.report("sent", "20")


hostile.play(attack)
