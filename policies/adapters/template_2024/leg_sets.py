"""The prosthetic leg's parameter sets as the template's agents give them, and which of them is in
force.

In the official environment an upload fills a library of four sets, and change_osl_mode copies one
of them into the controller, where it stays through later uploads and resets. The grader's protocol
has five sets for each episode and selects one in each step: 0 to 3 are the library, and 4 is what
the controller has at the start of an episode."""

from myograde.leg_parameter_set_t import leg_parameter_set_t
from myograde.leg_state_t import leg_state_t
from myograde.leg_threshold_t import leg_threshold_t
from myograde.policy.leg import leg_sets

COUNT = 4  # the official environment's
_IN_FORCE = 4
_STATES = ("e_stance", "l_stance", "e_swing", "l_swing")
_QUANTITIES = ("load", "knee_angle", "knee_vel", "ankle_angle", "ankle_vel")


class Leg:
    """`selected` is the set for the next step."""

    def __init__(self):
        self.selected = 0
        self._library = {}  # what was uploaded, by index
        self._in_force = 0  # an uploaded set, or the number of one of the grader's own

    def upload(self, sets):
        """{index: {state: {"gain": {...}, "threshold": {quantity: (value, side)}}}}. ValueError
        where something is missing or unknown."""
        try:
            uploaded = {int(index): _parameter_set(int(index), states)
                        for index, states in dict(sets).items()}
        except KeyError as error:
            raise ValueError(f"a parameter set of the leg lacks {error}") from error
        except (TypeError, AttributeError) as error:
            raise ValueError(f"parameter sets of the leg are dictionaries ({error})") from error
        self._library.update(uploaded)

    def begin(self, profile):
        """The sets to use in an episode that begins now."""
        if not self._library:
            return []
        in_force = self._in_force
        if isinstance(in_force, int):
            in_force = leg_sets(profile)[in_force].message()
        self.selected = _IN_FORCE
        return [*self._library.values(), _numbered(in_force, _IN_FORCE)]

    def change(self, index):
        """Puts a set of the library in force."""
        if not 0 <= index < COUNT:
            raise ValueError(f"there is no parameter set {index}; there are 0 to {COUNT - 1}")
        self.selected = index
        self._in_force = self._library.get(index, index)


def _numbered(parameters, index):
    result = leg_parameter_set_t()
    result.index, result.states = index, parameters.states
    return result


def _parameter_set(index, states):
    if not 0 <= index < COUNT:
        raise ValueError(f"there is no parameter set {index}; there are 0 to {COUNT - 1}")
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
    value, side = condition
    if quantity not in _QUANTITIES:
        raise ValueError(f'threshold "{quantity}" is of no quantity; there are '
                         + ", ".join(_QUANTITIES))
    if side not in ("above", "below"):
        raise ValueError(f'threshold {quantity}: "{side}" must be "above" or "below"')
    result = leg_threshold_t()
    result.quantity = _QUANTITIES.index(quantity)
    result.above = int(side == "above")
    result.value = float(value)
    return result
