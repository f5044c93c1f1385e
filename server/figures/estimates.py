"""Means, shares and quantiles with their 95 % intervals."""

import bisect
import math

# The 97.5 % quantile of the normal distribution: half a 95 % interval in standard errors.
HALF_WIDTH = 1.959963984540054
BINS = 24
MOST_STEPS = 400  # of a curve; more can't be seen


def is_number(value):
    return (isinstance(value, (int, float)) and not isinstance(value, bool)
            and math.isfinite(value))


def mean(values):
    """{"mean", "low", "high", "count"}: the interval is that of the normal distribution, as boards
    have it; low and high are None with fewer than two values, everything but count without any."""
    count = len(values)
    if not count:
        return {"mean": None, "low": None, "high": None, "count": 0}
    middle = math.fsum(values) / count
    if count == 1:
        return {"mean": middle, "low": None, "high": None, "count": 1}
    deviation = math.sqrt(math.fsum((value - middle) ** 2 for value in values) / (count - 1))
    half = HALF_WIDTH * deviation / math.sqrt(count)
    return {"mean": middle, "low": middle - half, "high": middle + half, "count": count}


def share(part, whole):
    """{"part", "whole", "share", "low", "high"}, with Wilson's interval; None of nothing."""
    if not whole:
        return {"part": part, "whole": whole, "share": None, "low": None, "high": None}
    rate = part / whole
    square = HALF_WIDTH ** 2
    centre = (rate + square / (2 * whole)) / (1 + square / whole)
    half = (HALF_WIDTH / (1 + square / whole)
            * math.sqrt(rate * (1 - rate) / whole + square / (4 * whole ** 2)))
    # Exact where rounding would leave them near it.
    return {"part": part, "whole": whole, "share": rate,
            "low": max(0.0, centre - half) if part else 0.0,
            "high": min(1.0, centre + half) if part < whole else 1.0}


def quantile(ordered, part):
    """Of values in ascending order, between the two nearest; None without any."""
    if not ordered:
        return None
    place = part * (len(ordered) - 1)
    below = math.floor(place)
    above = min(below + 1, len(ordered) - 1)
    return ordered[below] + (place - below) * (ordered[above] - ordered[below])


def spread(values):
    """Smallest, quartiles and largest, beside the mean and its interval."""
    ordered = sorted(values)
    return {**mean(values), "least": ordered[0] if ordered else None,
            "quartiles": [quantile(ordered, part) for part in (0.25, 0.5, 0.75)],
            "most": ordered[-1] if ordered else None}


def histogram(values, kinds):
    """{"edges", "counts": {kind: [...]}} of `values`, each of the kind beside it."""
    low, high = min(values), max(values)
    if low == high:
        low, high = low - 0.5, high + 0.5
    edges = [low + (high - low) * place / BINS for place in range(BINS + 1)]
    counts = {kind: [0] * BINS for kind in sorted(set(kinds))}
    for value, kind in zip(values, kinds):
        counts[kind][min(int(BINS * (value - low) / (high - low)), BINS - 1)] += 1
    return {"edges": edges, "counts": counts}


def reached(ends, total):
    """Of `total` episodes, `ends` of which stopped there: the share that is left at each place, as
    a curve of steps with Wilson's interval at each: {"at", "share", "low", "high"}. It begins at 0
    and falls right after an end."""
    ordered = sorted(ends)
    places = sorted({0.0, *ordered})
    if len(places) > MOST_STEPS:
        places = [places[round(step * (len(places) - 1) / (MOST_STEPS - 1))]
                  for step in range(MOST_STEPS)]
    curve = {"at": places, "share": [], "low": [], "high": []}
    for place in places:
        left = share(total - bisect.bisect_right(ordered, place), total)
        for key in ("share", "low", "high"):
            curve[key].append(left[key])
    return curve
