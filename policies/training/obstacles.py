#!/usr/bin/python3
"""Writes the locomotion track with easier obstacles that begin early, for the walker's search: an
attempt at the first one then takes seconds in place of half a minute.

    obstacles.py TRACK.json

The shipped track's first obstacle begins 25 m from the start, and they become eight times as high.
Here every second patch of 5 m has one from 5 m on, at most three times as high as the first."""

import json
import pathlib
import sys

SHIPPED = pathlib.Path(__file__).resolve().parents[2] / "configs/tracks/locomotion.json"
DIFFICULTY = [0.125, 0.125, 0.125, 0.25, 0.375, 0.125, 0.25, 0.375, 0.125, 0.25]


def main(track: str) -> None:
    content = json.loads(SHIPPED.read_text())
    content["profiles"]["paper"]["rules"]["course"]["difficulty"] = [
        height for each in DIFFICULTY for height in (0, each)]
    pathlib.Path(track).write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
