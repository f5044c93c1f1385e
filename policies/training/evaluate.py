"""Plays a search's parameters on seeds that no search has seen, and keeps them with the figure.

    PYTHONPATH=build/release/python VENV/bin/python policies/training/evaluate.py PARAMETERS.json \\
        --library build/release/training/libbaseline_controllers.so [--write FILE --command TEXT]

PARAMETERS.json: best.json of a search, or a file of policies/baseline/parameters. Prints the mean
distance with its standard error, how the episodes ended, the ways that falls went (by the lean of
the trunk against its own heading in the last step), and one figure for each way of starting.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import sys
from typing import Any

import numpy as np

import controllers
import episodes

FRESH_SEED = 6_000_000_000  # above those of searches, their tests, and what is looked at


def options() -> argparse.Namespace:
    """What the command line says."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("parameters", type=pathlib.Path)
    parser.add_argument("--library", type=pathlib.Path, required=True)
    parser.add_argument("--controller", choices=controllers.CONTROLLERS, default="walker")
    parser.add_argument("--profile", default="", help="default: paper")
    parser.add_argument("--config", default="", metavar="FILE",
                        help="a track's file to play instead of the shipped one, such as one with "
                             "obstacles near the start")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=FRESH_SEED)
    parser.add_argument("--seconds", type=float, default=300, help="longest episode")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE",
                        help="parameters to replace")
    parser.add_argument("--write", type=pathlib.Path, help="keeps them there with the figure")
    parser.add_argument("--command", default="", help="that found them, for --write")
    return parser.parse_args()


def spread(values: list[float]) -> tuple[float, float]:
    """The mean, and its standard error."""
    return float(np.mean(values)), float(np.std(values) / max(1, len(values) - 1) ** 0.5)


def wilson(count: int, total: int) -> tuple[float, float]:
    """The 95 % interval of a rate of which `count` of `total` were seen."""
    z = 1.96
    middle = (count + z * z / 2) / (total + z * z)
    half = z / (total + z * z) * (count * (total - count) / total + z * z / 4) ** 0.5
    return max(0.0, middle - half), min(1.0, middle + half)


def main() -> int:
    """Plays, prints and keeps."""
    args = options()
    library = controllers.Library(args.library)
    known = library.parameters(args.controller)
    changed = {name: float(value) for name, value in (pair.split("=") for pair in args.set)}
    turner = args.controller == "turner"  # which has a file of turns
    if turner and changed:
        raise SystemExit("--set: the turner has turns, no parameters; change its file")
    if turner:
        try:
            controllers.Turner.of_file(library, args.parameters)
        except ValueError as error:
            raise SystemExit(str(error)) from error
    numbers = (args.parameters if turner else
               controllers.read_numbers(args.parameters, known, changed))
    jobs = [(numbers, args.first_seed + i, args.seconds) for i in range(args.episodes)]
    with episodes.workers(args) as pool:
        results = list(pool.map(episodes.play, jobs))
    mean, error = spread([r.distance for r in results])
    share = {"juggler": "solved", "tagger": "score", "turner": "success"}.get(args.controller)
    figure: dict[str, Any] = {
        share or "distance_m": round(mean, 4 if share else 3),
        "standard_error" if share else "standard_error_m": round(error, 4 if share else 3),
        "profile": args.profile or controllers.CONTROLLERS[args.controller].profile,
        "episodes": args.episodes, "first_seed": args.first_seed, "seconds": args.seconds,
        "ends": episodes.counts(r.end for r in results)}
    if args.controller in ("reacher", "carrier"):
        counted = [("success", sum(r.success for r in results)),
                   ("lifted", sum(r.lifted for r in results))]
        if args.controller == "reacher":
            counted += [("given", sum(r.given for r in results)),
                        ("touched_by_both", sum(r.both for r in results))]
        for name, count in counted:
            figure[name] = count
            figure[f"{name}_wilson95"] = [round(x, 3) for x in wilson(count, len(results))]
    elif args.controller == "walker":
        fallen = [r for r in results if r.end == "fell"]
        figure["falls"] = episodes.counts(r.tilt for r in fallen)
        figure["falls_by_course"] = {
            course: episodes.counts(r.tilt for r in fallen if r.course == course)
            for course in episodes.COURSES}
    print(json.dumps(figure))
    unit = "" if share else " m"
    for start in sorted({r.start for r in results}):
        mine = [r for r in results if r.start == start]
        print(f"{start}: {len(mine)} episodes, {spread([r.distance for r in mine])[0]:.2f}{unit} in "
              f"{spread([r.time for r in mine])[0]:.2f} s")
    if args.write is not None:
        content = {"command": args.command, "figure": figure, **(
            {"turns": json.loads(args.parameters.read_text())["turns"]} if turner else
            {"parameters": {p.name: float(x) for p, x in zip(known, numbers)}})}
        args.write.write_text(controllers.written(content))
    return 0


if __name__ == "__main__":
    sys.exit(main())
