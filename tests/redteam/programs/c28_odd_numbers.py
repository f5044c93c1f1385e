"""Actions of NaN, infinity, huge, tiny, and the wrong number of them."""
import sys

import myograde

import hostile

VALUES = {"nan": float("nan"), "infinite": float("inf"), "minus-infinite": float("-inf"),
          "huge": 1e308, "minus-huge": -1e308, "denormal": 5e-324}
WHAT = sys.argv[1]


class Odd(myograde.Policy):
    """Like the honest player, with odd numbers from the fourth step on, sent past the kit, which
    would reject them."""

    name = "odd"

    def __init__(self):
        self.bus = hostile.RawBus()
        self.now = (-1, -1)

    def reset(self, episode):
        self.now = (episode.episode, -1)

    def act(self, observation):
        self.now = (self.now[0], self.now[1] + 1)
        size = self.welcome.action_size
        if self.now[1] < 3:
            return [0.0] * size
        if WHAT in ("huge", "minus-huge", "denormal"):
            return [VALUES[WHAT]] * size
        values = [0.0] * size
        if WHAT in VALUES:
            values[size // 2] = VALUES[WHAT]
        else:
            values = [0.0] * {"none": 0, "fewer": size - 1, "more": size + 1, "many": 1000}[WHAT]
        self.bus.publish("MYOGRADE_ACTION", hostile.action(*self.now, values))
        return [0.0] * size


myograde.serve(Odd())
