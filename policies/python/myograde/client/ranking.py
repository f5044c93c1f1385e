"""One number that sorts as a board does, as far as one number can: for sites and searches that sort by one.

Its integer part decides first, its twelve decimals then: six for each of two numbers of which less is better, as
1 / (1 + number). A double holds no more. configs/EVALAI.md has a table of what each kind of board packs."""

from __future__ import annotations

import math
from typing import Any, Mapping

Json = Mapping[str, Any]
DIGITS = 10**6


def packed_score(board: Json, aggregate: Json) -> float:
    """The score of a result's `aggregate` on `board`, an answer of Client.board(); more is better. A result that is not
    on the board, and that none of its bands would hold, has a band of its own."""
    rules = board["rules"]
    if not rules:  # the mean score decides, then effort
        return _packed(math.floor(aggregate["score"] * DIGITS), aggregate["effort"]) / DIGITS
    distance, tiered = aggregate.get("distance_m") or 0, "line_successes" in rules
    if "qualify_m" in rules:
        over = "_over_steps" if rules["means"] == "steps" else ""
        qualified = distance >= rules["qualify_m"]
        return _packed(1, aggregate["pain" + over], aggregate["effort" + over]) if qualified else 0.0
    if cut := _cut(rules, aggregate):
        number, factor = cut
        openers = (opener for opener in band_openers(board) if opener <= number <= factor * opener * (1 + 1e-9))
        begin = max(openers, default=number)
        if tiered:
            return _packed(aggregate["episodes"], begin, aggregate["effort"])
        return _packed(round(100 / begin), aggregate["time_s"], number)  # in cm, so above all that is in no band
    if tiered:
        by_time = rules["ties"] == "time"
        return _packed(aggregate["successes"], *((aggregate["time_s"], aggregate["effort"]) if by_time else ()))
    return _packed(int(distance * DIGITS), aggregate["time_s"] if distance >= rules["time_from_m"] else None) / DIGITS


def band_openers(board: Json) -> list[float]:
    """What opens each band of a board, the best first: a time in s, 1 / success rate, or 1 / distance in 1/m, as its
    rules say. Packed scores change when these do."""
    cuts = [(row["band"], cut[0]) for row in board["rows"]
            if row["band"] and (cut := _cut(board["rules"], row["aggregate"]))]
    return sorted(dict(sorted(cuts, reverse=True)).values())  # of each band the least number, which comes last


def _packed(first: float, then: float | None = None, last: float | None = None) -> float:
    # None ranks behind every number.
    parts = [0 if less is None else min(DIGITS - 1, int(DIGITS / (1 + max(less, 0)))) for less in (then, last)]
    return first + (parts[0] * DIGITS + parts[1]) / DIGITS**2


def _cut(rules: Json | None, aggregate: Json) -> tuple[float, float] | None:
    """What bands are cut by, so that less is better, and their factor; None for a result that is in no band."""
    if not rules:
        return None
    if "line_successes" in rules:
        if aggregate["successes"] * rules["line_episodes"] < rules["line_successes"] * aggregate["episodes"]:
            return None
        return aggregate["time_s"] if rules["bands"] == "time" else 1 / aggregate["success_rate"], rules["band_factor"]
    if rules.get("distance_band") and (aggregate["distance_m"] or 0) >= max(rules["time_from_m"], 1e-9):
        return 1 / aggregate["distance_m"], 1 + rules["distance_band"]
    return None
