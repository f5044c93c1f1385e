"""The names of the official environments (MyoSuite) that GradedEnv also has, and replacements for the others.
`policies/MYOSUITE.md` compares both."""

from __future__ import annotations

from typing import Any, Mapping

import numpy as np

from ..errors import WrongUse
from . import kinds, settings

# What to use instead of an official name, for an AttributeError.
ELSEWHERE = {
    "seed": "reset(seed=N) sets the seed",
    "sim": "the simulation can't be changed; get_env_state() has time, qpos, qvel and act",
    "sim_obsd": "observations are exact, as sim would have them; get_env_state() has the state",
    "mj_model": "the model is in the folder of get-models; spec and layout describe its vectors",
    "mj_data": "get_env_state() has time, qpos, qvel and act",
    "physics": "get_env_state() has time, qpos, qvel and act",
    "init_qpos": "get_env_state() after reset() has the start of an episode",
    "init_qvel": "get_env_state() after reset() has the start of an episode",
    "set_state": "set_env_state() takes what get_env_state() returned; a seed determines how episodes begin",
    "get_reward_dict": "rwd_dict has the terms of the last step, and step() returns them in info",
    "get_metrics": "info[\"facts\"] has what results are made of",
    "evaluate_success": "info[\"facts\"] of the last step has \"solved\"",
    "examine_policy": "myograde local plays a policy; its --logs can be replayed and rendered",
    "mj_render": "render() with render_mode=\"rgb_array\" draws a picture",
    "viewer_setup": "the argument camera says where a picture is taken from",
    "renderer": "render() with render_mode=\"rgb_array\" draws a picture",
    "frame_skip": "dt is the time of a control step in s",
    "muscle_condition": "muscles are those of the challenge; there are no other conditions",
    "normalize_act": "the argument actions is \"normalized\" or \"direct\"",
    "visual_dict": "there are no images in observations; render() draws a picture",
    "proprio_dict": "obs_dict has all parts of an observation",
    "get_proprioception": "obs_dict has all parts of an observation",
    "get_exteroception": "obs_dict has all parts of an observation",
    "get_visuals": "there are no images in observations; render() draws a picture",
}
# Official names without a replacement.
WITHOUT = frozenset("""
    add_obsvec_to_cache compute_path_rewards device_id examine_policy_new expand_dims fatigue_reset_random
    fatigue_reset_vec forward get_env_infos get_obs_vec get_obsvec_from_cache get_target_pose id initialize
    initialized initializeConditions input_seed key_idx last_ctrl mujoco_render_frames obsdict2obsvec
    obsvec2obsdict obsvec_cache_flush ordered_obs_keys proprio_keys reset_type robot rwd_mode rwd_viz
    set_fatigue_reset_random squeeze_dims target_type tip_sids truncate_paths update_target visual_keys
""".split())


class OfficialNames:
    """A base class of GradedEnv, which has the attributes used here."""

    core: Any
    settings: Any
    layout: Any
    horizon: int
    _terms: list[str]
    _weights: np.ndarray
    _begun: bool
    _last_reward: float = 0.0

    @property
    def dt(self) -> float:
        """The time of a control step, in s."""
        return float(self.core.control_period_s)

    @property
    def time(self) -> float:
        """Of the episode, in s."""
        return float(self.core.physics()["time"][0]) if self._begun else 0.0

    @property
    def obs_keys(self) -> list[str]:
        """The names of the parts of an observation, in their order."""
        return list(self.layout)

    @property
    def obs_dict(self) -> dict[str, np.ndarray]:
        """The current observation by its parts, and "time". WrongUse before the first reset()."""
        self._require_episode()
        return {"time": np.array([self.time]), **self.layout.split(self.core.observe())}

    def get_obs_dict(self, sim: Any = None) -> dict[str, np.ndarray]:
        """obs_dict."""
        return self.obs_dict

    def get_obs(self) -> Any:
        """The current observation, as step() returned it. WrongUse before the first reset()."""
        self._require_episode()
        return self._in_form(self.core.observe())  # type: ignore[attr-defined]

    @property
    def rwd_keys_wt(self) -> dict[str, float]:
        """The weight of each term of the reward, without those that are only reported."""
        return {name: weight for name, weight in zip(self._terms, self._weights.tolist()) if weight}

    @property
    def rwd_dict(self) -> dict[str, float]:
        """The terms of the reward of the last step, and "dense", their weighted sum. WrongUse before
        the first reset()."""
        self._require_episode()
        return {**dict(zip(self._terms, self.core.reward_values().tolist())),
                "dense": self._last_reward}

    def get_input_seed(self) -> int:
        """The seed of the current episode."""
        self._require_episode()
        return int(self.core.seed)

    def get_env_state(self) -> dict[str, Any]:
        """time, qpos, qvel and act for information, and what set_env_state() continues from."""
        self._require_episode()
        return {**self.core.physics(), "history": settings.history_of(self.core.history),
                "last_reward": self._last_reward, "settings": dict(self.settings.identity)}

    def set_env_state(self, state: Mapping[str, Any]) -> None:
        """Continues from a state of get_env_state(), of this environment or of one with the same arguments, by playing
        its episode up to there again. WrongUse for any other."""
        needed = ("settings", "history", "last_reward")
        if not isinstance(state, Mapping) or any(name not in state for name in needed):
            raise WrongUse("set_env_state takes what get_env_state returned; a state can't be made from only qpos and "
                           "qvel, because a seed determines how episodes begin")
        kinds.check(**{name: state[name] for name in needed})
        self.settings.require_same(state["settings"])
        try:
            self._play(state["history"])
        except (ValueError, RuntimeError) as error:
            raise WrongUse(f"the state can't be restored: {error}") from error
        self._begun = True
        self._last_reward = state["last_reward"]

    def __getattr__(self, name: str) -> Any:
        if name in ELSEWHERE:
            raise AttributeError(f"{type(self).__name__} has no {name}, which the official environments "
                                 f"have: {ELSEWHERE[name]}")
        if name in WITHOUT:
            raise AttributeError(f"{type(self).__name__} has no {name}, which the official environments "
                                 "have; policies/MYOSUITE.md compares the names of both")
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def _require_episode(self) -> None:
        if not self._begun:
            raise WrongUse("there is no episode before the first reset()")

    def _play(self, history: Any) -> None:
        raise NotImplementedError
