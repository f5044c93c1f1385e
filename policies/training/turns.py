"""Searches for turns of a die, and chooses those that the baseline of reorientation plays.

    PYTHONPATH=build/release/python VENV/bin/python policies/training/turns.py FOLDER \\
        --library build/release/training/libbaseline_controllers.so [--seconds N]
        [--write FILE --command TEXT]

A turn is a few postures, one after the other (policies/baseline/turner.h). Each trial plays one
with a die of its own, and counts the goals, drawn as the track draws them, that the die would have
reached, whatever goal its episode has. The next turns are changes of earlier ones, rather of those
that reach what few others do. FOLDER/trials.npz keeps all trials; a later call goes on from them.

--write then plays the best turns with more dice, keeps those that reach the most goals together
(as a file of policies/baseline/parameters) and says where each took how many of the dice.
"""

from __future__ import annotations

import argparse
import heapq
import json
import pathlib
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

import controllers
import episodes

FIRST_SEED = 1_000_000_000  # of the search; above the graded seeds
CHOICE_SEED = 3_000_000_000  # of the dice that turns are chosen by
GOALS = 20_000
RANGE = 3.14  # rad, of each of a goal's Euler angles
SHIFT = 0.02  # m, likewise of its place
TURN, PLACE = 0.262, 0.025  # rad and m: the track's tolerances
STEPS = episodes.SUCCESS_STEPS
SURE_STEPS = 8  # that a turn needs to be tried again; with fewer, the next die may miss
BEGINS = 3  # numbers of a turn before its postures'
ROUNDS = ((1, 2), (0.6, 2), (0.4, 4))  # share of turns that are left, and further dice for each
KEPT = 0.3  # of the turns
NEARLY = 0.02  # what a step that is not much farther away counts, in dice
OUTCOMES = 400  # poses that are kept, of all turns together
OUTCOME_GOALS = 6000
WIDTH, PLACE_WIDTH = 0.2, 0.015  # rad and m, as in turner.cc


def canonical(angles: np.ndarray) -> np.ndarray:
    """Euler angles as rotations have them: the second within a quarter turn."""
    flipped = np.cos(angles[:, 1]) < 0
    other = np.stack([angles[:, 0] + np.pi, np.pi - angles[:, 1], angles[:, 2] + np.pi], axis=1)
    wrapped = np.arctan2(np.sin(other), np.cos(other))
    return np.where(flipped[:, None], wrapped, angles)


class Goals:
    """Goals that trials are judged by: rotations (Euler angles in rad) and places (m, from where
    dice start), sorted by the first angle."""

    def __init__(self, count: int = GOALS) -> None:
        rng = np.random.default_rng(0)
        rotations = canonical(rng.uniform(-RANGE, RANGE, (count, 3)))
        self.rotations = rotations[np.argsort(rotations[:, 0])]
        self.places = rng.uniform(-SHIFT, SHIFT, (count, 3))

    def steps(self, path: np.ndarray, turn: float = TURN, place: float = PLACE) -> np.ndarray:
        """For each goal the steps of `path` (poses: place and rotation) that are within these
        distances of it, in rad and m."""
        counts = np.zeros(len(self.places), dtype=np.int16)
        path = path[np.linalg.norm(path[:, :3], axis=1) < place + SHIFT * 3 ** 0.5]
        low = np.searchsorted(self.rotations[:, 0], path[:, 3] - turn)
        high = np.searchsorted(self.rotations[:, 0], path[:, 3] + turn)
        for pose, first, last in zip(path, low, high):
            near = slice(first, last)
            counts[near] += ((np.sum((self.rotations[near] - pose[3:]) ** 2, axis=1) < turn ** 2) &
                             (np.sum((self.places[near] - pose[:3]) ** 2, axis=1) < place ** 2))
        return counts


