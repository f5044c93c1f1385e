"""Hellos and readies of the largest size, with unexpected names and leg sets."""
import sys

import hostile
from myograde.episode_ready_t import episode_ready_t
from myograde.hello_t import hello_t
from myograde.leg_parameter_set_t import leg_parameter_set_t
from myograde.leg_state_t import leg_state_t
from myograde.leg_threshold_t import leg_threshold_t


def leg_set(stiffness, index=0, quantity=0):
    state = leg_state_t()
    state.knee_stiffness = state.ankle_stiffness = stiffness
    threshold = leg_threshold_t()
    threshold.quantity = quantity
    state.num_thresholds, state.thresholds = 1, [threshold]
    chosen = leg_parameter_set_t()
    chosen.index, chosen.states = index, [state] * 4
    return chosen


def ready(*sets):
    message = episode_ready_t()
    message.episode, message.num_leg_sets, message.leg_sets = 0, len(sets), list(sets)
    return "MYOGRADE_EPISODE_READY", message.encode()


def hello(name="x", version=1, direct=0):
    message = hello_t()
    message.protocol_version, message.name, message.direct = version, name, direct
    return "MYOGRADE_HELLO", message.encode()


WAYS = {
    "long-name": lambda: hello("n" * 60000),
    "old-version": lambda: hello(version=-1),
    "odd-convention": lambda: hello(direct=7),
    "nan-set": lambda: ready(leg_set(float("nan"))),
    "odd-index": lambda: ready(leg_set(1, index=-128)),
    "odd-quantity": lambda: ready(leg_set(1, quantity=127)),
    "same-set-twice": lambda: ready(leg_set(1), leg_set(2)),
}
bus = hostile.RawBus()
for _ in range(3):
    bus.publish(*WAYS[sys.argv[1]]())
hostile.play(lambda _player: [bus.publish(*WAYS[sys.argv[1]]()) for _ in range(2000)])
