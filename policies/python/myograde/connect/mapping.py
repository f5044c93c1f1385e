"""What a column of a leaderboard elsewhere shows of a result, among it the packed score: one number that
sorts as a board's rule does, as far as one number can.

Its integer part decides first, its twelve decimals then: six for each of two numbers of which less is
better, as 1 / (1 + number). A double holds no more."""

from __future__ import annotations

import math
from typing import Any, Mapping, Sequence

from ..errors import WrongUse

Json = Mapping[str, Any]
DIGITS = 10**6
TOP = 1000  # bands are counted down from here


def boards_of(columns: Json) -> dict[str, str]:
    """The boards whose scores are shown, by what the columns say: `score` or `score.BOARD`."""
    return {of: of.partition(".")[2] or "main" for of in columns.values() if of.split(".")[0] == "score"}


def value(of: str, aggregate: Json, scores: Mapping[str, float]) -> float | None:
    """A score, a metric of the aggregate, or with `.error` half of its 95 % interval. None if the result has
    no such number, as JSON has no infinities."""
    metric, _, error = of.partition(".")
    if metric != "score" and (metric not in aggregate or error and (
            error != "error" or metric not in aggregate["spread"])):
        raise WrongUse(f'a column shows "{of}", but there are score, {", ".join(sorted(set(aggregate) - {"spread"}))}'
                       f", and .error of {', '.join(aggregate['spread'])}")
    spread = aggregate["spread"].get(metric) or {"low": math.inf, "high": math.inf}
    found = scores[of] if metric == "score" else (spread["high"] - spread["low"]) / 2 if error else aggregate[metric]
    return found if isinstance(found, (int, float)) and math.isfinite(found) else None


def _packed(first: float, then: float | None = None, last: float | None = None) -> float:
    # None ranks behind every number.
    parts = [0 if less is None else min(DIGITS - 1, int(DIGITS / (1 + max(less, 0)))) for less in (then, last)]
    return first + (parts[0] * DIGITS + parts[1]) / DIGITS**2


def _steps(begin: float, end: float, factor: float) -> int:
    """How many whole bands lie between an opener and a later number."""
    return max(0, math.ceil(math.log(end / begin) / math.log(factor) - 1e-9) - 1)


def _band(number: float, openers: Sequence[float], factor: float) -> int:
    """The band of a number of which less is better: these open bands, and between, after and before them every
    `factor` does."""
    if number < openers[0]:
        return -1 - _steps(number, openers[0], factor)
    index = 0
    for opener, following in zip(openers, [*openers[1:], math.inf]):
        if number < following:
            return index + (_steps(opener, number, factor) if number > factor * opener else 0)
        index += 1 + _steps(opener, following, factor)
    return index


def _axis(rules: Json, number: float) -> float:
    """What bands are cut by, so that less is better; and back."""
    return max(number, 1e-9) if rules.get("bands") == "time" else 1 / max(number, 1e-9)


def _cut(rules: Json, aggregate: Json) -> tuple[float, float] | None:
    """What bands are cut by and their factor; None for a result that is in no band."""
    if "line_successes" in rules:
        above = aggregate["successes"] * rules["line_episodes"] >= rules["line_successes"] * aggregate["episodes"]
        number, factor = aggregate["time_s" if rules["bands"] == "time" else "success_rate"], rules["band_factor"]
    else:
        number, factor = aggregate["distance_m"] or 0, 1 + rules.get("distance_band", 0)
        above = factor > 1 and number >= rules["time_from_m"]
    return (_axis(rules, number), factor) if above else None


def score(rules: Json, aggregate: Json, openers: Sequence[float] = ()) -> float:
    """The packed score of a result under a board's `rules` (GET /v1/leaderboard); more is better. In which band a
    result stands depends on the others: `openers` are what opens bands (s, success rate or m, as the rule has
    it); without them 1 s, all successes or 1 m does."""
    if "qualify_m" in rules:
        over = "_over_steps" if rules["means"] == "steps" else ""
        qualified = (aggregate["distance_m"] or 0) >= rules["qualify_m"]
        return _packed(1, aggregate["pain" + over], aggregate["effort" + over]) if qualified else 0.0
    tiered = "line_successes" in rules
    if cut := _cut(rules, aggregate):
        band = _band(cut[0], sorted(_axis(rules, opener) for opener in openers) or [1.0], cut[1])
        first = TOP - max(-TOP // 2, min(TOP // 2, band))
        return (_packed(aggregate["episodes"] + first, aggregate["effort"]) if tiered else
                _packed(rules["time_from_m"] + first, aggregate["time_s"], cut[0]))
    if tiered:
        return _packed(aggregate["successes"],
                       *((aggregate["time_s"], aggregate["effort"]) if rules["ties"] == "time" else ()))
    distance = aggregate["distance_m"] or 0
    timed = distance >= rules["time_from_m"]
    return _packed(int(distance * DIGITS), aggregate["time_s"] if timed else None) / DIGITS


def openers_of(rules: Json, rows: Sequence[Json]) -> list[float]:
    """What opens the bands of a board with these rows, for `band_openers`."""
    found: list[float] = []
    cuts = [_cut(rules, row["aggregate"]) for row in rows if "qualify_m" not in rules and not row["baseline"]]
    for number, factor in sorted(filter(None, cuts)):
        if not found or number > factor * found[-1]:
            found.append(number)
    return sorted(_axis(rules, opener) for opener in found)
