"""Shows which of the walker's parameters change the way that it falls, how far it gets, and how
often it leaves the track.

    PYTHONPATH=build/release/python VENV/bin/python policies/training/screen.py PARAMETERS.json \\
        --library build/release/training/libbaseline_controllers.so --only PATTERN [options]

Every parameter is changed in every run, up in half of the runs and down in the others, so that the
episodes of all runs tell about each of them: a two-level fractional factorial design (Box, Hunter
and Hunter, Statistics for Experimenters, chapter 6), from the columns of a Hadamard matrix. Prints
a table: what a step up changes, each with its standard error. Effects of pairs are taken for noise.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import pathlib
import re
import sys

import numpy as np

import controllers
import episodes

FIRST_SEED = 2_300_000_000  # of the seeds of searches


@dataclasses.dataclass(frozen=True)
class Effects:
    """What a step up of each parameter changes, and the standard error of these."""

    steps: np.ndarray
    error: float


def options() -> argparse.Namespace:
    """What the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("parameters", type=pathlib.Path)
    parser.add_argument("--library", type=pathlib.Path, required=True)
    parser.add_argument("--only", default=".*", metavar="PATTERN",
                        help="parameters whose whole names match, fewer than the runs")
    parser.add_argument("--step", type=float, default=0.35, help="in deviations")
    parser.add_argument("--runs", type=int, default=64, help="a power of two")
    parser.add_argument("--seeds", type=int, default=36, help="episodes of each run")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--seconds", type=float, default=30, help="longest episode")
    parser.add_argument("--config", default="", metavar="FILE",
                        help="a track's file to play instead of the shipped one")
    parser.add_argument("--processes", type=int, default=1)
    return parser.parse_args()


def design(runs: int, count: int) -> np.ndarray:
    """Runs x count of 1 and -1: columns of a Hadamard matrix, so that each has as many of both and
    every two are orthogonal. SystemExit if there are none."""
    if runs < 4 or runs & (runs - 1):
        raise SystemExit(f"--runs {runs}: has to be a power of two, 4 or more.")
    if not 1 <= count <= runs - 2:
        raise SystemExit(f"--only: {count} parameters match; {runs} runs tell about 1 to "
                         f"{runs - 2}.")
    matrix = np.ones((1, 1))
    while len(matrix) < runs:
        matrix = np.block([[matrix, matrix], [matrix, -matrix]])
    # At random: the product of two columns is a third one, and parameters that stand side by side
    # more often act together.
    columns = np.random.default_rng(1).permutation(np.arange(1, runs))[:count]
    return matrix[:, columns]


def effects(signs: np.ndarray, values: np.ndarray) -> Effects:
    """Least squares for signs (runs x parameters) and what each run's mean was."""
    runs, count = signs.shape
    steps = signs.T @ values / runs
    rest = values - values.mean() - signs @ steps
    return Effects(steps, float(np.sqrt(rest @ rest / (runs - 1 - count) / runs)))


def main() -> int:
    """Plays and prints."""
    args = options()
    args.controller, args.profile = "walker", ""
    known = controllers.Library(args.library).parameters(args.controller)
    middle = controllers.read_numbers(args.parameters, known)
    searched = [i for i, p in enumerate(known) if re.fullmatch(args.only, p.name)]
    signs = design(args.runs, len(searched))
    jobs = []
    for run, row in enumerate(signs):
        numbers = middle.copy()
        for i, sign in zip(searched, row):
            changed = middle[i] + sign * args.step * known[i].deviation
            numbers[i] = min(max(changed, known[i].low), known[i].high)
        first = args.first_seed + run * args.seeds
        jobs += [(numbers, first + k, args.seconds) for k in range(args.seeds)]
    with episodes.workers(args) as pool:
        results = list(pool.map(episodes.play, jobs, chunksize=4))
    measured = {
        "distance_m": [r.distance for r in results],
        "fell_forwards": [float(r.end == "fell" and r.tilt == "forwards") for r in results],
        "fell_sideways": [float(r.end == "fell" and r.sideways()) for r in results],
        "off_track": [float(r.end == "off-track") for r in results]}
    means = {name: np.reshape(values, (args.runs, args.seeds)).mean(axis=1)
             for name, values in measured.items()}
    means["forwards_minus_sideways"] = means["fell_forwards"] - means["fell_sideways"]
    print(json.dumps({name: round(float(values.mean()), 4) for name, values in means.items()}))
    found = {name: effects(signs, means[name])
             for name in ("forwards_minus_sideways", "distance_m", "off_track")}
    print("\t".join(["parameter", "step", *(f"{name} (+-{effect.error:.3f})"
                                            for name, effect in found.items())]))
    for k in np.argsort(-np.abs(found["forwards_minus_sideways"].steps)):
        parameter = known[searched[k]]
        print("\t".join([parameter.name, f"{args.step * parameter.deviation:+.4g}",
                         *(f"{effect.steps[k]:+.3f}" for effect in found.values())]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
