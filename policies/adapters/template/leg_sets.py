"""The prosthetic leg's parameter sets as agents of 2024 give them, and which of them is in
force.

In the official environment an upload fills a library of four sets, and change_osl_mode copies one
of them into the controller, where it stays through later uploads and resets. The grader's protocol
has four or five sets for each episode, by the rule profile, and selects one in each step. So the
library takes the first four, and what the controller has at the start of an episode the fifth, or
one that another is a copy of. Where neither is free, the set that the agent changed to last stands
for it, in its present form."""

from myograde.leg_parameter_set_t import leg_parameter_set_t
from myograde.leg_state_t import leg_state_t
from myograde.leg_threshold_t import leg_threshold_t
from myograde.policy.leg import leg_sets

COUNT = 4  # the official environment's
_IN_FORCE = 4
_STATES = ("e_stance", "l_stance", "e_swing", "l_swing")
_QUANTITIES = ("load", "knee_angle", "knee_vel", "ankle_angle", "ankle_vel")


class Leg:
    """`selected` is the set for the next step, as the grader counts them."""

    def __init__(self):
        self.selected = 0
        self._chosen = 0  # by the agent
        self._library = {}  # what was uploaded, by index
        self._in_force = 0  # an uploaded set, or the number of one of the grader's own
        self._place = list(range(COUNT))  # of each set of the library, in this episode

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
        own = [entry.message() for entry in leg_sets(profile)]
        sets = [self._library.get(index, own[index]) for index in range(COUNT)]
        in_force = own[self._in_force] if isinstance(self._in_force, int) else self._in_force
        contents = [_content(entry) for entry in sets]
        self._place = [contents.index(content) for content in contents]
        if _content(in_force) in contents:
            self.selected = contents.index(_content(in_force))
        else:
            free = [index for index in range(len(own)) if index not in self._place]
            self.selected = free[-1] if free else self._chosen
            if free:
                sets[free[-1]:free[-1] + 1] = [in_force]
        return [_numbered(entry, index) for index, entry in enumerate(sets)]

    def change(self, index):
        """Puts a set of the library in force."""
        if not 0 <= index < COUNT:
            raise ValueError(f"there is no parameter set {index}; there are 0 to {COUNT - 1}")
        self._chosen, self.selected = index, self._place[index]
        self._in_force = self._library.get(index, index)


def _content(parameters):
    return b"".join(state.encode() for state in parameters.states)


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
