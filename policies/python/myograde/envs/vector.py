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
from . import extension, kinds, settings

try:
    from gymnasium.experimental.vector import VectorEnv  # of Gymnasium 0.29
except ImportError:
    from gymnasium.vector import VectorEnv
# What happens where an episode ended, by the values of Gymnasium's AutoresetMode (1.1 and newer).
NEXT_STEP, SAME_STEP, DISABLED = "NextStep", "SameStep", "Disabled"
# Views of the extension's arrays.
VIEWS = ("_observations", "_rewards", "_terminated", "_truncated", "_was_reset", "_values", "_seeds")


def _mode_of(given: Any) -> Any:
    """The mode as in the metadata: Gymnasium's own value, if it has one. WrongUse for an unknown mode."""
    word = str(getattr(given, "value", given)).replace("_", "").lower()
    for mode in (NEXT_STEP, SAME_STEP, DISABLED):
        if word == mode.lower():
            known = getattr(gymnasium.vector, "AutoresetMode", None)
            return mode if known is None else known(mode)
    raise WrongUse(f'autoreset_mode="{given}" is unknown; there are: next_step, same_step, disabled')


class GradedVectorEnv(VectorEnv):  # type: ignore[type-arg,misc]
    """`num_envs` environments of one track; the settings are GradedEnv's. Environment i plays the episodes of a
    GradedEnv that is reset with its seed and then, after each episode, without one. The number
    of threads changes the speed and nothing else.

    Where an episode ended, `autoreset_mode` says what begins another one:
    "next_step": the next step(), which returns its first observation, with a reward of 0, and ignores the action;
    "same_step": the step that ended it, which returns the first observation of the new episode, and in
        info["final_obs"] and info["final_info"] the old one's last;
    "disabled": only reset(options={"reset_mask": ...}).

    `info` has of each step "rewards" (the terms, unweighted) and "facts" (what was measured so far),
    arrays of num_envs by name; for the environments whose episode ended in this step, as the masks _end
    and so on say, "end", "digest", "actions_digest", "seed", "steps" and "details" (an array of
    GradedEnv's dicts, None elsewhere), which "same_step" has in info["final_info"]; and where an episode
    began, "seed".

    Copies, by pickle or copy.deepcopy, are as GradedEnv's.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": _mode_of(NEXT_STEP)}
    _spec: Any = None

    def __init__(self, track: str, num_envs: int = 1, threads: int = 0, copy: bool = True,
                 profile: str = "", observation: str = "flat", actions: str = "normalized",
                 weights: Optional[Mapping[str, float]] = None, extra_observations: bool = False,
                 leg_sets: Sequence[LegSet] = (),
                 config: Optional[str | os.PathLike[str]] = None,
                 cache: Optional[str | os.PathLike[str]] = None, exact: bool = False,
                 render_mode: Optional[str] = None, max_episode_steps: Optional[int] = None,
                 autoreset_mode: Any = "next_step") -> None:
        """threads: 0: one for each processor that this process may use, at most num_envs.
        copy: False: reset() and step() return the same arrays each time, which the next call
            overwrites.
        max_episode_steps: truncates longer episodes; None: only the profile's own time does.
        autoreset_mode: above; also a value of Gymnasium's AutoresetMode.
        The other settings, and what is raised, are GradedEnv's."""
        if render_mode is not None:
            raise WrongUse("many environments at once draw no pictures; create one with gymnasium.make(..., "
                           "render_mode=...) for that")
        kinds.check(num_envs=num_envs, threads=threads, copy=copy,
                    max_episode_steps=max_episode_steps)
        self.settings = settings.Settings(track, profile, observation, actions, weights or {},
                                          extra_observations, leg_sets, config, cache, exact)
        self.num_envs = num_envs
        self._limit = max_episode_steps or 0
        self._threads = threads or _processors()
        self._make_core()
        self.threads = self.core.threads
        self.autoreset_mode = _mode_of(autoreset_mode)  # where other libraries look for it
        self._mode = str(getattr(self.autoreset_mode, "value", self.autoreset_mode))
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.render_mode = None
        self.copy = copy
        first = self.core.first
        # Control steps of the longest episode.
        self.horizon = min(self._limit or first.horizon, first.horizon)
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

    def _make_core(self) -> None:
        self.core = settings.make_core(extension.load().VectorEnvironment, self.num_envs,
                                       self._threads, settings=self.settings, max_steps=self._limit)
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
        kinds.check(options=options)
        options = options or {}
        mask = self._mask(options.get("reset_mask"))
        seeds = self._seeds_of(seed)
        first = next((one for one in seeds if one is not None), None)
        if first is not None:
            self._np_random, self._np_random_seed = seeding.np_random(first)
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
        """Plays a control step everywhere. ValueError if an action has another shape or a number that
        is not finite; nothing is stepped then. RuntimeError before the first reset, and where an episode
        ended and autoreset is disabled."""
        if self._mode == DISABLED and (self._terminated | self._truncated).any():
            raise RuntimeError('episodes have ended, and autoreset is disabled; call reset(options={'
                               '"reset_mask": terminated | truncated}) first')
        self.core.step(settings.action_array(actions, self.action_space.shape))
        ended = self._terminated | self._truncated
        values = self._values.copy() if self.copy or self._mode == SAME_STEP else self._values
        info: dict[str, Any] = {"rewards": {name: values[:, i]
                                            for i, name in enumerate(self._terms)},
                                "facts": self.core.facts()}
        if self._mode == SAME_STEP:
            if ended.any():
                self._begin_in_the_same_step(ended, info)
        else:
            self._tell_of_beginnings(info, self._was_reset)
            self._tell_of_ends(info, ended)
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
            self._seeds[i] = seed
            self._generators[i] = seeding.np_random(seed)[0]
        elif self._generators[i] is None:
            self._generators[i] = seeding.np_random(None)[0]
            self._draw(i)

    def _draw(self, i: int) -> None:
        generator = self._generators[i]
        assert generator is not None
        self._seeds[i] = generator.integers(2**63)

    def _seeds_of(self, given: Any) -> list[Optional[int]]:
        """A seed for each environment. TypeError or WrongUse if one is not valid."""
        if given is None:
            return [None] * self.num_envs
        if isinstance(given, (str, bytes)) or not np.iterable(given):
            first = settings.check_seed(given)
            return [settings.check_seed(first + i) for i in range(self.num_envs)]
        seeds = [None if seed is None else settings.check_seed(seed) for seed in given]
        if len(seeds) != self.num_envs:
            raise WrongUse(f"{len(seeds)} seeds were given for {self.num_envs} environments")
        return seeds

    def _tell_of_beginnings(self, info: dict[str, Any], began: np.ndarray) -> None:
        if not began.any():
            return
        info["seed"] = np.where(began, self._seeds, 0)
        info["_seed"] = began.copy()
        for i in np.flatnonzero(began):
            self._draw(int(i))

    def _tell_of_ends(self, info: dict[str, Any], ended: np.ndarray) -> None:
        for i in np.flatnonzero(ended):
            end = self.core.end_of(int(i))
            del end["facts"]  # are there, of all
            details = end.pop("details")
            self._add_info(info, end, int(i))
            # A value of its own for each: their times may be None, of which no array of numbers knows.
            all_details = info.setdefault("details", np.full(self.num_envs, None))
            all_details[i] = details
            info["_details"] = info["_digest"]

    def _begin_in_the_same_step(self, ended: np.ndarray, info: dict[str, Any]) -> None:
        final = {part: dict(values) for part, values in info.items()}
        self._tell_of_ends(final, ended)
        info["final_info"], info["_final_info"] = final, ended
        info["final_obs"], info["_final_obs"] = np.full(self.num_envs, None), ended
        last = settings.in_form(self._observations.copy(), self.layout, self.settings.observation)
        for i in np.flatnonzero(ended):
            info["final_obs"][i] = (last[i] if isinstance(last, np.ndarray) else
                                    {part: rows[i] for part, rows in last.items()})
        flags = (self._rewards, self._terminated, self._truncated)
        kept = [array.copy() for array in flags]
        self.core.reset(*self._leg_sets, ended.view(np.uint8))
        for array, values in zip(flags, kept):
            array[:] = values
        self._tell_of_beginnings(info, ended)

    @property
    def spec(self) -> Any:
        """Gymnasium's, with the number of steps of the longest episode."""
        return self._spec

    @spec.setter
    def spec(self, value: Any) -> None:
        self._spec = settings.spec_with(value, self.horizon)

    def __getstate__(self) -> dict[str, Any]:
        state = {name: value.copy() if name in VIEWS else value
                 for name, value in self.__dict__.items() if name != "core"}
        state["histories"] = settings.history_of(self.core.histories)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        state = dict(state)
        histories, views = state.pop("histories"), {name: state.pop(name) for name in VIEWS}
        self.__dict__.update(state)
        self._make_core()
        self.core.weights[:] = settings.weights_of(self.core.first.reward_terms, self.settings.weights)
        self.core.restore(*self._leg_sets, histories)
        for name, values in views.items():
            getattr(self, name)[:] = values

    def _in_form(self) -> Any:
        array = self._observations.copy() if self.copy else self._observations
        return settings.in_form(array, self.layout, self.settings.observation)


def _processors() -> int:
    return len(os.sched_getaffinity(0))
