"""Answers three steps and thinks for ever about the fourth."""
import hostile


def spin(_player):
    while True:
        pass


hostile.play(spin)
