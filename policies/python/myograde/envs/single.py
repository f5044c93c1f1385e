"""One environment."""

from __future__ import annotations

import os
from typing import Any, Mapping, Optional, Sequence

import gymnasium
import numpy as np

from ..errors import WrongUse
from ..policy.leg import LegSet
from . import extension, kinds, settings
from .official import OfficialNames
from .pictures import Pictures


class GradedEnv(OfficialNames, gymnasium.Env[Any, np.ndarray]):
    """An environment of one of the grader's tracks.

    Observations and actions are float64, as a policy receives and sends them. An episode is `terminated`
    when it ends by itself, `truncated` when its time runs out. The reward is the sum of the official
    reward terms times `weights`.

    reset(seed=N) plays the episode that a grader plays for the seed N; without a seed, one drawn from
    the generator that the last seed initialised. In the profile "as-graded" of manipulation one
    environment plays all episodes, as the official evaluation did: there only the first seed counts.

    `info` has of a reset: "seed". Of a step: "rewards" (each term, unweighted) and "facts" (what was
    measured so far, by the keys of a result). Of the last step also "end" (how it ended), "digest",
    "actions_digest" (SHA-256 over states and actions, as in a result), "seed", "steps" and "details"
    (ranges of joints and the like, as in a result; None if no step could be measured).

    Copies, by pickle or copy.deepcopy, continue where this one is, with states equal to the bit: they play the episode
    up to there again, which takes as long as the first time. (In the profile "as-graded" of
    manipulation: all episodes since this environment was made.)
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}
    _spec: Any = None

    def __init__(self, track: str, profile: str = "", observation: str = "flat",
                 actions: str = "normalized", weights: Optional[Mapping[str, float]] = None,
                 extra_observations: bool = False, leg_sets: Sequence[LegSet] = (),
                 config: Optional[str | os.PathLike[str]] = None,
                 cache: Optional[str | os.PathLike[str]] = None, exact: bool = False,
                 render_mode: Optional[str] = None, width: int = 640, height: int = 480,
                 camera: Optional[Mapping[str, Any]] = None) -> None:
        """track: a config's name, such as "elbow".
        profile: its rules profile; "": the config's default.
        observation: "flat", one vector, or "dict", its parts by name.
        actions: "normalized" or "direct", the convention that a policy names when it begins.
        weights: of reward terms, instead of the official ones.
        extra_observations: what the official dictionary has beyond the graded observation follows it
            (profiles "myosuite" and "as-graded").
        leg_sets: parameter sets of the prosthetic leg instead of the grader's.
        config: an organiser's config file, which replaces that of `track`.
        cache: the folder of the models (default: as get-models).
        exact: refuse to run where digests might differ from a server's; see exact().
        render_mode: "rgb_array": render() draws the state. That needs Mesa's OSMesa (Debian:
            libosmesa6) and no display.
        width, height: of a picture, in pixels.
        camera: where it is taken from, in place of the track's own: "body" (which it follows; "":
            none), "look_at" (x, y, z in m, from that body or from the world's origin), "distance"
            (m), "azimuth" and "elevation" (degrees; below 0: looking down).

        WrongUse if there is no such track, profile, word or term, a value is of the wrong type, or the
        config file is wrong; MyogradeError if the models are missing."""
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise WrongUse(f'render_mode="{render_mode}" is unknown; there are: None'
                           + "".join(f", {mode}" for mode in self.metadata["render_modes"]))
        self.settings = settings.Settings(track, profile, observation, actions, weights or {},
                                          extra_observations, leg_sets, config, cache, exact)
        self.core = settings.make_core(extension.load().Environment, settings=self.settings)
        self.render_mode = render_mode
        self._begun = False
        self._picture = (width, height, camera)
        self._pictures = Pictures(self.core, *self._picture)
        self.horizon = self.core.horizon  # control steps of the longest episode
        self.metadata = {**self.metadata, "render_fps": round(1 / self.core.control_period_s)}
        self.layout = settings.layout_of(self.core.observation_parts)
        self.action_layout = settings.layout_of(self.core.action_parts)
        self.observation_space = settings.observation_space(self.layout, observation)
        self.action_space = settings.action_space(self.core)
        self._terms = [name for name, _ in self.core.reward_terms]
        self._weights = settings.weights_of(self.core.reward_terms, self.settings.weights)
        self._leg_sets = settings.leg_set_values(leg_sets)

    def reset(self, *, seed: Optional[int] = None,
              options: Optional[dict[str, Any]] = None) -> tuple[Any, dict[str, Any]]:
        """Begins an episode. options["leg_sets"]: those of this episode, instead of the constructor's. ValueError names
        a number in them that is out of range."""
        kinds.check(options=options)
        if seed is not None:
            seed = settings.check_seed(seed)
        super().reset(seed=seed)
        episode = int(self.np_random.integers(2**63)) if seed is None else seed
        sets = (options or {}).get("leg_sets")
        values = self._leg_sets if sets is None else settings.leg_set_values(sets)
        observation = self.core.reset(episode, *values)
        self._begun = True
        self._last_reward = 0.0
        return self._in_form(observation), {"seed": episode}

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Plays one control step. ValueError if the action has another shape or a number that is not
        finite; entries out of range are treated as the profile says. RuntimeError if no episode is
        being played."""
        observation, terms, terminated, truncated = self.core.step(
            settings.action_array(action, self.action_space.shape))
        info: dict[str, Any] = {"rewards": dict(zip(self._terms, terms.tolist()))}
        if terminated or truncated:
            info.update(self.core.end_of())
        else:
            info["facts"] = self.core.facts()
        reward = self._last_reward = settings.weighted(terms, self._weights)
        return self._in_form(observation), reward, terminated, truncated, info

    def render(self) -> Optional[np.ndarray]:
        """The current state: height x width x 3 uint8, the top row first; None without a
        render_mode. MyogradeError if OSMesa is missing; WrongUse before the first reset(), and for an unknown body."""
        if self.render_mode is None:
            return None
        if not self._begun:
            raise WrongUse("there is nothing to draw before the first reset()")
        return self._pictures.draw()

    def close(self) -> None:
        """Frees the renderer's memory; the rest is freed with the object."""
        self._pictures.close()

    @property
    def spec(self) -> Any:
        """Gymnasium's, with the number of steps of the longest episode; None if the environment was
        made without Gymnasium's registry."""
        return self._spec

    @spec.setter
    def spec(self, value: Any) -> None:
        self._spec = settings.spec_with(value, self.horizon)

    def __getstate__(self) -> dict[str, Any]:
        state = {name: value for name, value in self.__dict__.items()
                 if name not in ("core", "_pictures")}
        state["history"] = settings.history_of(self.core.history)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        state = dict(state)
        history = state.pop("history")
        self.__dict__.update(state)
        self._play(history)

    def _play(self, history: Any) -> None:
        """In a new core: where state carries over, the old one's past can't be undone."""
        core = settings.make_core(extension.load().Environment, settings=self.settings)
        core.restore(history)
        self.core = core
        self._pictures = Pictures(core, *self._picture)

    def _in_form(self, observation: np.ndarray) -> Any:
        return settings.in_form(observation, self.layout, self.settings.observation)
