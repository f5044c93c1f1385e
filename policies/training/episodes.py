"""Episodes of a candidate, played in a worker process of the search."""

from __future__ import annotations

import argparse
import collections
import ctypes
import dataclasses
import multiprocessing
import pathlib
import signal
from concurrent.futures import ProcessPoolExecutor
from typing import Any, Iterable

import numpy as np

import controllers
import myograde
from myograde.errors import WrongUse

WALKER_STEP = 0.005  # s
REACHER_STEP = 0.01  # s
COURSE = 1  # the kind's code in the walker's observation
PELVIS = slice(41, 45)  # its quaternion there, w first
COURSES = ("flat", "hilly", "rough", "stairs", "mixed")  # by code
# Where the reacher's observation has these (spans).
BOX = slice(129, 132)       # m
GOAL = slice(145, 148)      # m
TOUCHING = slice(148, 153)  # arm, prosthesis, start, goal, environment
REACH = slice(216, 219)     # from the hand to the box, m
RESTING = 1.134             # height of the standing box, m
LIFTED = 0.065              # m above that
BOTH_S = 1.0                # s
JUGGLER_STEP = 0.025  # s
JUGGLER_S = 5.0       # s, that an episode takes
NEAR = 0.02           # m, from its target, that the score of a ball falls by a factor of e
BALLS_MISSING = slice(41, 47)  # from both balls to their targets, m
TAGGER_STEP = 0.01         # s
LEGS_PELVIS = slice(60, 64)  # its quaternion in the tagger's observation, w first
OPPONENT = slice(64, 66)   # m
PLACE = slice(69, 71)      # m
EDGE = 6.0                 # m from the middle, where no opponent comes near
TURNER_S = 1.5          # s, that an episode takes
TURNER_STEP = 0.01      # s
DIE = slice(45, 48)     # its place in the turner's observation, m
DIE_ROTATION = slice(54, 57)  # Euler angles, rad
SUCCESS_STEPS = 6       # with the official flag
CARRIER_STEP = 0.01  # s
CARRIER_S = 1.5      # s, that an episode takes
OBJECT = slice(75, 78)  # m
MISSING = slice(81, 84)  # m, from the object to the goal
ON_TABLE = 0.95  # m, higher than the middle of an object that lies there
IN_HAND = 0.13   # m, from the palm
LATEST_S = 1.2   # s: later the object does not lie in the bin for long enough
OVER_WALL = 0.24  # m, from the goal to where the object clears the bin's wall
PR_SET_PDEATHSIG = 1


@dataclasses.dataclass(frozen=True)
class Result:
    """What came of an episode."""

    score: float
    distance: float  # m: how far the walker got, or the lifted box on its way to the goal, or what
    # the carrier's object missed the place over the bin by (1 at most); of a juggler, the share of
    # solved steps; of a tagger, the official score; of a turner, its success
    time: float  # s
    end: str
    start: str  # how the person stood: standing, or with the prosthetic leg behind or ahead; of a
    # tagger, its task
    tilt: str = ""  # where a walker leans at the end: forwards, backwards, left or right
    course: str = ""  # of the walker, one of COURSES
    lifted: bool = False  # the box or the object, more than LIFTED
    success: bool = False  # as the profile scores it but for the peak force
    given: bool = False  # the prosthesis held the box alone for half a second
    both: bool = False  # each arm touched the box for BOTH_S, which a success in `paper` needs

    def sideways(self) -> bool:
        """Whether a walker fell to a side, or left the track."""
        return self.end == "off-track" or self.end == "fell" and self.tilt in ("left", "right")


_library: Any = None
_envs: Any = None
_controller = "walker"
_profile = ""


def prepare(library: pathlib.Path, controller: str = "walker", profile: str = "",
            config: str = "") -> None:
    """Once in each process, which ends with the one that started it. config: a file of a track to
    play instead of the shipped one's."""
    global _library, _envs, _controller, _profile
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    _library = controllers.Library(library)
    _controller = controller
    _profile = profile or controllers.CONTROLLERS[controller].profile
    _envs = environment(controller, profile, config)


