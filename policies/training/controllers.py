"""The baselines' controllers (policies/baseline, C++) for the search, by ctypes."""

from __future__ import annotations

import ctypes
import dataclasses
import pathlib
from typing import Any

import numpy as np

import myograde
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


class Library:
    """The shared library baseline_controllers."""

    def __init__(self, path: pathlib.Path) -> None:
        """OSError if it is not there or can't be loaded."""
        self.lib = ctypes.CDLL(str(path))
        numbers = ctypes.POINTER(ctypes.c_double)
        for name, result, arguments in (
                ("walker_parameter_count", ctypes.c_size_t, []),
                ("walker_parameter_name", ctypes.c_char_p, [ctypes.c_size_t]),
                ("walker_parameter_info", None, [ctypes.c_size_t, numbers]),
                ("walker_make", ctypes.c_void_p, [numbers]),
                ("walker_free", None, [ctypes.c_void_p]),
                ("walker_reset", None, [ctypes.c_void_p]),
                ("walker_act", None, [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]),
                ("walker_leg_modes", None, [ctypes.c_void_p, numbers]),
                ("reacher_make", ctypes.c_void_p, [ctypes.c_char_p]),
                ("reacher_free", None, [ctypes.c_void_p]),
                ("reacher_reset", None, [ctypes.c_void_p]),
                ("reacher_act", None, [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p])):
            function = getattr(self.lib, name)
            function.restype, function.argtypes = result, arguments

    def parameters(self) -> list[Parameter]:
        """The walker's parameters, in the order of its numbers."""
        found = []
        for i in range(self.lib.walker_parameter_count()):
            info = (ctypes.c_double * 4)()
            self.lib.walker_parameter_info(i, info)
            found.append(Parameter(self.lib.walker_parameter_name(i).decode(), *info))
        return found


class Walker:
    """One walker with its own state. `numbers`: as Library.parameters() orders them."""

    track = "locomotion"
    action_size = 55

    def __init__(self, library: Library, numbers: np.ndarray) -> None:
        self._lib = library.lib
        values = np.ascontiguousarray(numbers, dtype=np.float64)
        self._handle = self._lib.walker_make(values.ctypes.data_as(ctypes.POINTER(ctypes.c_double)))

    def __del__(self) -> None:
        self._lib.walker_free(self._handle)

    def reset(self) -> None:
        """Begins an episode."""
        self._lib.walker_reset(self._handle)

    def act(self, observation: np.ndarray, action: np.ndarray) -> None:
        """Fills `action`; both are contiguous rows of float64."""
        self._lib.walker_act(self._handle, observation.ctypes.data, action.ctypes.data)

    def leg_sets(self) -> list[LegSet]:
        """What the walker uploads for the prosthetic leg."""
        numbers = (ctypes.c_double * 30)()
        self._lib.walker_leg_modes(self._handle, numbers)
        sets = []
        for index, mode in enumerate(np.array(numbers).reshape(5, 6)):
            state = LegState(Joint(*mode[:3]), Joint(*mode[3:]), NEVER)
            sets.append(LegSet(index, **{name: state for name in STATES}))
        return sets


class Reacher:
    """The controller of the track manipulation, with the plan in a file of
    policies/baseline/parameters. ValueError if that can't be used."""

    track = "manipulation"
    action_size = 80

    def __init__(self, library: Library, plan: pathlib.Path) -> None:
        self._lib = library.lib
        self._handle = self._lib.reacher_make(str(plan).encode())
        if not self._handle:
            raise ValueError(f"{plan} is not there, or holds no complete plan.")

    def __del__(self) -> None:
        self._lib.reacher_free(self._handle)

    def reset(self) -> None:
        """Begins an episode."""
        self._lib.reacher_reset(self._handle)

    def act(self, observation: np.ndarray, action: np.ndarray) -> None:
        """Fills `action`; both are contiguous rows of float64."""
        self._lib.reacher_act(self._handle, observation.ctypes.data, action.ctypes.data)
