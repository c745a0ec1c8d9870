"""Two campaigns of the same trials with other parameters: the paired differences, with intervals.

Both sample the same module and start for a trial's number, so that differences of a trial are due to the
parameters alone.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy

from tools.campaign.campaign import Outcome
from tools.campaign.statistics import CONFIDENCE, quantile

FEWEST_PAIRS = 6
"""Fewest pairs with bounds of a median at `CONFIDENCE`: all of n lie on one side of it with 2 · 0.5^n."""


def difference_of_shares(gained: int, lost: int, pairs: int) -> tuple[float, float]:
    """Bounds of (gained − lost) / pairs: Clopper and Pearson's for each count, together at `CONFIDENCE`.

    >>> low, high = difference_of_shares(12, 2, 100)
    >>> -0.03 < low < 0.1 < high < 0.25
    True
    """
    each = 0.5 * (1.0 + CONFIDENCE)
    more, less = (scipy.stats.binomtest(one, pairs).proportion_ci(each) for one in (gained, lost))
    return float(more.low - less.high), float(more.high - less.low)


def success_row(pairs: Sequence[tuple[Outcome, Outcome]]) -> dict[str, Any]:
    """The difference of the shares of successes."""
    before, after = (np.array([one.why == "" for one in side]) for side in zip(*pairs, strict=True))
    low, high = difference_of_shares(int(sum(after & ~before)), int(sum(before & ~after)), len(pairs))
    return row("success", "1", (float(before.mean()), float(after.mean())), (low, high), len(pairs))


def row(
    figure: str, unit: str, values: tuple[float, float], bounds: tuple[float, float], pairs: int
) -> dict[str, Any]:
    """One figure: its value in the baseline and here, the difference, and the bounds of that."""
    low, high = bounds
    return {
        "figure": figure,
        "unit": unit,
        "baseline": values[0],
        "value": values[1],
        "low": low,
        "high": high,
        "differs": not low <= 0.0 <= high,
        "pairs": pairs,
    }


def compare(
    baseline: Sequence[Outcome], outcomes: Sequence[Outcome], units: Mapping[str, str]
) -> list[dict[str, Any]]:
    """The paired differences, outcomes − baseline, of the successes and of each metric's median.

    A pair are the two eligible outcomes of one trial. `low` and `high` are 95 % bounds of the difference: of
    the shares of successes, and of the median of a metric's differences (order statistics), infinite for
    fewer than `FEWEST_PAIRS`. Pooled samples,
    such as the latencies of all impacts, have no pairs and are left out.
    """
    before = {one.trial: one for one in baseline if one.eligible}
    pairs = [(before[one.trial], one) for one in outcomes if one.eligible and one.trial in before]
    if not pairs:
        return []
    rows = [success_row(pairs)]
    for name in dict.fromkeys(name for pair in pairs for one in pair for name in one.metrics):
        values = np.array([[one.metrics.get(name, math.nan) for one in pair] for pair in pairs])
        values = values[np.isfinite(values).all(axis=1)]
        if len(values):
            medians = float(np.median(values[:, 0])), float(np.median(values[:, 1]))
            _, low, high = quantile(np.sort(values[:, 1] - values[:, 0]), 0.5)
            if len(values) < FEWEST_PAIRS:
                low, high = -math.inf, math.inf
            rows.append(row(name, units.get(name, "1"), medians, (low, high), len(values)))
    return rows
