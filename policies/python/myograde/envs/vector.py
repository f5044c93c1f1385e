"""Many environments, stepped side by side by threads of the extension."""

from __future__ import annotations

import os
from typing import Any, Mapping, Optional, Sequence

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector.utils import batch_space

from ..errors import WrongUse
from ..policy.leg import LegSet
from . import extension, settings

try:
    from gymnasium.vector import AutoresetMode
    NEXT_STEP: Any = AutoresetMode.NEXT_STEP
except ImportError:  # Gymnasium 1.0 behaves so, and has no name for it
    NEXT_STEP = "NextStep"


class GradedVectorEnv(gymnasium.vector.VectorEnv[Any, Any, Any]):
    """`num_envs` environments of one track; the settings are GradedEnv's. Environment i plays what a
    GradedEnv would that is reset with its seed and then, after each episode, without one. The number
    of threads changes the speed and nothing else.

    Where an episode ended, the next step() begins another one and returns its first observation,
    with a reward of 0 and without looking at the action (AutoresetMode.NEXT_STEP).

    `info` has of each step "rewards" (the terms, unweighted: an array of num_envs by name), and for
    the environments whose episode ended in this step, as the masks _end and so on say, "end",
    "digest", "actions_digest", "facts", "seed", "steps" and "details" (an array of GradedEnv's dicts,
    None elsewhere); where an episode began, "seed".
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": NEXT_STEP}

    def __init__(self, track: str, num_envs: int = 1, threads: int = 0, copy: bool = True,
                 profile: str = "", observation: str = "flat", actions: str = "normalized",
                 weights: Optional[Mapping[str, float]] = None, extra_observations: bool = False,
                 leg_sets: Sequence[LegSet] = (),
                 config: Optional[str | os.PathLike[str]] = None,
                 cache: Optional[str | os.PathLike[str]] = None, exact: bool = False,
                 render_mode: Optional[str] = None) -> None:
        """threads: 0: one for each processor that this process may use, at most num_envs.
        copy: False: reset() and step() return the same arrays each time, which the next call
            overwrites.
        The other settings, and what is raised, are GradedEnv's."""
        if render_mode is not None:
            raise WrongUse("many environments at once draw no pictures; make one by "
                           "gymnasium.make(..., render_mode=...) for that")
        if num_envs < 1 or threads < 0:
            raise WrongUse("num_envs must be at least 1, and threads at least 0")
        self.settings = settings.Settings(track, profile, observation, actions, weights or {},
                                          extra_observations, leg_sets, config, cache, exact)
        self.core = settings.make_core(extension.load().VectorEnvironment, num_envs,
                                       threads or _processors(), settings=self.settings)
        self.num_envs = num_envs
        self.threads = self.core.threads
        self.render_mode = None
        self.copy = copy
        first = self.core.first
        self.layout = settings.layout_of(first.observation_parts)
        self.action_layout = settings.layout_of(first.action_parts)
        self.single_observation_space = settings.observation_space(self.layout, observation)
        self.single_action_space = settings.action_space(first)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.core.weights[:] = settings.weights_of(first.reward_terms, self.settings.weights)
        self._terms = [name for name, _ in first.reward_terms]
        self._leg_sets = settings.leg_set_values(leg_sets)
        self._generators: list[Optional[np.random.Generator]] = [None] * num_envs
        # The extension's own arrays, which each step fills.
        self._observations, self._rewards = self.core.observations, self.core.rewards
        self._terminated = self.core.terminated.view(np.bool_)
        self._truncated = self.core.truncated.view(np.bool_)
        self._was_reset = self.core.was_reset.view(np.bool_)
        self._values, self._seeds = self.core.terms, self.core.seeds

    def reset(self, *, seed: Optional[int | Sequence[Optional[int]]] = None,
              options: Optional[dict[str, Any]] = None) -> tuple[Any, dict[str, Any]]:
        """Begins an episode everywhere: environment i with seed + i, or seed[i].
        options["reset_mask"]: only where this array of bool is true; options["leg_sets"] as
        GradedEnv's, from now on."""
        options = options or {}
        mask = self._mask(options.get("reset_mask"))
        seeds: Sequence[Optional[int]]
        if seed is None or isinstance(seed, (int, np.integer)):
            seeds = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise WrongUse(f"{len(seeds)} seeds were given for {self.num_envs} environments")
        for i in np.flatnonzero(mask):
            self._begin(int(i), seeds[i])
        if options.get("leg_sets") is not None:
            self._leg_sets = settings.leg_set_values(options["leg_sets"])
        self.core.reset(*self._leg_sets, mask.view(np.uint8))
        info = {"seed": np.where(mask, self._seeds, 0), "_seed": mask}
        for i in np.flatnonzero(mask):
            self._draw(int(i))
        return self._in_form(), info

    def step(self, actions: np.ndarray) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Plays a control step everywhere. ValueError if an action has another size or a number that
        is not finite; nothing is stepped then. RuntimeError before the first reset."""
        self.core.step(np.asarray(actions, dtype=np.float64))
        values = self._values.copy() if self.copy else self._values
        info: dict[str, Any] = {"rewards": {name: values[:, i]
                                            for i, name in enumerate(self._terms)}}
        self._tell_of_ends(info)
        flags = (self._rewards, self._terminated, self._truncated)
        rewards, terminated, truncated = (
            (array.copy() for array in flags) if self.copy else flags)
        return self._in_form(), rewards, terminated, truncated, info

    def close_extras(self, **kwargs: Any) -> None:
        """Nothing to close: threads and memory go with the object."""

    def _mask(self, given: Any) -> np.ndarray:
        if given is None:
            return np.ones(self.num_envs, dtype=np.bool_)
        mask = np.asarray(given)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise WrongUse(f"reset_mask must be an array of {self.num_envs} bool")
        return mask.copy()

    def _begin(self, i: int, seed: Optional[int]) -> None:
        """The seed of an environment's next episode is `seed`, or the one that was drawn for it."""
        if seed is not None:
            self._seeds[i] = settings.check_seed(seed)
            self._generators[i] = seeding.np_random(int(seed))[0]
        elif self._generators[i] is None:
            self._generators[i] = seeding.np_random(None)[0]
            self._draw(i)

    def _draw(self, i: int) -> None:
        generator = self._generators[i]
        assert generator is not None
        self._seeds[i] = generator.integers(2**63)

    def _tell_of_ends(self, info: dict[str, Any]) -> None:
        began = np.flatnonzero(self._was_reset)
        if began.size:
            info["seed"] = np.where(self._was_reset, self._seeds, 0)
            info["_seed"] = self._was_reset.copy()
            for i in began:
                self._draw(int(i))
        for i in np.flatnonzero(self._terminated | self._truncated):
            end = self.core.end_of(int(i))
            details = end.pop("details")
            info = self._add_info(info, end, int(i))
            # A value of its own for each: their times may be None, of which no array of numbers knows.
            all_details = info.setdefault("details", np.full(self.num_envs, None))
            all_details[i] = details
            info["_details"] = info["_digest"]

    def _in_form(self) -> Any:
        array = self._observations.copy() if self.copy else self._observations
        return settings.in_form(array, self.layout, self.settings.observation)


def _processors() -> int:
    return len(os.sched_getaffinity(0))
