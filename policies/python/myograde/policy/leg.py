"""Parameter sets of the prosthetic leg (locomotion): an impedance controller with four states, and
conditions that leave each. A policy uploads sets by Policy.leg_sets; leg_sets() returns those that
the grader has by itself."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, Mapping

from ..messages import leg_parameter_set_t, leg_state_t, leg_threshold_t
from .layout import read_tracks

STATES = ("e_stance", "l_stance", "e_swing", "l_swing")
# Loads in N, angles in rad, velocities in rad/s; in the order of leg_threshold_t's numbers.
QUANTITIES = ("load", "knee_angle", "knee_velocity", "ankle_angle", "ankle_velocity")
# Of person and leg, as the grader's controller takes it.
BODY_WEIGHT_N = 78.66887849930261 * 9.81
_OF_CONFIG = {"load": "load", "knee_deg": "knee_angle", "knee_deg_s": "knee_velocity",
              "ankle_deg": "ankle_angle", "ankle_deg_s": "ankle_velocity"}


@dataclasses.dataclass(frozen=True)
class Joint:
    """torque = stiffness (target - angle) - damping velocity."""

    stiffness: float  # N m/rad, 0 to 2000
    damping: float  # N m s/rad, 0 to 200
    target: float  # rad; knee 0 to 2.0944, ankle -0.5236 to 0.5236


@dataclasses.dataclass(frozen=True)
class Threshold:
    """Leaves a state when `quantity` is above `value`, or below it if `above` is False."""

    quantity: str  # of QUANTITIES
    value: float  # N, rad or rad/s
    above: bool

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise ValueError(f'there is no quantity "{self.quantity}"; known: '
                             + ", ".join(QUANTITIES))


@dataclasses.dataclass(frozen=True)
class LegState:
    """One state: it is left as soon as any threshold of `until` is met."""

    knee: Joint
    ankle: Joint
    until: tuple[Threshold, ...]  # 1 to 5, at most one for each quantity


@dataclasses.dataclass(frozen=True)
class LegSet:
    """The parameter set that replaces the grader's set `index`, 0 to 4."""

    index: int
    e_stance: LegState
    l_stance: LegState
    e_swing: LegState
    l_swing: LegState
    name: str = ""  # for people; not sent

    def message(self) -> Any:
        """As leg_parameter_set_t."""
        result = leg_parameter_set_t()
        result.index = self.index
        result.states = [_message_of(getattr(self, state)) for state in STATES]
        return result


def leg_sets(profile: str = "paper") -> list[LegSet]:
    """The sets that a rule profile of locomotion has before a policy uploads its own. ValueError if
    there is no such profile."""
    known = read_tracks()["locomotion"]["leg_sets"]
    if profile not in known:
        raise ValueError(f'locomotion has no profile "{profile}"; known: {", ".join(known)}')
    return [_of_config(index, config) for index, config in enumerate(known[profile])]


def _message_of(state: LegState) -> Any:
    result = leg_state_t()
    for name in ("knee", "ankle"):
        joint = getattr(state, name)
        setattr(result, f"{name}_stiffness", joint.stiffness)
        setattr(result, f"{name}_damping", joint.damping)
        setattr(result, f"{name}_target", joint.target)
    for until in state.until:
        threshold = leg_threshold_t()
        threshold.quantity = QUANTITIES.index(until.quantity)
        threshold.above = int(until.above)
        threshold.value = until.value
        result.thresholds.append(threshold)
    result.num_thresholds = len(result.thresholds)
    return result


def _of_config(index: int, config: Mapping[str, Any]) -> LegSet:
    e_stance, l_stance, e_swing, l_swing = (_state(config[name]) for name in STATES)
    return LegSet(index, e_stance, l_stance, e_swing, l_swing, config["name"])


def _state(config: Mapping[str, Any]) -> LegState:
    knee, ankle = (Joint(joint["stiffness"], joint["damping"], math.radians(joint["target_deg"]))
                   for joint in (config["knee"], config["ankle"]))
    return LegState(knee, ankle, tuple(_threshold(*until) for until in config["until"].items()))


def _threshold(key: str, value: float) -> Threshold:
    name, side = key.rsplit("_", 1)
    quantity = _OF_CONFIG[name]
    value = value * BODY_WEIGHT_N if quantity == "load" else math.radians(value)
    return Threshold(quantity, value, side == "above")
