#!/usr/bin/env python3
"""Records what SciPy says of fixed data, for the tests of scoring/paired_test.h. Use: record.py > paired_test.json
with SciPy 1.17.1 and NumPy, which nothing else here needs."""

import json
import math

import numpy
import scipy
from scipy import stats

MONTE_CARLO = 2_000_000


def mean_difference(a, b, axis):
    return numpy.mean(a, axis=axis) - numpy.mean(b, axis=axis)


def permutation(a, b, resamples):
    """SciPy enumerates all ways if there are at most `resamples` of them."""
    result = stats.permutation_test((a, b), mean_difference, permutation_type="samples",
                                    alternative="two-sided", n_resamples=resamples,
                                    vectorized=True, batch=20_000,
                                    rng=numpy.random.default_rng(1))
    return float(result.pvalue)


def over_steps(pairs):
    """All ways of exchanging [amount, weight] of a and b; the statistic is a ratio of sums."""
    a = numpy.array([pair[0] for pair in pairs], float)
    b = numpy.array([pair[1] for pair in pairs], float)

    def statistic(first, axis):
        # SciPy permutes indices: what is not first is second.
        rows = numpy.arange(len(a))
        first = numpy.moveaxis(numpy.asarray(first, int), axis, -1)
        upper = numpy.where(first[..., None] == 0, a[rows], b[rows]).sum(axis=-2)
        lower = numpy.where(first[..., None] == 0, b[rows], a[rows]).sum(axis=-2)
        return upper[..., 0] / upper[..., 1] - lower[..., 0] / lower[..., 1]

    zeros, ones = numpy.zeros(len(a)), numpy.ones(len(a))
    result = stats.permutation_test((zeros, ones), lambda x, y, axis: statistic(x, axis),
                                    permutation_type="samples", alternative="two-sided",
                                    n_resamples=numpy.inf, vectorized=True)
    return float(result.pvalue)


def series(count, scale, shift, phase):
    return [round(scale * math.sin(1.7 * i + phase) + shift, 6) for i in range(count)]


def main():
    binomial = [{"differing": n, "ahead": k, "p": float(stats.binomtest(k, n, 0.5).pvalue)}
                for n, k in [(1, 1), (2, 1), (2, 2), (5, 5), (6, 1), (10, 0), (10, 3), (19, 4), (20, 10),
                             (40, 29), (99, 40), (100, 35), (1000, 540), (2000, 1180)]]
    exact = []
    for count, scale, shift in [(2, 1, 0.3), (5, 1, 0.2), (8, 2, 0.5), (11, 1, 0.6), (13, 3, 0)]:
        a, b = series(count, scale, shift, 0.4), series(count, scale, 0, 2.1)
        exact.append({"a": a, "b": b, "p": permutation(a, b, numpy.inf)})
    tied = [3, 1, 4, 1, 5, 9, 2, 6, 5, 3]
    exact.append({"a": tied, "b": [2, 2, 4, 1, 4, 7, 3, 6, 4, 2],
                  "p": permutation(tied, [2, 2, 4, 1, 4, 7, 3, 6, 4, 2], numpy.inf)})
    random = []
    for count, scale, shift in [(30, 1, 0.15), (100, 1, 0.1), (100, 1, 0.2),
                                (100, 1, 0.35), (100, 5, 0.3)]:
        a, b = series(count, scale, shift, 0.4), series(count, 0.7 * scale, 0, 2.9)
        random.append({"a": a, "b": b, "p": permutation(a, b, MONTE_CARLO)})
    pairs = [[[0.5 * i + 2, 30 + 7 * (i % 4)], [0.4 * i + 1.5 * (i % 3), 25 + 9 * (i % 5)]]
             for i in range(10)]
    steps = [{"pairs": own, "p": over_steps(own)} for own in (pairs, pairs[:6])]
    print(json.dumps({"scipy": scipy.__version__,
                      "binomial": binomial, "exact": exact, "monte_carlo": random,
                      "monte_carlo_samples": MONTE_CARLO, "over_steps": steps}, indent=1))


if __name__ == "__main__":
    main()
