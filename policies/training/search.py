"""Searches for a baseline's parameters by CMA-ES on the graded simulator.

    PYTHONPATH=build/release/python VENV/bin/python policies/training/search.py FOLDER \\
        --library build/release/training/libbaseline_controllers.so [options]

FOLDER keeps all of it: search.pkl (what a later call with the same FOLDER goes on from),
progress.jsonl (a line for each generation) and best.json (the mean of the search's distribution
whenever it did best on the test seeds so far).
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import pathlib
import pickle
import re
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from typing import Any, Optional

import cma
import numpy as np

import controllers
import episodes

# Seeds of graded and practice episodes are small numbers; those of the search are above this.
FIRST_SEED = 1_000_000_000
TEST_SEED = 3_000_000_000


def options() -> argparse.Namespace:
    """What the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--library", type=pathlib.Path, required=True,
                        help="libbaseline_controllers.so of the build")
    parser.add_argument("--controller", choices=controllers.CONTROLLERS, default="walker")
    parser.add_argument("--profile", default="", help="default: paper")
    parser.add_argument("--config", default="", metavar="FILE",
                        help="a track's file to play instead of the shipped one")
    parser.add_argument("--sideways", type=float, default=0, metavar="POINTS",
                        help="what a walker that falls or leaves the track sideways loses")
    parser.add_argument("--only", default="", metavar="PATTERN",
                        help="changes only the parameters whose whole names match")
    parser.add_argument("--from", dest="start", type=pathlib.Path,
                        help="parameters to start from (best.json of another search)")
    parser.add_argument("--sigma", type=float, default=1.0, help="first step, in deviations")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--population", type=int, default=16)
    parser.add_argument("--seeds", type=int, default=8, help="episodes of each candidate")
    parser.add_argument("--diagonal", type=int, default=150,
                        help="generations that learn no correlations")
    parser.add_argument("--seconds", type=float, default=10, help="longest episode")
    parser.add_argument("--generations", type=int, default=1_000_000)
    parser.add_argument("--test-every", type=int, default=10, help="generations")
    parser.add_argument("--test-seeds", type=int, default=32)
    parser.add_argument("--seed", type=int, default=1, help="of the search itself")
    return parser.parse_args()


class Search:
    """A CMA-ES in units of the parameters' deviations, and how far it is."""

    fixed: Optional[np.ndarray] = None  # all numbers, if only some of them are searched
    free: Any = slice(None)  # which those are

    def __init__(self, args: argparse.Namespace) -> None:
        self.parameters = controllers.Library(args.library).parameters(args.controller)
        self.names = [p.name for p in self.parameters]
        self.scale = np.array([p.deviation for p in self.parameters])
        start = np.array([p.start for p in self.parameters])
        if args.start is not None:
            start = controllers.read_numbers(args.start, self.parameters)
        if args.only:
            self.fixed = start
            self.free = [i for i, name in enumerate(self.names) if re.fullmatch(args.only, name)]
            if not self.free:
                raise SystemExit(f"--only {args.only}: no parameter has such a name.")
        low = np.array([p.low for p in self.parameters]) / self.scale
        high = np.array([p.high for p in self.parameters]) / self.scale
        self.strategy = cma.CMAEvolutionStrategy(
            np.clip(start / self.scale, low, high)[self.free], args.sigma,
            {"bounds": [list(low[self.free]), list(high[self.free])], "popsize": args.population, "seed": args.seed,
             "verbose": -9, "CMA_diagonal": args.diagonal})
        self.generation = 0
        self.episodes = 0
        self.best: Optional[float] = None

    def numbers(self, point: np.ndarray) -> np.ndarray:
        """A point of the search as the controller's numbers."""
        if self.fixed is None:
            return np.asarray(point) * self.scale
        numbers = self.fixed.copy()
        numbers[self.free] = np.asarray(point) * self.scale[self.free]
        return numbers

    def mean(self) -> np.ndarray:
        """The numbers in the middle of the search's distribution."""
        boundary = self.strategy.boundary_handler
        return self.numbers(boundary.repair(self.strategy.mean.copy()))


