"""The most likely striker: found back from flights of its own, as well as the Cramér–Rao bound says."""

from dataclasses import replace

import numpy as np
import pytest

from tools.tuning.identification.flights import CRANK, Flight
from tools.tuning.identification.flown import (
    FITTED,
    Flown,
    derivatives,
    fly,
    moved,
    reading,
    side_by_side,
    spreads,
)
from tools.tuning.identification.laws import NO_RISE, Law, Striker

T = 1e-3
TRUTH = Striker(87.5, 0.025, 0.125, 0.49, 0.0, -0.2)
NOISE_M_S2 = 0.0145


def flights(count: int = 12) -> list[Flight]:
    """Half a second each, the crank at speeds between r = 0.5 and 1.3; readings without noise."""
    empty = []
    for number in range(count):
        t = np.arange(500) * T
        columns = np.zeros((len(t), 6))
        speed_rad_s = 9.35 * (0.5 + 0.8 * number / count)
        columns[:, CRANK] = np.sin(speed_rad_s * t + 0.7 * number)
        empty.append(Flight(0, len(t), t, np.zeros(len(t)), columns, np.zeros(len(t), bool), None))
    table = side_by_side([(one, ~one.still) for one in empty])
    x0 = np.linspace(0.02, 0.06, count)
    motion = moved(table, TRUTH, NO_RISE, x0, np.linspace(-0.7, -0.3, count))
    z = reading(table, TRUTH, motion)
    return [replace(one, z_m_s2=z[:, place]) for place, one in enumerate(empty)]


def flown(law: Law, known: list[Flight], noise: np.random.Generator | None = None) -> Flown:
    seen = known
    if noise is not None:
        seen = [
            replace(one, z_m_s2=one.z_m_s2 + NOISE_M_S2 * noise.standard_normal(len(one.t_s)))
            for one in known
        ]
    near = TRUTH._replace(stiffness_1_s2=87.0, amplitude_m=0.0252, damping_1_s=0.12, dry_m_s2=0.5)
    return fly(seen, [one.regressors[:, CRANK] < 2.0 for one in seen], law, near, NO_RISE)


def test_what_was_flown_is_found_back() -> None:
    found = flown(Law.BOTH, flights()).striker
    assert found == pytest.approx(TRUTH, rel=1e-5, abs=1e-7)


def test_the_errors_are_as_large_as_the_bound_says() -> None:
    """Forty times the same flights with other noise: errors over spread have mean 0 and spread 1."""
    known, noise = flights(), np.random.default_rng(5)
    errors = []
    for _ in range(40):
        found = flown(Law.BOTH, known, noise)
        spread = np.sqrt(np.diag(found.covariance))
        errors.append([getattr(found.striker, name) - getattr(TRUTH, name) for name in found.fitted] / spread)
    assert np.abs(np.mean(errors, axis=0)) == pytest.approx(0.0, abs=0.5)  # 3 of 1/√40
    assert np.std(errors, axis=0) == pytest.approx(1.0, abs=0.35)


def test_a_flight_of_another_law_is_left_out() -> None:
    """One in which the striker is knocked: as if it were not there."""
    known = flights()
    knocked = [*known, replace(known[3], z_m_s2=known[3].z_m_s2 + np.linspace(0.0, 3.0, 500) ** 2)]
    found = flown(Law.BOTH, knocked, np.random.default_rng(5))
    assert found.striker.damping_1_s == pytest.approx(TRUTH.damping_1_s, rel=0.1)
    assert not found.says[-1].any()


def test_a_flight_that_begins_stuck_is_no_error() -> None:
    """Friction holds it at once: how fast it began has no derivative."""
    known = flights()
    table = side_by_side([(one, ~one.still) for one in known])
    x0, v0 = np.full(12, 0.003), np.full(12, -1e-9)
    resting = reading(table, TRUTH, moved(table, TRUTH, NO_RISE, x0, v0))
    seen = [*known, replace(known[0], z_m_s2=resting[:, 0])]
    masks = [~one.still for one in seen]
    masks[-1] = np.arange(500) >= 20
    found = fly(seen, masks, Law.BOTH, TRUTH, NO_RISE)
    assert found.striker.stiffness_1_s2 == pytest.approx(TRUTH.stiffness_1_s2, rel=1e-3)
    of_stuck = np.linalg.eigvalsh(found.says[-1])
    assert of_stuck[0] >= -1e-6 * np.linalg.eigvalsh(found.says[0])[-1]


def test_what_a_law_has_not_stays_as_it_was() -> None:
    found = flown(Law.VISCOUS, flights(), np.random.default_rng(5))
    assert found.striker.dry_m_s2 == 0.5
    assert set(spreads(found, 20, np.random.default_rng(1))) == set(FITTED[Law.VISCOUS])


@pytest.mark.parametrize("name", FITTED[Law.BOTH])
def test_derivatives_are_differences(name: str) -> None:
    known = flights(3)
    table = side_by_side([(one, ~one.still) for one in known])
    x0, v0 = np.array([0.02, 0.03, 0.05]), np.array([-0.6, -0.5, -0.4])
    step = 1e-5 * abs(getattr(TRUTH, name))

    def seen(by: float) -> np.ndarray:
        striker = TRUTH._replace(**{name: getattr(TRUTH, name) + by})
        return reading(table, striker, moved(table, striker, NO_RISE, x0, v0))

    analytic = derivatives(table, TRUTH, moved(table, TRUTH, NO_RISE, x0, v0), (name,))[0]
    differences = (seen(step) - seen(-step)) / (2.0 * step)
    # A tick in which v turns has the change of sign itself.
    assert np.median(np.abs(analytic - differences)) < 2e-3 * np.max(np.abs(analytic))
    assert np.quantile(np.abs(analytic - differences), 0.99) < 1e-2 * np.max(np.abs(analytic))