class Search:
    """All trials so far, and the turns that follow from them."""

    def __init__(self, folder: pathlib.Path, parameters: list[controllers.Parameter],
                 batch: int) -> None:
        self.batch = batch
        self.file = folder / "trials.npz"
        self.goals = Goals()
        self.deviation = np.array([p.deviation for p in parameters])
        self.start = np.array([p.start for p in parameters])
        self.low = np.array([p.low for p in parameters])
        self.high = np.array([p.high for p in parameters])
        self.numbers: list[np.ndarray] = []  # of each trial
        self.reached: list[np.ndarray] = []  # by each trial: goals, by their index
        self.sure: list[np.ndarray] = []  # likewise, for SURE_STEPS
        self.count = np.zeros(len(self.goals.places))  # trials that reached a goal
        folder.mkdir(parents=True, exist_ok=True)
        if self.file.exists():
            kept = np.load(self.file)
            splits = [np.split(kept[name], np.cumsum(kept[f"{name}_sizes"])[:-1])
                      for name in ("reached", "sure")]
            for numbers, reached, sure in zip(kept["numbers"], *splits):
                self.add(numbers, reached, sure)

    def add(self, numbers: np.ndarray, reached: np.ndarray, sure: np.ndarray) -> None:
        """Takes a trial."""
        self.numbers.append(numbers)
        self.reached.append(reached)
        self.sure.append(sure)
        self.count[reached] += 1

    def save(self) -> None:
        """Keeps all trials."""
        new = self.file.with_suffix(".new.npz")
        np.savez_compressed(new, numbers=self.numbers, reached=np.concatenate(self.reached),
                            reached_sizes=[len(goals) for goals in self.reached],
                            sure=np.concatenate(self.sure),
                            sure_sizes=[len(goals) for goals in self.sure])
        new.replace(self.file)

    def next_turns(self) -> list[np.ndarray]:
        """A batch of turns to try."""
        rng = np.random.default_rng(len(self.numbers))
        worth = np.array([np.sum(1 / self.count[reached]) for reached in self.reached])
        if np.count_nonzero(worth) < self.batch:
            return [self.drawn(rng) for _ in range(self.batch)]
        share = worth / worth.sum()
        return [self.changed(rng, *(self.numbers[i] for i in rng.choice(len(share), 2, p=share)))
                for _ in range(self.batch)]

    def drawn(self, rng: np.random.Generator) -> np.ndarray:
        """A turn from nothing."""
        return self.tidied(self.start + rng.normal(size=len(self.start)) * self.deviation *
                           rng.choice([0.6, 1, 1.5]))

    def changed(self, rng: np.random.Generator, turn: np.ndarray, other: np.ndarray) -> np.ndarray:
        """A change of `turn`, or its first postures with the last ones of another."""
        turn = turn.copy()
        postures, deviation = (x[BEGINS:].reshape(BEGINS + 1, -1) for x in (turn, self.deviation))
        if rng.random() < 0.25:
            cut = rng.integers(1, BEGINS + 1)
            postures[cut:] = other[BEGINS:].reshape(postures.shape)[cut:]
            turn[cut - 1:BEGINS] = other[cut - 1:BEGINS]
        if rng.random() < 0.25:
            one = rng.integers(BEGINS + 1)
            postures[one] += (rng.normal(size=postures.shape[1]) * deviation[one] *
                              rng.choice([0.5, 1, 1.5]))
        else:
            postures += ((rng.random(postures.shape) < rng.choice([0.15, 0.4, 1])) *
                         rng.normal(size=postures.shape) * deviation * rng.choice([0.2, 0.4, 0.8]))
        if rng.random() < 0.4:
            turn[:BEGINS] += rng.normal(size=BEGINS) * self.deviation[:BEGINS] / 2
        return self.tidied(turn)

    def tidied(self, turn: np.ndarray) -> np.ndarray:
        """Whole steps in their order, and numbers of two digits within their bounds."""
        turn = np.round(np.clip(turn, self.low, self.high), 2) + 0.0  # no -0
        turn[:BEGINS] = np.sort(np.round(turn[:BEGINS]))
        return turn

    def run(self, pool: ProcessPoolExecutor, seconds: float) -> None:
        """Tries turns for so long."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            batch = self.next_turns()
            seeds = range(FIRST_SEED + len(self.numbers), FIRST_SEED + len(self.numbers) + len(batch))
            for numbers, path in zip(batch, pool.map(episodes.path_of, batch, seeds)):
                steps = self.goals.steps(path)
                self.add(numbers, np.flatnonzero(steps >= STEPS),
                         np.flatnonzero(steps >= SURE_STEPS))
            self.save()
            print(f"{len(self.numbers)} trials, {np.mean(self.count > 0):.2%} of the goals reached",
                  flush=True)


def varied(reached: list[np.ndarray], goals: int, most: int) -> list[int]:
    """Trials that reach many goals, each goal by up to three of them; the best first."""
    wanted = np.full(goals, 3)
    queue = [(-float(len(goals_of)), i) for i, goals_of in enumerate(reached) if len(goals_of)]
    heapq.heapify(queue)
    chosen: list[int] = []
    while queue and len(chosen) < most:
        _, i = heapq.heappop(queue)
        worth = float(np.sum(wanted[reached[i]] > 0))
        if queue and worth < -queue[0][0]:  # it was worth more before others were chosen
            heapq.heappush(queue, (-worth, i))
            continue
        chosen.append(i)
        wanted[reached[i]] = np.maximum(wanted[reached[i]] - 1, 0)
    return chosen


def best_together(worth: np.ndarray, most: int) -> list[int]:
    """The rows that together have the largest sum of their columns' maxima, one by one."""
    best, chosen = np.zeros(worth.shape[1], worth.dtype), []
    for _ in range(min(most, len(worth))):
        chosen.append(int(np.maximum(worth, best).sum(axis=1).argmax()))
        best = np.maximum(best, worth[chosen[-1]])
    return chosen