def environment(controller: str, profile: str, config: str) -> Any:
    """One environment, as `prepare` says. WrongUse if profile or config is none."""
    kind = controllers.CONTROLLERS[controller]
    return myograde.vec(f"myograde/{kind.track}-v0", 1, threads=1, actions="direct", copy=False,
                        profile=profile or kind.profile, config=config or None)


def workers(args: argparse.Namespace) -> ProcessPoolExecutor:
    """The processes of a search or an evaluation, as its command line says. SystemExit with the
    reason if they would have nothing to play."""
    try:
        played = environment(args.controller, args.profile, args.config)
    except WrongUse as error:
        raise SystemExit(str(error)) from error
    kind = controllers.CONTROLLERS[args.controller]
    if played.single_action_space.shape != (kind.action_size,):
        raise SystemExit(f"{args.config}: the {args.controller} does not play this track")
    played.close()
    return ProcessPoolExecutor(args.processes, multiprocessing.get_context("spawn"), prepare,
                               (args.library, args.controller, args.profile, args.config))


def counts(words: Iterable[str]) -> dict[str, int]:
    """How often each word comes."""
    return dict(sorted(collections.Counter(words).items()))


def tilt_of(pelvis: np.ndarray) -> str:
    """Where a trunk leans most against its own heading, by the pelvis' quaternion: x is forwards, y
    up and z to the right. In an episode's last step that is the way a fall goes."""
    w, x, y, z = pelvis
    forwards = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z)])
    up = np.array([2 * (x * y - w * z), 1 - 2 * (x * x + z * z)])
    ahead = float(forwards @ up)
    left = float(forwards[0] * up[1] - forwards[1] * up[0])
    if abs(ahead) >= abs(left):
        return "forwards" if ahead > 0 else "backwards"
    return "left" if left > 0 else "right"


def play(job: tuple[Any, int, float]) -> Result:
    """One episode: parameters (of a turner also the path of its file), seed, and the most seconds that
    it may take."""
    return {"walker": walk, "reacher": reach, "carrier": carry,
            "juggler": juggle, "tagger": tag, "turner": turn}[_controller](*job)


def walk(numbers: np.ndarray, seed: int, seconds: float) -> Result:
    """An episode of the walker."""
    walker = controllers.Walker(_library, numbers)
    walker.expect(_profile)
    observations, _ = _envs.reset(seed=[seed], options={"leg_sets": walker.leg_sets()})
    walker.reset()
    actions = np.zeros((1, walker.action_size))
    hip = observations[0, 6]  # of the prosthetic side, rad
    posture = "standing" if abs(hip) < 0.1 else "behind" if hip < 0 else "ahead"
    start = float(observations[0, 262])
    effort = distance = 0.0
    end, y = "time", start
    steps = 0
    for steps in range(1, round(seconds / WALKER_STEP) + 1):
        walker.act(observations[0], actions[0])
        observations, _, terminated, truncated, info = _envs.step(actions)
        effort += info["rewards"]["act_reg"][0]
        y = float(observations[0, 262])
        distance = max(distance, start - y)
        if terminated[0] or truncated[0]:
            end = str(info["end"][0])
            distance = float(info["facts"]["distance"][0])  # as the profile counts it
            break
    time = steps * WALKER_STEP
    score = (distance + start - y) / 2 + 0.2 * time - effort / steps
    return Result(score, distance, time, end, posture, tilt_of(observations[0, PELVIS]),
                  COURSES[round(float(observations[0, COURSE]))])


