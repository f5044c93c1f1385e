"""Episodes of a candidate, played in a worker process of the search."""

from __future__ import annotations

import ctypes
import dataclasses
import pathlib
import signal
from typing import Any

import numpy as np

import controllers
import myograde

CONTROL_STEP = 0.005  # s
PELVIS = slice(41, 45)  # its quaternion in the observation, w first
PR_SET_PDEATHSIG = 1


@dataclasses.dataclass(frozen=True)
class Result:
    """What came of an episode."""

    score: float
    distance: float  # m
    time: float  # s
    end: str
    start: str  # how the person stood: standing, or with the prosthetic leg behind or ahead
    tilt: str  # where the trunk leans at the end: forwards, backwards, left or right


_library: Any = None
_envs: Any = None


def prepare(library: pathlib.Path) -> None:
    """Once in each process, which ends with the one that started it."""
    global _library, _envs
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    _library = controllers.Library(library)
    _envs = myograde.vec("myograde/Locomotion-v0", 1, threads=1, profile="paper", actions="direct",
                         copy=False)


def tilt_of(pelvis: np.ndarray) -> str:
    """Where a trunk leans most, by the pelvis' quaternion: x is forwards, y up and z to the right."""
    w, x, y, z = pelvis
    forwards = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z)])
    up = np.array([2 * (x * y - w * z), 1 - 2 * (x * x + z * z)])
    ahead = float(forwards @ up)
    left = float(forwards[0] * up[1] - forwards[1] * up[0])
    if abs(ahead) >= abs(left):
        return "forwards" if ahead > 0 else "backwards"
    return "left" if left > 0 else "right"


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
    return Result(score, distance, time, end, posture, tilt_of(observations[0, PELVIS]))
