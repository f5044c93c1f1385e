"""Never waits for its dead children, until it gets no more process ids; then plays on."""
import os

import hostile


def attack(_player):
    zombies = 0
    try:
        while zombies < 5000:
            if os.fork() == 0:
                os._exit(0)
            zombies += 1
    except OSError:
        pass
    hostile.report("zombies", "many" if zombies >= 50 else zombies)


hostile.play(attack)
