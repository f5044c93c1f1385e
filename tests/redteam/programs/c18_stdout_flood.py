"""Prints 20 MiB and plays on."""
import os

import hostile


def attack(_player):
    block = b"a long line without any end " * 2048
    for _ in range(20 * 2**20 // len(block)):
        os.write(1, block)


hostile.play(attack)
