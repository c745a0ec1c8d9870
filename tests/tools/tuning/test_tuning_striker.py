"""The most likely striker: found back from flights of its own, as well as the Cramér–Rao bound says."""

import numpy as np
import pytest

from firmware_py.core.estimation.striker_model import free_flight
from tools.tuning.identification.first_values import Linear, fit_signed, linear
from tools.tuning.identification.flights import Flight
from tools.tuning.identification.friction_laws import FITTED, V0, Law, Striker
from tools.tuning.identification.striker import Fit, Samples, fit, fits, simplest

T = 1e-3
STRIKERS = {
    Law.VISCOUS: Striker(87.5, 0.025, -0.2, 0.25),
    Law.COULOMB: Striker(87.5, 0.025, -0.2, 0.0, 0.6),
    Law.BOTH: Striker(87.5, 0.025, -0.2, 0.125, 0.49),
    Law.STRIBECK: Striker(87.5, 0.025, -0.2, 0.0, 0.4, 0.2, 0.06, 2.0),
}
TRUTH = STRIKERS[Law.BOTH]
NOISE_M_S2 = 0.0145


def crank_of(number: int, count: int) -> np.ndarray:
    """Half a second, at speeds between r = 0.5 and 1.3."""
    return np.sin(9.35 * (0.5 + 0.8 * number / count) * np.arange(500) * T + 0.7 * number)


def flights(
    truth: Striker = TRUTH, noise: np.random.Generator | None = None, count: int = 12, scale: float = 1.0
) -> list[Flight]:
    t = np.arange(500) * T
    still = np.zeros(500, bool)
    empty = [
        Flight(0, 500, t, np.zeros(500), crank_of(number, count), np.zeros(500), still, None)
        for number in range(count)
    ]
    states = np.column_stack([np.linspace(0.02, 0.06, count), np.linspace(-0.7, -0.3, count)])
    _, left, _ = Samples(empty, [~still] * count, states).fly(truth, states, ())
    z = -left.reshape(count, 500)
    if noise is not None:
        z = z + scale * NOISE_M_S2 * noise.standard_normal(z.shape)
    return [with_reading(one, z[place]) for place, one in enumerate(empty)]


def with_reading(one: Flight, z: np.ndarray) -> Flight:
    return Flight(one.begin, one.end, one.t_s, z, one.crank, one.cosine, one.still, one.contact)


def first_of(known: list[Flight]) -> Linear:
    return fit_signed(known, [np.cumsum(one.z_m_s2 - np.mean(one.z_m_s2)) * T for one in known])


def fitted(known: list[Flight], law: Law = Law.BOTH) -> Fit:
    first = first_of(known)
    return fit(Samples(known, first.used, first.states), law, linear(known, first.speeds_m_s, law).striker)


@pytest.mark.parametrize("law", Law)
def test_the_law_and_the_striker_are_found_back(law: Law) -> None:
    known = flights(STRIKERS[law], np.random.default_rng(2), scale=0.01)
    _, found = fits(known, first_of(known))
    assert simplest(found) == law
    for name in FITTED[law]:
        assert getattr(found[law].striker, name) == pytest.approx(getattr(STRIKERS[law], name), rel=2e-3)


def test_the_motion_is_that_of_a_hundred_times_smaller_ticks() -> None:
    """Up to where v changes its sign, friction's mean over a tick is exact, and the crank's within (Ω T)²."""
    striker = STRIKERS[Law.BOTH]
    state = np.array([[0.05, 0.4]])
    t = np.arange(40) * T
    one = Flight(0, 40, t, np.zeros(40), np.sin(9.0 * t), np.cos(9.0 * t), np.zeros(40, bool), None)
    motion, _, _ = Samples([one], [~one.still], state).fly(striker, state, ())
    x, v = state[0]
    step = free_flight(striker.stiffness_1_s2, striker.damping_1_s, T / 100)
    for number in range(3900):
        rest = striker.amplitude_m * np.sin(9.0 * (number + 0.5) * T / 100)
        rest -= striker.dry_m_s2 * np.sign(v) / striker.stiffness_1_s2
        x, v = step.x_x * (x - rest) + step.x_v * v + rest, step.v_x * (x - rest) + step.v_v * v
    assert motion[-1] == pytest.approx([x, v], abs=1e-6)


SLOW = Flight(
    0,
    3000,
    np.arange(3000) * T,
    np.zeros(3000),
    *(f(3.0 * np.arange(3000) * T) for f in (np.sin, np.cos)),
    np.zeros(3000, bool),
    None,
)
"""A turn and a half of a crank whose spring exceeds dry friction for a part of the turn."""


@pytest.mark.parametrize("law", [Law.COULOMB, Law.STRIBECK])
def test_a_striker_that_sticks_and_slips_moves_as_with_a_hundred_times_smaller_ticks(law: Law) -> None:
    striker = STRIKERS[law]._replace(dry_m_s2=1.6)
    motion, left, _ = Samples([SLOW], [~SLOW.still], np.zeros((1, 2))).fly(striker, np.zeros((1, 2)), ())
    k, f, h, small = striker.stiffness_1_s2, striker.dry_m_s2, striker.rise_m_s2, T / 100
    x, v, moved = 0.0, 0.0, []
    for number in range(299_900):
        if number % 100 == 0:
            moved.append((x, v))
        pull = -k * (x - striker.amplitude_m * np.sin(3.0 * number * small))
        if v == 0.0 and abs(pull) <= f + h:
            continue
        sign = np.sign(v if v != 0.0 else pull)
        rise = h * np.exp(-((abs(v) / striker.v_s_m_s) ** striker.delta))
        faster = v + small * (pull - sign * (f + rise))
        x, v = x + small * faster, faster if faster * sign > 0.0 else 0.0
    known = np.array(moved)
    rests = known[:, 1] == 0.0
    assert 0.2 < np.mean(rests) < 0.8
    assert motion[: len(known)] == pytest.approx(known, abs=0.01 * np.max(np.abs(known[:, 1])))
    assert np.all(left[: len(known)][rests & (motion[: len(known), 1] == 0.0)] == -striker.offset_m_s2)