def outcomes(paths: list[list[np.ndarray]]) -> list[list[list[float]]]:
    """For each turn, whose dice took `paths`, some poses that dice keep, with the share of the dice
    that do (rotation, place, share): those by which most goals are given to a turn that reaches
    them, as Turn::Promise does it."""
    goals = Goals(OUTCOME_GOALS)
    turns, poses, shares = [], [], []
    for turn, mine in enumerate(paths):
        candidates = np.concatenate([path[STEPS - 1::STEPS] for path in mine])
        kept = np.array([[np.count_nonzero(
            (np.sum((path[:, 3:] - pose[3:]) ** 2, axis=1) < TURN ** 2) &
            (np.sum((path[:, :3] - pose[:3]) ** 2, axis=1) < PLACE ** 2)) for path in mine]
            for pose in candidates])
        share = np.mean(np.minimum(kept / SURE_STEPS, 1), axis=1)
        often = share >= 0.2
        turns += [turn] * np.count_nonzero(often)
        poses.append(candidates[often])
        shares.append(share[often])
    pose, share = np.concatenate(poses), np.concatenate(shares)
    worth = np.array([s * np.exp(-np.sum((goals.rotations - p[3:]) ** 2, axis=1) / 2 / WIDTH ** 2
                                 - np.sum((goals.places - p[:3]) ** 2, axis=1) / 2 / PLACE_WIDTH ** 2)
                      for p, s in zip(pose, share)], dtype=np.float32)
    found: list[list[list[float]]] = [[] for _ in paths]
    for k in best_together(worth, OUTCOMES):
        found[turns[k]].append([*(np.round(pose[k, 3:], 2) + 0.0).tolist(),
                                *(np.round(pose[k, :3], 3) + 0.0).tolist(),
                                round(float(share[k]), 2)])
    return found


def choose(search: Search, pool: ProcessPoolExecutor, most: int) -> list[dict[str, Any]]:
    """The best turns, as a parameter file has them, of so many that reach other goals each."""
    goals = search.goals
    alive = varied(search.sure, len(goals.places), most)
    if not alive:
        raise SystemExit("no turn has reached a goal yet: search longer (--seconds)")
    paths: dict[int, list[np.ndarray]] = {i: [] for i in alive}
    hits = {i: np.zeros(len(goals.places)) for i in alive}  # dice that reached each goal
    seed = CHOICE_SEED

    def best(share: float) -> list[int]:
        worth = np.array([hits[i] for i in alive])
        return [alive[k] for k in best_together(worth, max(1, round(share * most)))]

    for share, dice in ROUNDS:
        alive = best(share) if share < 1 else alive
        jobs = [i for i in alive for _ in range(dice)]
        seeds = range(seed, seed + len(jobs))
        seed += len(jobs)
        for i, path in zip(jobs, pool.map(episodes.path_of, [search.numbers[i] for i in jobs],
                                          seeds)):
            paths[i].append(path)
            hits[i] += (goals.steps(path) >= STEPS) + NEARLY * np.minimum(
                goals.steps(path, 1.5 * TURN, 1.5 * PLACE), 2 * STEPS)
        print(f"{len(alive)} turns with {len(paths[alive[0]])} dice each", flush=True)
    alive = best(KEPT)
    return [{"begins": numbers[:BEGINS].astype(int).tolist(),
             "postures": numbers[BEGINS:].reshape(BEGINS + 1, -1).tolist(), "outcomes": found}
            for numbers, found in zip([search.numbers[i] for i in alive],
                                      outcomes([paths[i] for i in alive])) if found]


def main() -> int:
    """Searches, chooses and keeps."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--library", type=pathlib.Path, required=True,
                        help="libbaseline_controllers.so of the build")
    parser.add_argument("--seconds", type=float, default=0, help="of the search")
    parser.add_argument("--batch", type=int, default=48,
                        help="trials between two looks at which goals are rare")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--turns", type=int, default=420, help="how many --write tries again")
    parser.add_argument("--write", type=pathlib.Path, help="chooses turns, and keeps them there")
    parser.add_argument("--command", default="", help="that found them, for --write")
    args = parser.parse_args()
    args.controller, args.profile, args.config = "turner", "", ""
    known = controllers.Library(args.library).parameters(args.controller)
    search = Search(args.folder, known, args.batch)
    with episodes.workers(args) as pool:
        search.run(pool, args.seconds)
        if args.write is not None:
            turns = choose(search, pool, args.turns)
            args.write.write_text(controllers.written({"command": args.command, "turns": turns}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
