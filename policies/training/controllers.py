"""The baselines' controllers (policies/baseline, C++) for the search, by ctypes."""

from __future__ import annotations

import ctypes
import dataclasses
import functools
import json
import pathlib
import re
from types import MappingProxyType
from typing import Any, Mapping

import numpy as np

from myograde.policy.leg import STATES, Joint, LegSet, LegState, Threshold

# A threshold that nothing reaches: the sets' states are all the same, and stay where they are.
NEVER = (Threshold("load", -1e9, above=False),)


@dataclasses.dataclass(frozen=True)
class Parameter:
    """A number that the search may change."""

    name: str
    start: float
    deviation: float
    low: float
    high: float


def read_numbers(path: pathlib.Path, parameters: list[Parameter],
                 changed: Mapping[str, float] = MappingProxyType({})) -> np.ndarray:
    """The numbers in best.json of a search or a file of policies/baseline/parameters, in the order of
    `parameters`: those that the file lacks are where searches start, and `changed` replaces some."""
    given = {**json.loads(path.read_text())["parameters"], **changed}
    return np.array([given.get(p.name, p.start) for p in parameters])


def written(content: dict[str, Any]) -> str:
    """The content as JSON, with a line for each list of numbers."""
    text = json.dumps(content, indent=1)
    return re.sub(r"\[[^\[\]{}]*\]", lambda found: f"[{' '.join(found[0][1:-1].split())}]",
                  text) + "\n"


class Library:
    """The shared library baseline_controllers."""

    def __init__(self, path: pathlib.Path) -> None:
        """OSError if it is not there or can't be loaded."""
        self.lib = ctypes.CDLL(str(path.resolve()))
        numbers = ctypes.POINTER(ctypes.c_double)
        for name, result, arguments in (
                ("parameter_count", ctypes.c_size_t, []),
                ("parameter_name", ctypes.c_char_p, [ctypes.c_size_t]),
                ("parameter_info", None, [ctypes.c_size_t, numbers]),
                ("make", ctypes.c_void_p, [numbers]),
                ("free", None, [ctypes.c_void_p]),
                ("reset", None, [ctypes.c_void_p]),
                ("act", None, [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p])):
            for controller in CONTROLLERS:
                function = getattr(self.lib, f"{controller}_{name}")
                function.restype, function.argtypes = result, arguments
        self.lib.walker_leg_modes.restype = None
        self.lib.walker_leg_modes.argtypes = [ctypes.c_void_p, numbers]
        self.lib.turner_open.restype = ctypes.c_void_p
        self.lib.turner_open.argtypes = [ctypes.c_char_p, ctypes.c_char_p, ctypes.c_size_t]
        self.lib.walker_expect.restype = None
        self.lib.walker_expect.argtypes = [ctypes.c_void_p, ctypes.c_char_p]

    def parameters(self, controller: str = "walker") -> list[Parameter]:
        """The controller's parameters, in the order of its numbers."""
        call = functools.partial(self.call, controller)
        found = []
        for i in range(call("parameter_count")):
            info = (ctypes.c_double * 4)()
            call("parameter_info", i, info)
            found.append(Parameter(call("parameter_name", i).decode(), *info))
        return found

    def call(self, controller: str, function: str, *arguments: Any) -> Any:
        """A function of that controller."""
        return getattr(self.lib, f"{controller}_{function}")(*arguments)


class Controller:
    """One controller with its own state. `numbers`: as Library.parameters() orders them."""

    name: str
    track: str    # as the environment is called
    profile: str  # that it plays unless told otherwise
    action_size: int

    def __init__(self, library: Library, numbers: np.ndarray) -> None:
        self._library = library
        values = np.ascontiguousarray(numbers, dtype=np.float64)
        self._handle = library.call(self.name, "make",
                                    values.ctypes.data_as(ctypes.POINTER(ctypes.c_double)))

    def __del__(self) -> None:
        if self._handle is not None:
            self._library.call(self.name, "free", self._handle)

    def reset(self) -> None:
        """Begins an episode."""
        self._library.call(self.name, "reset", self._handle)

    def act(self, observation: np.ndarray, action: np.ndarray) -> None:
        """Fills `action`; both are contiguous rows of float64."""
        self._library.call(self.name, "act", self._handle, observation.ctypes.data,
                           action.ctypes.data)


class Walker(Controller):
    """The controller of the track locomotion."""

    name = "walker"
    track = "Locomotion"
    profile = "paper"
    action_size = 55

    def expect(self, profile: str) -> None:
        """Which profile's observations the next ones are; those of `paper` before the first call."""
        self._library.call(self.name, "expect", self._handle, profile.encode())

    def leg_sets(self) -> list[LegSet]:
        """What the walker uploads for the prosthetic leg."""
        numbers = (ctypes.c_double * 24)()
        self._library.call(self.name, "leg_modes", self._handle, numbers)
        sets = []
        for index, mode in enumerate(np.array(numbers).reshape(4, 6)):
            state = LegState(Joint(*mode[:3]), Joint(*mode[3:]), NEVER)
            sets.append(LegSet(index, **{name: state for name in STATES}))
        return sets


class Reacher(Controller):
    """The controller of the track manipulation."""

    name = "reacher"
    track = "Manipulation"
    profile = "paper"
    action_size = 80


class Carrier(Controller):
    """The controller of the track relocation."""

    name = "carrier"
    track = "Relocation"
    profile = "official"
    action_size = 63


class Juggler(Controller):
    """The controller of the track baoding."""

    name = "juggler"
    track = "Baoding"
    profile = "official"
    action_size = 39


class Tagger(Controller):
    """The controller of the track chasetag."""

    name = "tagger"
    track = "ChaseTag"
    profile = "official"
    action_size = 80


class Turner(Controller):
    """The controller of the track reorientation. Its numbers are those of its only turn."""

    name = "turner"
    track = "Reorientation"
    profile = "official"
    action_size = 39

    @classmethod
    def of_file(cls, library: Library, path: pathlib.Path) -> Turner:
        """One with the turns of a file of policies/baseline/parameters. ValueError with the reason
        if it is not one."""
        turner = cls.__new__(cls)
        turner._library = library
        reason = ctypes.create_string_buffer(300)
        turner._handle = library.lib.turner_open(str(path).encode(), reason, len(reason))
        if turner._handle is None:
            raise ValueError(reason.value.decode())
        return turner


CONTROLLERS = {kind.name: kind for kind in (Walker, Reacher, Carrier, Juggler, Tagger, Turner)}
