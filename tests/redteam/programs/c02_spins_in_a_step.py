"""Answers three steps and never finishes thinking about the fourth."""
import hostile


def spin(_player):
    while True:
        pass


hostile.play(spin)
