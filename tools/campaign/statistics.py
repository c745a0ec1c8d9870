"""Confidence bounds: Wilson's for shares, the bootstrap's for quantiles."""

import math
from typing import NamedTuple

import numpy as np
from scipy.stats import binomtest

from plant_sim.arrays import FloatArray

CONFIDENCE = 0.95
PERCENTILES = 50.0 * (1.0 - CONFIDENCE), 50.0 * (1.0 + CONFIDENCE)
RESAMPLES = 1000
MOST_NUMBERS = 5_000_000
"""Largest number of values that the bootstrap samples in all, unless 100 resamples need more.

The quantiles of many values vary little, so that few resamples suffice.
"""


class Share(NamedTuple):
    """A share of trials with its confidence bounds."""

    value: float
    low: float
    high: float


class Distribution(NamedTuple):
    """Quantiles of a metric over trials with confidence bounds; `lowest` and `worst` are the extremes."""

    n: int
    lowest: float
    p50: float
    p50_low: float
    p50_high: float
    p95: float
    p95_low: float
    p95_high: float
    worst: float


def wilson(successes: int, trials: int) -> Share:
    """Return a share with Wilson's score interval (J. Am. Stat. Assoc. 22 (1927) 209).

    >>> share = wilson(3000, 3000)
    >>> round(share.low, 4), share.high
    (0.9987, 1.0)
    """
    if trials == 0:
        return Share(math.nan, 0.0, 1.0)
    bounds = binomtest(successes, trials).proportion_ci(CONFIDENCE, method="wilson")
    low = 0.0 if successes == 0 else float(bounds.low)
    high = 1.0 if successes == trials else float(bounds.high)
    return Share(successes / trials, low, high)


def distribution(values: FloatArray) -> Distribution | None:
    """Return the quantiles of the finite values with percentile-bootstrap bounds; None if there are none."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return None
    ordered = np.sort(finite)
    n = len(ordered)
    p50, p95 = np.quantile(ordered, [0.5, 0.95])
    rng = np.random.default_rng(n)
    # Resample with replacement: random places of the sorted values.
    resampled = np.empty((max(100, min(RESAMPLES, MOST_NUMBERS // n)), 2))
    for row in resampled:
        row[:] = np.quantile(ordered[rng.integers(0, n, n)], [0.5, 0.95])
    low, high = np.percentile(resampled, PERCENTILES, axis=0)
    figures = (ordered[0], p50, low[0], high[0], p95, low[1], high[1], ordered[-1])
    return Distribution(n, *map(float, figures))
