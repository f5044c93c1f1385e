"""Episodes of a candidate, played in a worker process of the search."""

from __future__ import annotations

import dataclasses
import pathlib
from typing import Any

import numpy as np

import controllers
import myograde

CONTROL_STEP = 0.005  # s


@dataclasses.dataclass(frozen=True)
class Result:
    """What came of an episode."""

    score: float
    distance: float  # m
    time: float  # s
    end: str
    start: str  # how the person stood: standing, or with the prosthetic leg behind or ahead


_library: Any = None
_envs: Any = None


def prepare(library: pathlib.Path) -> None:
    """Once in each process."""
    global _library, _envs
    _library = controllers.Library(library)
    _envs = myograde.vec("myograde/Locomotion-v0", 1, threads=1, profile="paper", actions="direct",
                         copy=False)


def play(job: tuple[np.ndarray, int, float]) -> Result:
    """One episode: parameters, seed, and the most seconds that it may take."""
    numbers, seed, seconds = job
    walker = controllers.Walker(_library, numbers)
    observations, _ = _envs.reset(seed=[seed], options={"leg_sets": walker.leg_sets()})
    walker.reset()
    actions = np.zeros((1, walker.action_size))
    hip = observations[0, 6]  # of the prosthetic side, rad
    posture = "standing" if abs(hip) < 0.1 else "behind" if hip < 0 else "ahead"
    furthest = observations[0, 262]
    start = furthest
    effort = 0.0
    end, y = "time", start
    steps = 0
    for steps in range(1, round(seconds / CONTROL_STEP) + 1):
        walker.act(observations[0], actions[0])
        observations, _, terminated, truncated, info = _envs.step(actions)
        effort += info["rewards"]["act_reg"][0]
        y = observations[0, 262]
        furthest = min(furthest, y)
        if terminated[0] or truncated[0]:
            end = str(info["end"][0])
            break
    time, distance = steps * CONTROL_STEP, start - furthest
    score = (distance + start - y) / 2 + 0.2 * time - effort / steps
    return Result(score, distance, time, end, posture)
