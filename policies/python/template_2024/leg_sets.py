"""Parameter sets of the prosthetic leg, from the nested dictionary of the 2024 template."""

import os

from myograde.leg_parameter_set_t import leg_parameter_set_t
from myograde.leg_state_t import leg_state_t
from myograde.leg_threshold_t import leg_threshold_t

COUNT = 4  # the official environment's
_STATES = ("e_stance", "l_stance", "e_swing", "l_swing")
_QUANTITIES = ("load", "knee_angle", "knee_vel", "ankle_angle", "ankle_vel")
# Set by play_agent.py: whether the agent ever calls change_osl_mode.
CHANGES_SETS = "MYOGRADE_TEMPLATE_CHANGES_SETS"


def agent_changes_sets():
    return os.environ.get(CHANGES_SETS, "1") == "1"


def from_dictionary(sets):
    """{index: {state: {"gain": {...}, "threshold": {quantity: (value, "above" or "below")}}}} as
    leg_parameter_set_t values. KeyError or ValueError where something is missing or unknown."""
    return [_parameter_set(int(index), states) for index, states in sorted(sets.items())]


def _parameter_set(index, states):
    if not 0 <= index < COUNT:
        raise ValueError(f"parameter set {index}: there are sets 0 to {COUNT - 1}")
    result = leg_parameter_set_t()
    result.index = index
    result.states = [_state(states[name]) for name in _STATES]
    return result


def _state(entries):
    gain, result = entries["gain"], leg_state_t()
    for joint in ("knee", "ankle"):
        setattr(result, f"{joint}_stiffness", float(gain[f"{joint}_stiffness"]))
        setattr(result, f"{joint}_damping", float(gain[f"{joint}_damping"]))
        setattr(result, f"{joint}_target", float(gain[f"{joint}_target_angle"]))
    result.thresholds = [_threshold(*entry) for entry in entries["threshold"].items()]
    result.num_thresholds = len(result.thresholds)
    return result


def _threshold(quantity, condition):
    value, direction = condition
    if direction not in ("above", "below"):
        raise ValueError(f'threshold {quantity}: "{direction}" must be "above" or "below"')
    result = leg_threshold_t()
    result.quantity = _QUANTITIES.index(quantity)
    result.above = int(direction == "above")
    result.value = float(value)
    return result
