"""Uses a share of its budget for a step, in three steps of each episode."""
import sys
import time

import hostile

SECONDS = float(sys.argv[1])
SLOW_STEPS = (3, 5, 7)


class Slow(hostile.Player):
    def act(self, observation):
        answer = super().act(observation)
        if self.now[1] in SLOW_STEPS:
            end = time.process_time() + SECONDS
            while time.process_time() < end:
                pass
        return answer


hostile.myograde.serve(Slow())