def reach(numbers: np.ndarray, seed: int, seconds: float) -> Result:
    """An episode of the reacher. The score leads it to the box, up with it, and to the goal."""
    reacher = controllers.Reacher(_library, numbers)
    observations, _ = _envs.reset(seed=[seed])
    reacher.reset()
    actions = np.zeros((1, reacher.action_size))
    both, success, end = False, False, "time"
    nearest, height, first, progress, steps = np.inf, 0.0, np.inf, 0.0, 0
    carried = handed = given = 0  # steps: held by the arm, by both, by the prosthesis alone
    for steps in range(1, round(seconds / REACHER_STEP) + 1):
        reacher.act(observations[0], actions[0])
        observations, _, terminated, truncated, info = _envs.step(actions)
        now = observations[0]
        way = float(np.linalg.norm(now[GOAL][:2] - now[BOX][:2]))
        nearest = min(nearest, float(np.linalg.norm(now[REACH])))
        if steps * REACHER_STEP >= 0.3:  # it falls onto the pillar first
            first = way if np.isinf(first) else first
            height = max(height, now[BOX][2] - RESTING)
            arm, prosthesis, pillar = now[TOUCHING][:3] > 0
            above = now[BOX][2] > RESTING + LIFTED and not pillar
            carried += bool(above and arm and not prosthesis)
            handed += bool(above and arm and prosthesis)
            given += bool(above and prosthesis and not arm)
            if above and (arm or prosthesis):
                progress = max(progress, first - way)
        if terminated[0] or truncated[0]:
            end = str(info["end"][0])
            touched = [info["facts"][f"frames_{limb}"][0] for limb in ("arm", "prosthesis")]
            both = bool(min(touched) * REACHER_STEP >= BOTH_S)
            success = (end == "placed" and both if _profile == "paper"
                       else bool(info["facts"]["solved"][0]))
            break
    stages = sum(min(count * REACHER_STEP, most) / most
                 for count, most in ((carried + handed, 0.5), (handed, 0.5), (given, 0.5)))
    score = (10.0 * success + 3 * stages + 3 * progress + 10 * min(height, 0.1)
             - 3 * min(nearest, 0.4))
    return Result(score, progress, steps * REACHER_STEP, end, "beside",
                  lifted=bool(height > LIFTED), success=success, both=both, given=given > 50)


def carry(numbers: np.ndarray, seed: int, seconds: float) -> Result:
    """An episode of the carrier. The score leads it to the object, up with it, over the bin's wall
    and to the goal."""
    carrier = controllers.Carrier(_library, numbers)
    observations, _ = _envs.reset(seed=[seed])
    carrier.reset()
    actions = np.zeros((1, carrier.action_size))
    end, steps, score, height, way = "time", 0, 0.0, 0.0, 1.0
    for steps in range(1, round(min(seconds, CARRIER_S) / CARRIER_STEP) + 1):
        carrier.act(observations[0], actions[0])
        observations, _, terminated, truncated, info = _envs.step(actions)
        now = observations[0]
        reach = float(info["facts"]["final_reach"][0])
        held = reach < IN_HAND and now[OBJECT][2] > ON_TABLE
        if held:
            height = max(height, now[OBJECT][2] - ON_TABLE)
        score -= 3 * min(reach, 0.2) if steps == 60 else 0
        score += held if steps in (80, 95) else 0
        if 0.6 <= steps * CARRIER_STEP <= LATEST_S:
            missing = now[MISSING]  # over the bin's wall, sideways and up:
            way = min(way, np.hypot(*missing[:2]) + max(0.0, missing[2] + OVER_WALL))
        if terminated[0] or truncated[0]:
            end = str(info["end"][0])
            break
    solved = int(info["facts"]["solved_steps"][0])
    score += (10.0 * (solved >= SUCCESS_STEPS) + min(solved, SUCCESS_STEPS) / SUCCESS_STEPS
              + 3 * np.exp(-way / 0.12)
              + 8 * max(0.0, 0.3 - float(info["facts"]["smallest_position_error"][0])))
    return Result(float(score), way, steps * CARRIER_STEP, end, "falling",
                  lifted=bool(height > LIFTED), success=solved >= SUCCESS_STEPS)


