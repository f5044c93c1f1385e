"""Checks that an observation has its extra parts (with "extra" on the command line) or none, and
that they fit the graded ones; a mistake ends it, which the grader records as a crash."""

import math
import sys

import myograde

EXTRA = {"max_force", "palm_pos", "fin0", "fin1", "fin2", "fin3", "fin4", "Rpalm_pos", "MPL_ori",
         "MPL_ori_err", "obj_pos"}


def check(condition, what):
    if not condition:
        sys.exit(f"error: {what}")


class Looks(myograde.Policy):
    name = "looks"

    def start(self):
        self.wants = EXTRA if "extra" in sys.argv[1:] else set()
        graded = set(myograde.track("manipulation").observation)
        check(set(self.observation_layout) == graded | self.wants, "other parts than wanted")
        check(self.welcome.observation_size == 222 + (31 if self.wants else 0), "another size")
        check(len(self.welcome.observation_low) == self.welcome.observation_size, "other bounds")

    def reset(self, episode):
        self.force = 0.0

    def act(self, observation):
        if self.wants:
            self.look(self.named(observation))
        return [0.0] * self.welcome.action_size

    def look(self, parts):
        def apart(first, second):
            return [a - b for a, b in zip(parts[first], parts[second])]
        check(list(parts["reach_err"]) == apart("palm_pos", "obj_pos"), "reach_err")
        check(list(parts["pass_err"]) == apart("Rpalm_pos", "obj_pos"), "pass_err")
        turned = [a - b for a, b in zip(parts["MPL_ori"], (math.pi, 0, math.pi))]
        check(list(parts["MPL_ori_err"]) == turned, "MPL_ori_err")
        for tip in range(5):
            away = math.dist(parts[f"fin{tip}"], parts["palm_pos"])
            check(0.01 < away < 0.25, f"fin{tip} is {away} m from the palm")
        check(parts["max_force"][0] >= self.force, "max_force shrinks")
        self.force = parts["max_force"][0]


myograde.serve(Looks())
