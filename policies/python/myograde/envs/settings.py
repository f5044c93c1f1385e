"""What the environments have in common, whether one is stepped or many: their settings, spaces and
values."""

from __future__ import annotations

import copy
import dataclasses
import functools
import os
import reprlib
from typing import Any, Mapping, Optional, Sequence

import gymnasium
import numpy as np

from ..errors import MyogradeError, WrongUse
from ..policy.layout import Layout, Part
from ..policy.leg import QUANTITIES, STATES, LegSet
from . import extension, kinds

LEG_SETS = 5


@dataclasses.dataclass(frozen=True)
class Settings:
    """The arguments of GradedEnv and GradedVectorEnv; GradedEnv explains them."""

    track: str
    profile: str = ""
    observation: str = "flat"
    actions: str = "normalized"
    weights: Mapping[str, float] = dataclasses.field(default_factory=dict)
    extra_observations: bool = False
    leg_sets: Sequence[LegSet] = ()
    config: Optional[os.PathLike[str] | str] = None
    cache: Optional[os.PathLike[str] | str] = None
    exact: bool = False

    def __post_init__(self) -> None:
        """WrongUse for a value of the wrong type."""
        kinds.check(**{name: value for name, value in vars(self).items() if name in kinds.KINDS})
        # A copy in another process may be made in another folder.
        for name in ("config", "cache"):
            object.__setattr__(self, name, extension.path_or_none(getattr(self, name)) or None)

    def check(self) -> None:
        """WrongUse for an unknown word, and for `exact` where this process can't be exact."""
        for name, value, known in (("observation", self.observation, ("flat", "dict")),
                                   ("actions", self.actions, ("normalized", "direct"))):
            if value not in known:
                raise WrongUse(f'{name}="{value}" is unknown; there are: {", ".join(known)}')
        if self.exact:
            extension.require_exact()

    @functools.cached_property
    def identity(self) -> dict[str, Any]:
        """What environments that can play each other's states have in common. WrongUse as seeds()."""
        config = extension.seeds(self.track, self.profile, self.config)
        return {"track": self.track, "profile": config.profile, "config_hash": config.config_hash,
                "actions": self.actions, "extra_observations": bool(self.extra_observations),
                "leg_sets": tuple(self.leg_sets or ())}

    def require_same(self, identity: Mapping[str, Any]) -> None:
        """WrongUse if a state is of an environment with another identity."""
        for name, own in self.identity.items():
            theirs = identity.get(name)
            if theirs != own:
                raise WrongUse(f"the state is one of another kind of environment: its {name} is "
                               f"{reprlib.repr(theirs)}, and here it is {reprlib.repr(own)}; set it in "
                               "an environment that was made with the same arguments")

    def arguments(self) -> dict[str, Any]:
        """Of the extension's classes."""
        return {"tracks_dir": extension.tracks_folder(), "track": self.track,
                "profile": self.profile, "config_file": extension.path_or_none(self.config),
                "cache_dir": extension.provide_models(self.cache),
                "direct": self.actions == "direct",
                "extra_observations": bool(self.extra_observations)}


def make_core(kind: Any, *counts: int, settings: Settings, **arguments: Any) -> Any:
    """An object of one of the extension's classes. WrongUse or MyogradeError."""
    settings.check()
    try:
        return kind(*counts, **settings.arguments(), **arguments)
    except MyogradeError:
        raise
    except (ValueError, FileNotFoundError) as error:
        raise WrongUse(str(error)) from error
    except RuntimeError as error:
        raise MyogradeError(str(error)) from error


def check_seed(seed: Any) -> int:
    """TypeError if it is not a whole number, WrongUse if it can't be an episode's."""
    number = kinds.whole(seed)
    if number is None:
        raise TypeError(f"the seed {seed!r} is of type {type(seed).__name__}; seeds are whole numbers "
                        "(int) from 0 to 2^63 - 1")
    if not 0 <= number < 2**63:
        raise WrongUse(f"the seed {number} is out of range; seeds are whole numbers from 0 to 2^63 - 1")
    return number


