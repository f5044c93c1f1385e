"""Many environments for Stable-Baselines3: C++ threads instead of a process for each.

    from myograde.envs.sb3 import StableVecEnv

    model = PPO("MlpPolicy", StableVecEnv("myograde/Elbow-v0", 16))
"""

from __future__ import annotations

import time
from typing import Any, Iterable, Optional

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from ..errors import WrongUse
from .registration import vec
from .vector import GradedVectorEnv


class StableVecEnv(VecEnv):
    """A VecEnv of myograde.vec(name, num_envs, threads, **settings). An episode's last info has what
    GradedVectorEnv says of its end, and "episode", "terminal_observation" and "TimeLimit.truncated", as
    Stable-Baselines3 expects them."""

    def __init__(self, name: str, num_envs: int, threads: int = 0, **settings: Any) -> None:
        """MyogradeError and WrongUse as GradedVectorEnv's."""
        if "autoreset_mode" in settings:
            raise WrongUse("Stable-Baselines3 begins an episode in the step that ends the one before; leave "
                           "autoreset_mode out")
        self.envs: GradedVectorEnv = vec(name, num_envs, threads, autoreset_mode="same_step",
                                         **settings).unwrapped
        self._actions: Any = None
        self._began_s = time.monotonic()
        self._returns, self._lengths = np.zeros(num_envs), np.zeros(num_envs, dtype=np.int64)
        super().__init__(num_envs, self.envs.single_observation_space, self.envs.single_action_space)

    def reset(self) -> Any:
        """The first observations, of the seeds that seed() set."""
        # seed(None) draws seeds of 32 bits; before seed() there are none.
        seeds = self._seeds if any(seed is not None for seed in self._seeds) else None
        observations, info = self.envs.reset(seed=seeds)
        self._reset_seeds()
        self._reset_options()
        self._returns[:], self._lengths[:] = 0, 0
        self.reset_infos = [{"seed": int(seed)} for seed in info["seed"]]
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self) -> Any:
        observations, rewards, terminated, truncated, info = self.envs.step(self._actions)
        done = terminated | truncated
        self._returns += rewards
        self._lengths += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(done):
            infos[i] = {name: _entry(values, i) for name, values in info["final_info"].items()
                        if not name.startswith("_")}
            infos[i].update({
                "terminal_observation": info["final_obs"][i],
                "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                "episode": {"r": float(self._returns[i]), "l": int(self._lengths[i]),
                            "t": round(time.monotonic() - self._began_s, 6)}})
            self._returns[i], self._lengths[i] = 0, 0
        return observations, rewards.astype(np.float32), done, infos

    def close(self) -> None:
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The same for all: they share their settings."""
        return [getattr(self.envs, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise WrongUse("the environments of a StableVecEnv have one set of attributes, which can't be set")

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None,
                   **method_kwargs: Any) -> list[Any]:
        raise WrongUse("the environments of a StableVecEnv have no methods of their own")

    def env_is_wrapped(self, wrapper_class: Any, indices: Optional[Iterable[int]] = None) -> list[bool]:
        return [False for _ in self._get_indices(indices)]


def _entry(values: Any, i: int) -> Any:
    """Environment i's of what is an array, or arrays by name."""
    if isinstance(values, dict):
        return {name: _entry(inner, i) for name, inner in values.items() if not name.startswith("_")}
    value = values[i]
    return value.item() if isinstance(value, np.generic) else value
