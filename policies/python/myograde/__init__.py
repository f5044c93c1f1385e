"""MyoGrade for participants: the kit for policies and the message types that it speaks.

    import myograde

    class Still(myograde.Policy):
        def act(self, observation):
            return [-1.0] * self.welcome.action_size

    if __name__ == "__main__":
        myograde.serve(Still())

`myograde.client` submits policies and reads results, and `myograde.envs` has the graded environments
for training; neither is part of what `python -m myograde bundle` puts into a submission. The message types (`myograde.action_t` and the others of
protocol/policy/myograde.lcm) are classes that lcm-gen made.
"""

import importlib.util as _importing
import sys as _sys

from .messages import *  # noqa: F403  (generated; each type refers to the others by myograde.NAME)
from .policy import Episode, Joint, Layout, LegSet, LegState, Part, Policy, Threshold, Track
from .policy import leg_sets, serve, track

__version__ = "1.0.0"

__all__ = ["Episode", "Joint", "Layout", "LegSet", "LegState", "Part", "Policy", "Threshold",
           "Track", "leg_sets", "serve", "track"]


def __getattr__(name: str):  # type: ignore[no-untyped-def]
    # Imported when it is asked for: a submission's kit has no environments.
    if name == "vec":
        from .envs import vec
        return vec
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


# So that gymnasium.make knows them after `import gymnasium, myograde`. Gymnasium takes a second to
# import, which a policy that does without it should not wait for.
if "gymnasium" in _sys.modules and _importing.find_spec(f"{__name__}.envs") is not None:
    from . import envs as _envs  # noqa: F401
