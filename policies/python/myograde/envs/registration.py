"""The names of the environments in Gymnasium's registry."""

from __future__ import annotations

import importlib.util
from typing import Any

from ..errors import MyogradeError

# Name in the registry -> track.
ENVIRONMENTS = {
    "myograde/Manipulation-v0": "manipulation",
    "myograde/Locomotion-v0": "locomotion",
    "myograde/Elbow-v0": "elbow",
    "myograde/Reorientation-v0": "reorientation",
    "myograde/Baoding-v0": "baoding",
    "myograde/Relocation-v0": "relocation",
    "myograde/ChaseTag-v0": "chasetag",
}


def register(required: bool = True) -> None:
    """Registers the environments, unless they are; importing myograde.envs does it, and so does
    importing myograde after Gymnasium. MyogradeError without Gymnasium, if it is `required`."""
    if importlib.util.find_spec("gymnasium") is None:
        if required:
            raise MyogradeError('the package gymnasium is missing; install it with: pip install '
                                '"myograde[gym]"')
        return
    from gymnasium.envs import registration
    for name, track in ENVIRONMENTS.items():
        if name not in registration.registry:
            registration.register(id=name, entry_point="myograde.envs.single:GradedEnv",
                                  vector_entry_point="myograde.envs.vector:GradedVectorEnv",
                                  kwargs={"track": track})


def vec(name: str, num_envs: int, threads: int = 0, **settings: Any) -> Any:
    """A GradedVectorEnv of a name in ENVIRONMENTS: gymnasium.make_vec with C++ threads (0: one for
    each processor). `settings` are its own. MyogradeError without Gymnasium."""
    register()
    import gymnasium
    if hasattr(gymnasium, "VectorizeMode"):
        return gymnasium.make_vec(name, num_envs=num_envs, vectorization_mode="vector_entry_point",
                                  threads=threads, **settings)
    # Gymnasium 0.29 does not hand the registry's arguments on to environments of this kind.
    from .vector import GradedVectorEnv
    spec = gymnasium.spec(name)
    envs = GradedVectorEnv(num_envs=num_envs, threads=threads, **{**spec.kwargs, **settings})
    envs.spec = spec
    return envs