def action_array(action: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Actions as the extension takes them. WrongUse if they are not numbers, or of another shape."""
    try:
        array = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise WrongUse(f"the action must be an array of numbers of shape {shape}: {error}") from error
    if array.shape != shape:
        raise WrongUse(f"the action must have the shape {shape}, but has {array.shape}")
    return array


def spec_with(spec: Any, horizon: int) -> Any:
    """A spec of Gymnasium's registry that knows how long an episode can be: a track's profile says so."""
    if spec is None:
        return None
    spec = copy.copy(spec)
    limit = spec.max_episode_steps
    spec.max_episode_steps = min(limit, horizon) if limit is not None and limit > 0 else horizon
    return spec


def history_of(ask: Any) -> Any:
    """What an environment's copies play. MyogradeError if it is too long to be kept."""
    try:
        return ask()
    except RuntimeError as error:
        raise MyogradeError(str(error)) from error


def layout_of(parts: Sequence[Mapping[str, Any]]) -> Layout:
    """Of what the extension says about a vector."""
    return Layout([Part(**part) for part in parts])


def observation_space(layout: Layout, form: str) -> gymnasium.Space[Any]:
    """Unbounded, as joints and forces may leave their ordinary ranges."""
    if form == "flat":
        return _unbounded(layout.size)
    return gymnasium.spaces.Dict({part.name: _unbounded(part.size) for part in layout.values()})


def action_space(core: Any) -> gymnasium.spaces.Box:
    """Of the convention of a _env.Environment."""
    low, high = core.action_bounds
    return gymnasium.spaces.Box(np.array(low), np.array(high), dtype=np.float64)


def in_form(observation: Any, layout: Layout, form: str) -> Any:
    """One observation, or a row for each of many."""
    if form == "flat":
        return observation
    return {part.name: observation[..., part.offset:part.offset + part.size]
            for part in layout.values()}


def weights_of(terms: Sequence[tuple[str, float]], given: Mapping[str, float]) -> np.ndarray:
    """The weight of each reward term: the official one, or the given. WrongUse for a term that the
    track does not have."""
    known = dict(terms)
    for name in given:
        if name not in known:
            raise WrongUse(f'the track has no reward term "{name}"; there are: {", ".join(known)}')
    return np.array([float(given.get(name, weight)) for name, weight in terms])


def leg_set_values(sets: Sequence[LegSet]) -> tuple[int, Optional[np.ndarray]]:
    """Parameter sets as the extension takes them: which are present, and their numbers. WrongUse if they are not
    parameter sets."""
    kinds.check(leg_sets=sets)
    if not sets:
        return 0, None
    present = 0
    values = np.zeros((LEG_SETS, len(STATES), 6 + 2 * len(QUANTITIES)))
    for leg_set in sets:
        if not 0 <= leg_set.index < LEG_SETS:
            raise WrongUse(f"a leg set has the index {leg_set.index}; it must be 0 to "
                           f"{LEG_SETS - 1}")
        present |= 1 << leg_set.index
        for number, name in enumerate(STATES):
            values[leg_set.index, number] = _state_values(getattr(leg_set, name))
    return present, values


def _state_values(state: Any) -> list[float]:
    row = [value for joint in (state.knee, state.ankle)
           for value in (joint.stiffness, joint.damping, joint.target)]
    values, kinds = [0.0] * len(QUANTITIES), [0.0] * len(QUANTITIES)
    for until in state.until:
        place = QUANTITIES.index(until.quantity)
        values[place], kinds[place] = until.value, 1.0 if until.above else 2.0
    return [*row, *values, *kinds]


def _unbounded(size: int) -> gymnasium.spaces.Box:
    return gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float64)


def weighted(terms: np.ndarray, weights: np.ndarray) -> float:
    """The reward, added up from the first term to the last, as the vector environment does."""
    total = 0.0
    for value, weight in zip(terms.tolist(), weights.tolist()):
        if weight != 0:
            total += weight * value
    return total
