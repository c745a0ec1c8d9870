"""Confidence bounds of shares (Wilson) and of quantiles (order statistics)."""

import math
from typing import NamedTuple

import numpy as np
import scipy  # it loads `stats` at the first use, which takes longer than a short run

from plant_sim.arrays import FloatArray

CONFIDENCE = 0.95
TAIL = 0.5 * (1.0 - CONFIDENCE)


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
    bounds = scipy.stats.binomtest(successes, trials).proportion_ci(CONFIDENCE, method="wilson")
    low = 0.0 if successes == 0 else float(bounds.low)
    high = 1.0 if successes == trials else float(bounds.high)
    return Share(successes / trials, low, high)


def quantile(ordered: FloatArray, share: float) -> tuple[float, float, float]:
    """Return a quantile of ordered values with bounds for any distribution.

    The number of values below the true quantile is binomial, so two of the values are bounds (David &
    Nagaraja, Order Statistics, 2003, ch. 7); of too few values they are the extremes.

    >>> quantile(np.arange(1.0, 101.0), 0.5)
    (50.5, 40.0, 61.0)
    """
    n = len(ordered)
    low, high = (int(scipy.stats.binom.ppf(tail, n, share)) for tail in (TAIL, 1.0 - TAIL))
    bounds = ordered[max(low - 1, 0)], ordered[min(high, n - 1)]
    return float(np.quantile(ordered, share)), float(bounds[0]), float(bounds[1])


def distribution(values: FloatArray) -> Distribution | None:
    """Return the quantiles of the finite values with their bounds; None if there are none."""
    ordered = np.sort(values[np.isfinite(values)])
    if len(ordered) == 0:
        return None
    p50, p95 = quantile(ordered, 0.5), quantile(ordered, 0.95)
    return Distribution(len(ordered), float(ordered[0]), *p50, *p95, float(ordered[-1]))
