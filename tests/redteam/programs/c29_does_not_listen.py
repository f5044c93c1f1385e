"""Answers before it is asked, never reads, or reads a byte a second."""
import sys
import time

import hostile


def answers_early(player):
    """Sends one answer to the next question in advance, and none when it is asked."""
    bus = hostile.RawBus()
    bus.publish("MYOGRADE_ACTION", hostile.still(player.now[0], player.now[1] + 1))
    hostile.report("early", "sent")
    time.sleep(3600)


def never_reads(_player):
    """Joins the bus repeatedly without reading, so that every packet is queued in many places."""
    heard = [hostile.listener() for _ in range(100)]
    hostile.report("sockets", len(heard))
    time.sleep(3600)


def reads_slowly(_player):
    heard = hostile.listener()
    hostile.report("reading", "slowly")
    while True:
        heard.recv(1)
        time.sleep(1)


WAYS = {"early": answers_early, "never": never_reads, "slowly": reads_slowly}
hostile.play(WAYS[sys.argv[1]])
