"""The kind of each argument of the environments, because the extension's own errors are for C++ programmers."""

from __future__ import annotations

import operator
import os
import reprlib
from typing import Any, Callable, Mapping, Optional, Sequence

import numpy as np

from ..errors import WrongUse
from ..policy.leg import LegSet


def check(**values: Any) -> None:
    """WrongUse for the first value of the wrong kind."""
    for name, value in values.items():
        fits, words = KINDS[name]
        if not fits(value):
            raise WrongUse(f"{name}={reprlib.repr(value)} can't be used; it must be {words}")


def whole(value: Any) -> Optional[int]:
    """None if it is not a whole number."""
    if isinstance(value, (bool, np.bool_)):
        return None
    try:
        return operator.index(value)
    except TypeError:
        return None


def _between(low: int, high: int) -> Callable[[Any], bool]:
    def fits(value: Any) -> bool:
        number = whole(value)
        return number is not None and low <= number <= high
    return fits


def _finite(value: Any, shape: tuple[int, ...] = ()) -> bool:
    try:
        array = np.asarray(value)
    except ValueError:  # rows of several lengths
        return False
    return array.shape == shape and array.dtype.kind in "biuf" and bool(np.isfinite(array).all())


def _text(value: Any) -> bool:
    # Half a surrogate pair, which is not printable, has no UTF-8.
    return isinstance(value, str) and value.isprintable()


def _path(value: Any) -> bool:
    try:
        os.fspath(value).encode()
    except (TypeError, AttributeError, UnicodeEncodeError):
        return value is None
    return True


def _leg_sets(value: Any) -> bool:
    return isinstance(value, Sequence) and all(isinstance(entry, LegSet) for entry in value)


def _weights(value: Any) -> bool:
    return isinstance(value, Mapping) and all(map(_finite, value.values()))


def _history(value: Any) -> bool:
    return isinstance(value, list) and all(
        isinstance(episode, tuple) and [type(part) for part in episode] == [int, bytes, bytes]
        and 0 <= episode[0] < 2**63 for episode in value)


STATE = "what get_env_state() returned"
TEXT = (_text, "text")
TRUTH = (lambda value: isinstance(value, (bool, np.bool_)), "True or False")
PATH = (_path, "a path (text in UTF-8 or a pathlib.Path) or None")
NUMBER = (_finite, "a finite number")
SIDE = (_between(1, 4096), "a whole number (int) from 1 to 4096")  # as the extension's Renderer

# Whether a value is of the kind, and the words for it.
KINDS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "track": TEXT, "profile": TEXT,
    "weights": (_weights, "a dict of finite numbers by the names of reward terms"),
    "extra_observations": TRUTH, "exact": TRUTH, "copy": TRUTH,
    "leg_sets": (lambda value: value is None or _leg_sets(value), "a sequence of myograde.LegSet"),
    "options": (lambda value: value is None or isinstance(value, Mapping), "a dict"),
    "config": PATH, "cache": PATH,
    "num_envs": (_between(1, 2**31 - 1), "a whole number (int), at least 1"),
    "threads": (_between(0, 2**31 - 1), "a whole number (int), at least 0"),
    "max_episode_steps": (lambda value: value is None or _between(1, 2**63 - 1)(value),
                          "a whole number (int), at least 1 and below 2^63, or None"),
    "width": SIDE, "height": SIDE,
    "camera": (lambda value: value is None or isinstance(value, Mapping), "a dict or None"),
    "body": TEXT, "look_at": (lambda value: _finite(value, (3,)), "three finite numbers"),
    "distance": NUMBER, "azimuth": NUMBER, "elevation": NUMBER,
    "settings": (lambda value: isinstance(value, Mapping), STATE), "history": (_history, STATE),
    "last_reward": (lambda value: isinstance(value, float), STATE),
}
