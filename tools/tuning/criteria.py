"""The criteria for a start, in their order, and significant differences between candidates.

All candidates run the same trials and are compared in pairs: the bootstrap (Efron 1979) resamples the same
trials for both. A candidate is worse in a `Criterion` if the lower 95 % bound of the difference is above the
criterion's resolution. Otherwise the two count as equal in it, and the next criterion decides.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from plant_sim.arrays import FloatArray
from tools.campaign.campaign import Outcome

FAILED, IMPACT, CAPTURE_S, ENERGY_J = range(4)
"""Rows of a table of starts: 1 if it fails, largest over steady impact, time and energy to capture."""
RESAMPLES = 500
LOWER_PERCENTILE = 2.5
HARDEST = 0.05
"""Share of starts with the largest impacts, whose mean is the criterion; the maximum varies with the seed."""
QUANTILE = 0.95


class Criterion(NamedTuple):
    """A figure of starts that is to be small; differences up to `resolution` do not count."""

    name: str
    row: int
    of: Callable[[FloatArray], Any]
    """Computes the figure over the last axis, the starts."""
    resolution: float


def hardest(values: FloatArray) -> FloatArray:
    """The mean of the largest twentieth of the values; a missing value (NaN) counts as 0."""
    count = max(1, round(HARDEST * values.shape[-1]))
    return np.asarray(np.mean(np.sort(np.nan_to_num(values, nan=0.0), axis=-1)[..., -count:], axis=-1))


late = partial(np.nanquantile, q=QUANTILE, axis=-1)
"""The 95th percentile."""

CRITERIA = (
    Criterion("failures", FAILED, partial(np.mean, axis=-1), 0.0),
    Criterion("overshoot", IMPACT, hardest, 0.0),
    Criterion("capture", CAPTURE_S, late, 0.1),
    Criterion("energy", ENERGY_J, partial(np.nanmedian, axis=-1), 0.05),
)
"""Reliability comes first: any significant difference counts. A wearer does not notice 0.1 s or 0.05 J."""


def starts_of(outcomes: Sequence[Outcome]) -> FloatArray:
    """The table of the eligible starts, shape (4, starts); NaN where a figure was not measured."""
    return np.array(
        [
            [
                float(one.why != ""),
                one.metrics.get("overshoot", one.metrics.get("overshoot_low_r", np.nan)),
                one.metrics.get("capture", np.nan),
                one.metrics.get("energy", np.nan),
            ]
            for one in outcomes
            if one.eligible
        ]
    ).T


def is_worse(one: FloatArray, other: FloatArray, criterion: Criterion) -> bool:
    """Whether `one` is significantly worse than `other` in a criterion."""
    count = one.shape[1]
    resampled = np.random.default_rng(count).integers(0, count, (RESAMPLES, count))
    differences = criterion.of(one[criterion.row][resampled]) - criterion.of(other[criterion.row][resampled])
    return bool(np.percentile(differences, LOWER_PERCENTILE) > criterion.resolution)


class Choice(NamedTuple):
    """The best of some candidates, and all that are not significantly worse in any criterion."""

    best: int
    alike: tuple[int, ...]


def choose(candidates: Sequence[FloatArray]) -> Choice:
    """In each criterion, drop the candidates significantly worse than its best; the last one's best wins."""
    left = list(range(len(candidates)))
    best = left[0]
    for criterion in CRITERIA:
        figures = {one: float(criterion.of(candidates[one][criterion.row])) for one in left}
        best = min(left, key=figures.__getitem__)
        left = [one for one in left if not is_worse(candidates[one], candidates[best], criterion)]
    return Choice(best, tuple(left))


def find_differing(one: FloatArray, other: FloatArray) -> list[Criterion]:
    """The criteria in which two candidates differ significantly."""
    return [
        criterion
        for criterion in CRITERIA
        if is_worse(one, other, criterion) or is_worse(other, one, criterion)
    ]