def juggle(numbers: np.ndarray, seed: int, seconds: float) -> Result:
    """An episode of the juggler. The score leads the balls near their targets."""
    juggler = controllers.Juggler(_library, numbers)
    observations, _ = _envs.reset(seed=[seed])
    juggler.reset()
    actions = np.zeros((1, juggler.action_size))
    end, near, steps = "time", 0.0, 0
    most = round(min(seconds, JUGGLER_S) / JUGGLER_STEP)
    for steps in range(1, most + 1):
        juggler.act(observations[0], actions[0])
        observations, _, terminated, truncated, info = _envs.step(actions)
        missing = np.linalg.norm(observations[0, BALLS_MISSING].reshape(2, 3), axis=1)
        near += float(np.mean(np.exp(-missing / NEAR)))
        if terminated[0] or truncated[0]:
            end = str(info["end"][0])
            break
    solved = int(info["facts"]["solved_steps"][0]) / most
    return Result(solved + 0.5 * near / most, solved, steps * JUGGLER_STEP, end, "falling")


def tag(numbers: np.ndarray, seed: int, seconds: float) -> Result:
    """An episode of the tagger. Upright seconds and metres towards the goal lead the search to what
    scores."""
    tagger = controllers.Tagger(_library, numbers)
    observations, _ = _envs.reset(seed=[seed])
    tagger.reset()
    actions = np.zeros((1, tagger.action_size))
    end, score, steps, upright, fallen = "time", 0.0, 0, 0, False
    evades, first, nearest = False, 0.0, np.inf
    for steps in range(1, round(min(seconds, 20) / TAGGER_STEP) + 1):
        tagger.act(observations[0], actions[0])
        observations, _, terminated, truncated, info = _envs.step(actions)
        now = observations[0]
        evades = bool(info["facts"]["evades"][0])
        way = (EDGE - float(np.max(np.abs(now[PLACE]))) if evades else
               float(np.linalg.norm(now[OPPONENT] - now[PLACE])))
        first, nearest = way if steps == 1 else first, min(nearest, way)
        w, x, y, z = now[LEGS_PELVIS]
        fallen = fallen or 2 * (y * z + w * x) < 0.5  # its y axis points up
        upright += not fallen
        if terminated[0] or truncated[0]:
            end = str(info["end"][0])
            score = float(info["rewards"]["sparse"][0])
            break
    led = 0.02 * min(upright * TAGGER_STEP, 10) + 0.05 * (first - max(nearest, 0))
    return Result(score + led, score, steps * TAGGER_STEP, end, "evade" if evades else "chase")


def turn(turns: Any, seed: int, seconds: float) -> Result:
    """An episode of the turner with the turns of a file, or with the only one of these numbers."""
    turner = (controllers.Turner.of_file(_library, turns) if isinstance(turns, pathlib.Path) else
              controllers.Turner(_library, turns))
    path, facts, end = turned(turner, seed, seconds)
    success = float(facts["solved_steps"][0] >= SUCCESS_STEPS)
    return Result(success, success, len(path) * TURNER_STEP, end, "falling")


def path_of(numbers: np.ndarray, seed: int) -> np.ndarray:
    """Where a die was after each step of a turn with these numbers: its place in m, from where it
    starts, and its Euler angles in rad."""
    return turned(controllers.Turner(_library, numbers), seed, TURNER_S)[0]


def turned(turner: controllers.Turner, seed: int, seconds: float) -> tuple[np.ndarray, Any, str]:
    """The path of an episode's die, as above, the episode's facts and its end."""
    observations, _ = _envs.reset(seed=[seed])
    turner.reset()
    actions = np.zeros((1, turner.action_size))
    start, path, end = observations[0, DIE].copy(), [], "time"
    info: Any = {}
    for _ in range(round(min(seconds, TURNER_S) / TURNER_STEP)):
        turner.act(observations[0], actions[0])
        observations, _, terminated, truncated, info = _envs.step(actions)
        now = observations[0]
        path.append(np.concatenate([now[DIE] - start, now[DIE_ROTATION]]))
        if terminated[0] or truncated[0]:
            end = str(info["end"][0])
            break
    return np.array(path), info["facts"], end
