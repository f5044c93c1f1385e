"""The graded environments for training: the simulator's own, as Gymnasium environments.

    import gymnasium, myograde.envs

    env = gymnasium.make("myograde/Locomotion-v0", profile="paper")
    observation, info = env.reset(seed=20241201)

    envs = myograde.vec("myograde/Elbow-v0", 16, threads=4)  # stepped by C++ threads

An episode with the same seed and actions has the same states as on a server, and, where exact() is
true, to the bit: its "digest" at the end is then that of the server's result.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .extension import Replayed, TrackSeeds, exact, replay, seeds
from .registration import ENVIRONMENTS, register, vec

if TYPE_CHECKING:
    from .single import GradedEnv
    from .vector import GradedVectorEnv

__all__ = ["ENVIRONMENTS", "GradedEnv", "GradedVectorEnv", "Replayed", "TrackSeeds", "exact",
           "register", "replay", "seeds", "vec"]


def __getattr__(name: str) -> Any:
    # Both need Gymnasium, and what is above does not.
    if name == "GradedEnv":
        from .single import GradedEnv
        return GradedEnv
    if name == "GradedVectorEnv":
        from .vector import GradedVectorEnv
        return GradedVectorEnv
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


register(required=False)
