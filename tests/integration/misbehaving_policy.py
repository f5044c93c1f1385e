"""A policy that does what its first argument says, for the whole-system tests.

Everything but "well" is wrong in one way; each has an expected outcome in
whole_system_test.py. At step 3 of the run's second episode it misbehaves, so
that the episode before shows that nothing else was wrong.
"""

import os
import sys
import time

import lcm

import myograde
from myograde.action_t import action_t

MODE = sys.argv[1]
FATAL_EPISODE = 1
FATAL_STEP = 3
# What the kit sends as it is, for the grader to judge.
WRONG_ANSWERS = {
    "short": lambda size: [0.0] * (size - 1),
    "none": lambda size: [],
    "long": lambda size: [0.0] * 100000,
    "nan": lambda size: [float("nan")] + [0.0] * (size - 1),
    "infinite": lambda size: [float("-inf")] * size,
}


class Misbehaving(myograde.Policy):
    name = "misbehaving"

    def reset(self, episode):
        self.episode = episode.episode
        self.step = -1

    def act(self, observation):
        self.step += 1
        size = self.welcome.action_size
        if self.episode == FATAL_EPISODE and self.step == FATAL_STEP:
            if MODE == "exits":
                sys.stderr.write("the policy lost its weights\n")
                sys.exit(7)
            if MODE == "aborts":
                os.abort()
            if MODE == "sleeps":
                time.sleep(3600)
            if MODE == "spins":
                while True:
                    pass
            if MODE == "wrong-step":
                self.answer_another_step(size)
            if MODE in WRONG_ANSWERS:
                return WRONG_ANSWERS[MODE](size)
        return [0.0] * size

    def answer_another_step(self, size):
        """Past the kit, which would not."""
        bus = lcm.LCM(os.environ["MYOGRADE_LCM_URL"])
        action = action_t()
        action.episode = self.episode
        action.step = self.step + 2
        action.size = size
        action.values = [0.0] * size
        while True:
            bus.publish("MYOGRADE_ACTION", action.encode())
            time.sleep(0.05)


if MODE == "silent":
    time.sleep(3600)
myograde.serve(Misbehaving())
