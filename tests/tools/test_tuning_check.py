"""The defaults against the tunings: what counts as agreement, and that disagreement is said."""

import pytest

from firmware_py.shell.parameters import DEFAULTS
from tools.tuning import detector, estimator, start
from tools.tuning.check import TOLERANCES, Tolerance, margins_of, rows_of
from tools.tuning.result import Tuning, tuned
from tools.tuning.speed import tune_speed


@pytest.mark.parametrize(
    ("tolerance", "default", "holds"),
    [
        (Tolerance(1.05), 1.04, True),
        (Tolerance(1.05), 1.06, False),
        (Tolerance(1.05), 0.96, True),
        (Tolerance(1.05), 0.95, False),
        (Tolerance(difference=0.1), 1.09, True),
        (Tolerance(difference=0.1), 0.89, False),
        (Tolerance(in_range=True), 1.9, True),
        (Tolerance(in_range=True), 2.1, False),
        (Tolerance(), 1.0, True),
        (Tolerance(), 1.001, False),
    ],
)
def test_agreement_is_what_the_tolerance_says(tolerance: Tolerance, default: float, holds: bool) -> None:
    assert tolerance.holds(default, 1.0, 0.5, 2.0) is holds


def test_every_tolerance_says_what_it_is() -> None:
    assert str(Tolerance(1.005)) == "± 0.5 %"
    assert str(Tolerance(2.0, in_range=True)) == "× or ÷ 2 or as good"
    assert str(Tolerance(difference=1e-4)) == "± 0.0001"
    assert all(str(tolerance) for tolerance in TOLERANCES.values())


def test_every_parameter_that_is_tuned_has_a_tolerance() -> None:
    assert {detector.PARAMETER, estimator.FLOOR, *estimator.GRID, *start.SPACE} <= set(TOLERANCES)
    assert set(TOLERANCES) <= set(DEFAULTS)


def test_the_speed_loops_defaults_are_what_tuning_gives() -> None:
    assert all(row.passed for row in rows_of([tune_speed()[0]]))


def test_a_default_that_tuning_does_not_give_is_told() -> None:
    other = tune_speed(bandwidth_hz=15.0)[0]
    failed = [row.parameter for row in rows_of([other]) if not row.passed]
    assert "speed.gain_p_n_m_s" in failed


def test_margins_need_the_start_and_the_estimator() -> None:
    """What they are made of is named, so that a tuning that is left out is not taken for a margin of 0."""
    lonely = Tuning("speed", "", None, "", {"speed.gain_i_n_m": tuned("speed.gain_i_n_m", 1, 1, 1)}, {})
    with pytest.raises(KeyError):
        margins_of([lonely], effort=None, progress=lambda *_: None)  # type: ignore[arg-type]
