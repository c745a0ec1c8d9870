"""Which candidates differ: the order of the criteria, what counts as equal, and another sample's result."""

import numpy as np
import pytest

from plant_sim.arrays import FloatArray
from tools.tuning.criteria import CRITERIA, choose, find_differing, is_worse

COUNT = 400


def starts(
    failing: int = 0, impact: float = 1.0, capture_s: float = 6.0, energy_j: float = 3.0, seed: int = 1
) -> FloatArray:
    """Sampled starts: the same seed gives the same trials, shifted by a candidate's difference."""
    spread = np.random.default_rng(seed).normal(0.0, 1.0, (3, COUNT))
    failed = np.arange(COUNT) < failing
    rows = np.array([impact, capture_s, energy_j])[:, None] + np.array([0.02, 0.3, 0.3])[:, None] * spread
    return np.vstack([failed, np.where(failed, np.nan, rows)])


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        (starts(impact=1.2, capture_s=9.0), starts(failing=20, impact=1.0, capture_s=3.0)),
        (starts(capture_s=9.0), starts(impact=1.1, capture_s=3.0)),
        (starts(capture_s=3.0, energy_j=4.0), starts(capture_s=9.0)),
        (starts(energy_j=2.0), starts()),
        (starts(energy_j=2.0, capture_s=6.05), starts()),
        (starts(failing=2, capture_s=3.0), starts()),
    ],
    ids=[
        "a start that fails outweighs all else",
        "then the impacts on the way",
        "then time",
        "then energy",
        "a tenth of a second is none",
        "two failures in this number are chance",
    ],
)
def test_the_aims_decide_in_their_order(better: FloatArray, worse: FloatArray) -> None:
    assert choose([worse, better]) == (1, (1,))
    assert choose([better, worse]) == (0, (0,))


def test_without_a_significant_difference_candidates_are_alike() -> None:
    assert choose([starts(), starts(), starts(impact=1.1)]).alike == (0, 1)
    assert choose([starts(capture_s=6.05, energy_j=3.02), starts()]).alike == (0, 1)


def test_one_outlier_decides_nothing() -> None:
    """The largest of all impacts is a single sample."""
    other = starts()
    other[1, 7] = 1.6
    assert find_differing(starts(), other) == []


def test_the_aims_that_differ_are_named() -> None:
    names = [criterion.name for criterion in find_differing(starts(), starts(impact=1.1, energy_j=2.0))]
    assert names == ["overshoot", "energy"]


@pytest.mark.parametrize("criterion", CRITERIA, ids=lambda criterion: criterion.name)
def test_equal_candidates_rarely_differ_significantly(criterion) -> None:
    """Two candidates of one distribution on separate samples: at most one of twenty differs by chance."""
    significant = sum(
        is_worse(starts(seed=2 * seed), starts(seed=2 * seed + 1), criterion) for seed in range(20)
    )
    assert significant <= 1