def test_a_flight_that_grazed_the_stop_unseen_is_left_out() -> None:
    """It lost 3 mm/s within a tick: its mean squared residual is 1.6 times the others'."""
    known = flights(count=24)
    bumped, noise = known[7], np.random.default_rng(8)
    halves = [
        Flight(0, 250, bumped.t_s[:250], np.zeros(250), crank, np.zeros(250), np.zeros(250, bool), None)
        for crank in (bumped.crank[:250], bumped.crank[250:])
    ]
    ones = [~one.still for one in halves]
    begun = np.array([[0.02 + 0.04 * 7 / 23, -0.7 + 0.4 * 7 / 23], [0.0, 0.0]])
    motion, first, _ = Samples(halves, ones, begun).fly(TRUTH, begun, ())
    begun[1] = [motion[249, 0] + T * motion[249, 1], motion[249, 1] - T * first[249] - 0.003]
    _, left, _ = Samples(halves, ones, begun).fly(TRUTH, begun, ())
    known[7] = with_reading(bumped, -left)
    noisy = [
        with_reading(one, one.z_m_s2 + NOISE_M_S2 * noise.standard_normal(len(one.z_m_s2))) for one in known
    ]
    samples, _ = fits(noisy, first_of(noisy))
    assert np.flatnonzero(samples.sums(samples.used.astype(float)) == 0.0).tolist() == [7]


def test_the_errors_are_as_large_as_the_bound_says() -> None:
    """Forty times the same flights with other noise: errors over spread have mean 0 and spread 1."""
    noise = np.random.default_rng(5)
    errors = []
    for _ in range(40):
        found = fitted(flights(noise=noise))
        errors.append(
            [
                (getattr(found.striker, name) - getattr(TRUTH, name)) / found.spread[name]
                for name in FITTED[Law.BOTH]
            ]
        )
    assert np.abs(np.mean(errors, axis=0)) == pytest.approx(0.0, abs=0.5)  # 3 of 1/√40
    assert np.std(errors, axis=0) == pytest.approx(1.0, abs=0.35)


def test_a_flight_of_another_law_is_left_out() -> None:
    """One in which the striker is knocked: as if it were not there."""
    known = flights(noise=np.random.default_rng(5))
    knocked = [*known, with_reading(known[3], known[3].z_m_s2 + np.linspace(0.0, 3.0, 500) ** 2)]
    samples, found = fits(knocked, first_of(knocked))
    assert found[Law.BOTH].striker.damping_1_s == pytest.approx(TRUTH.damping_1_s, rel=0.1)
    assert not samples.used[samples.starts[-2] :].any()


def test_a_flight_that_begins_stuck_is_no_error() -> None:
    """Friction holds it at once: its initial velocity has no derivative."""
    known = flights()
    states = np.array([[0.003, -1e-9]])
    _, left, _ = Samples(known[:1], [~known[0].still], states).fly(TRUTH, states, ())
    seen = [*known, with_reading(known[0], known[0].z_m_s2 - left)]
    first = first_of(known)
    used = [*first.used, np.arange(500) >= 20]
    found = fit(Samples(seen, used, np.vstack([first.states, states])), Law.BOTH, first.striker)
    assert found.striker.stiffness_1_s2 == pytest.approx(TRUTH.stiffness_1_s2, rel=1e-3)


@pytest.mark.parametrize(
    ("law", "name", "sticks"),
    [(law, name, sticks) for law in (Law.BOTH, Law.STRIBECK) for name in FITTED[law] for sticks in (0, 1)],
)
def test_derivatives_are_differences(law: Law, name: str, sticks: int) -> None:
    known, truth = flights(count=3), STRIKERS[law]
    states = np.array([[0.02, -0.6], [0.03, -0.5], [0.05, -0.4]])
    if sticks:
        known, truth, states = [SLOW], truth._replace(dry_m_s2=1.6), np.zeros((1, 2))
    samples = Samples(known, [~one.still for one in known], states)
    step = 1e-5 * abs(getattr(truth, name))

    def left(by: float) -> np.ndarray:
        return samples.fly(truth._replace(**{name: getattr(truth, name) + by}), states, ())[1]

    analytic = samples.fly(truth, states, [Striker._fields.index(name)])[2][:, 0]
    differences = (left(-step) - left(step)) / (2.0 * step)
    # A tick in which v turns has the change of sign itself.
    assert np.median(np.abs(analytic - differences)) < 5e-3 * np.max(np.abs(analytic))
    assert np.quantile(np.abs(analytic - differences), 0.98) < 2e-2 * np.max(np.abs(analytic))
    if sticks and law == Law.BOTH:  # the striker only stops, without a tick in which v turns
        assert np.quantile(np.abs(analytic - differences), 0.98) < 1e-4 * np.max(np.abs(analytic))


def test_an_initial_speed_of_0_of_a_striker_that_is_held_has_no_effect() -> None:
    """Friction stops a speed that is slightly larger within v²."""
    truth, states = STRIKERS[Law.BOTH]._replace(dry_m_s2=1.6), np.zeros((1, 2))
    rows = Samples([SLOW], [~SLOW.still], states).fly(truth, states, (V0,))[2]
    assert not rows.any()