def save(path: pathlib.Path, content: bytes) -> None:
    """Replaces the file at once, so that an interrupted search finds the old or the new one."""
    partial = path.with_suffix(".partial")
    partial.write_bytes(content)
    os.replace(partial, path)


def summary(results: list[episodes.Result]) -> dict[str, Any]:
    """Means over episodes, and how often each end came."""
    return {"score": float(np.mean([r.score for r in results])),
            "distance": float(np.mean([r.distance for r in results])),
            "lifted": float(np.mean([r.lifted for r in results])),
            "given": float(np.mean([r.given for r in results])),
            "success": float(np.mean([r.success for r in results])),
            "time": float(np.mean([r.time for r in results])),
            "ends": episodes.counts(r.end for r in results),
            "falls": episodes.counts(r.tilt for r in results if r.end == "fell")}


def play(pool: ProcessPoolExecutor, candidates: list[np.ndarray], seeds: list[int],
         args: argparse.Namespace) -> list[list[episodes.Result]]:
    """What each candidate does on each seed. BrokenProcessPool if a worker dies."""
    jobs = [(numbers, seed, args.seconds) for numbers in candidates for seed in seeds]
    flat = [dataclasses.replace(r, score=r.score - args.sideways) if r.sideways() else r
            for r in pool.map(episodes.play, jobs, chunksize=max(1, len(seeds) // 4))]
    return [flat[i:i + len(seeds)] for i in range(0, len(flat), len(seeds))]


def test(search: Search, pool: ProcessPoolExecutor, args: argparse.Namespace,
         line: dict[str, Any]) -> None:
    """Plays the mean of the distribution on seeds that the search never sees; keeps the best."""
    seeds = [TEST_SEED + i for i in range(args.test_seeds)]
    mean = search.mean()
    found = summary(play(pool, [mean], seeds, args)[0])
    line["test"] = found
    if search.best is None or found["score"] > search.best:
        search.best = found["score"]
        best = {"parameters": dict(zip(search.names, mean.tolist())), "test": found,
                "generation": search.generation, "seconds": args.seconds}
        save(args.folder / "best.json", json.dumps(best, indent=1).encode())


def step(search: Search, pool: ProcessPoolExecutor, args: argparse.Namespace) -> dict[str, Any]:
    """A generation: all of its candidates play the same seeds, which none has played before."""
    began = time.monotonic()
    first = FIRST_SEED + search.generation * args.seeds
    points = search.strategy.ask()
    results = play(pool, [search.numbers(p) for p in points],
                   list(range(first, first + args.seeds)), args)
    scores = [float(np.mean([r.score for r in result])) for result in results]
    search.strategy.tell(points, [-score for score in scores])
    search.generation += 1
    search.episodes += len(points) * args.seeds
    everything = summary([r for result in results for r in result])
    return {"generation": search.generation, "episodes": search.episodes,
            "sigma": float(search.strategy.sigma), "best": max(scores), "mean": everything,
            "wall_s": round(time.monotonic() - began, 1)}


def main() -> int:
    """Searches until --generations are played or somebody ends it."""
    args = options()
    args.folder.mkdir(parents=True, exist_ok=True)
    state = args.folder / "search.pkl"
    search = pickle.loads(state.read_bytes()) if state.exists() else Search(args)
    known = controllers.Library(args.library).parameters(args.controller)
    if search.names != [p.name for p in known]:
        raise SystemExit(f"{state}: this search is of other parameters than the {args.controller} "
                         "has now. Start a new one in another folder, from this one's best.json.")
    with episodes.workers(args) as pool:
        while search.generation < args.generations:
            line = step(search, pool, args)
            if search.generation % args.test_every == 0:
                test(search, pool, args, line)
            with (args.folder / "progress.jsonl").open("a") as log:
                log.write(json.dumps(line) + "\n")
            save(state, pickle.dumps(search))
    return 0


if __name__ == "__main__":
    sys.exit(main())
