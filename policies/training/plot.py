#!/usr/bin/python3
"""Draws how searches went: their mean distance and step over the episodes that they played.

    plot.py PICTURE.svg FOLDER [FOLDER ...]

Each FOLDER is one of search.py. Needs matplotlib (Debian package python3-matplotlib)."""

import json
import pathlib
import sys

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt  # noqa: E402  (after the choice of its output)

STYLE = {"svg.hashsalt": "myograde", "svg.fonttype": "path", "font.size": 11, "axes.grid": True,
         "grid.color": "#dddddd", "axes.axisbelow": True, "axes.spines.top": False,
         "axes.spines.right": False, "figure.constrained_layout.use": True}


def main(picture, *folders):
    with plt.rc_context(STYLE):
        figure, (distances, steps) = plt.subplots(2, 1, sharex=True, figsize=(8, 6))
        for folder in map(pathlib.Path, folders):
            lines = [json.loads(line)
                     for line in (folder / "progress.jsonl").read_text().splitlines()]
            tests = [line for line in lines if "test" in line]
            episodes = [line["episodes"] for line in lines]
            candidates, = distances.plot(episodes, [line["mean"]["distance"] for line in lines],
                                         alpha=0.5, label=f"{folder.name}: all candidates")
            distances.plot([line["episodes"] for line in tests],
                           [line["test"]["distance"] for line in tests], "o-",
                           color=candidates.get_color(), label=f"{folder.name}: tests of the mean")
            steps.plot(episodes, [line["sigma"] for line in lines])
        distances.set_ylabel("mean distance (m)")
        distances.legend()
        steps.set(ylabel="step (deviations)", xlabel="episodes played")
        figure.savefig(picture, metadata={"Date": None})


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
