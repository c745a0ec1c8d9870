"""Identification: its algebra against numpy, the whole of it against modules that are not nominal."""

import math
from functools import cache

import numpy as np
import pytest
from closed_loop import Bench, scene_with

from firmware_py.core.estimation import estimator_state, identify
from firmware_py.core.estimation.identify import IdentifyState, Normal, Sample
from firmware_py.interface.enums import Mode
from firmware_py.shell.parameters import config_from

CONFIG = config_from({}).identify
STRIKER = config_from({}).estimator.striker


def summed(rows: np.ndarray) -> identify.Sums:
    """The sums over rows (t, a, f, y)."""
    sums = identify._NO_SUMS
    for row in rows:
        sums = identify._added(sums, Sample(*(float(value) for value in row)))
    return sums


def test_a_parabola_is_taken_out_as_least_squares_does() -> None:
    random = np.random.default_rng(1)
    t = np.sort(random.uniform(0.0, 0.6, 40))
    rows = np.column_stack(
        [t, random.normal(0.0, 3.0, 40), random.normal(1.0, 0.2, 40), random.normal(5.0, 1.0, 40)]
    )
    normal, rest = identify.without_parabola(summed(rows))
    parabola = np.column_stack([np.ones(40), t, t * t])
    a, f, y = (c - parabola @ np.linalg.lstsq(parabola, c, rcond=None)[0] for c in rows[:, 1:].T)
    assert normal == pytest.approx((a @ a, a @ f, f @ f, a @ y, f @ y), rel=1e-9)
    assert rest == pytest.approx(y @ y, rel=1e-9)


def test_spring_and_friction_come_out_of_what_was_put_in_whatever_the_parabola() -> None:
    t = np.arange(0.0, 0.55, 0.01)
    a, f = 5.0 * np.sin(10.0 * t), 0.2 * np.cos(10.0 * t)
    y = 0.02 * a - 0.2 * f + 0.3 - 2.0 * t + 1.5 * t * t
    normal, _ = identify.without_parabola(summed(np.column_stack([t, a, f, y])))
    many = Normal(*(1e4 * value for value in normal))
    assert identify.solved(CONFIG, many) == pytest.approx((0.02, -0.2), rel=1e-3)


def test_what_is_identified_is_bounded_and_nothing_seen_says_nothing() -> None:
    assert identify.solved(CONFIG, identify.INITIAL.normal) == (0.0, 0.0)
    assert identify.solved(CONFIG, Normal(1e6, 0.0, 1e6, 1e6, -1e6)) == (
        identify.LARGEST_SPRING,
        -identify.LARGEST_FRICTION,
    )
    assert identify.solved(CONFIG, Normal(*[math.nan] * 5)) == (0.0, 0.0)


def flight(push: float = 0.0, spring: float = 0.02) -> identify.Sums:
    t = np.arange(0.0, 0.55, 0.01)
    a, f = 5.0 * np.sin(10.0 * t), 0.2 * np.cos(10.0 * t)
    pushed = push * ((t > 0.2) & (t < 0.25))
    return summed(np.column_stack([t, a, f, spring * a + pushed]))


def after(state: IdentifyState, sums: identify.Sums) -> IdentifyState:
    return identify._flown(CONFIG, state._replace(sums=sums))


def test_a_flight_with_a_push_is_left_out() -> None:
    state = after(identify.INITIAL, flight(push=5.0))
    assert state == identify.INITIAL
    assert after(identify.INITIAL, flight()).flights == 1


def test_only_what_explains_new_flights_better_is_fed() -> None:
    state = identify.INITIAL
    for _ in range(identify.FEWEST_FLIGHTS):
        state = after(state, flight())
    assert state.spring == pytest.approx(0.02, abs=2e-3)
    assert identify.trusted(CONFIG, state)
    assert not identify.trusted(CONFIG._replace(feeds=False), state)
    # Flights that contradict each other explain nothing.
    state = identify.INITIAL
    for n in range(2 * identify.FEWEST_FLIGHTS):
        state = after(state, flight(spring=0.02 if n % 2 else -0.02))
    assert not identify.trusted(CONFIG, state)


def test_the_model_follows_slowly_and_goes_back_where_nothing_is_held() -> None:
    state = identify.INITIAL._replace(flights=100, gain=1.0, spring=0.02, friction=-0.3)
    estimate = estimator_state.INITIAL
    for n in range(1, 30):
        estimate = identify.towards(CONFIG, state, True, estimate)
        assert estimate.spring_share == pytest.approx(min(n * CONFIG.spring_step, 0.02))
        assert estimate.friction_share == pytest.approx(max(-n * CONFIG.friction_step, -0.3))
    for _ in range(30):
        estimate = identify.towards(CONFIG, state, False, estimate)
    assert (estimate.spring_share, estimate.friction_share) == (0.0, 0.0)


WET = (
    {},
    scene_with(
        striker={"spring_n_m": 68.6}, friction={"law": "viscous", "b_n_s_m": 0.26}, stop={"restitution": 0.45}
    ),
)
DRY = (
    {"friction.mu": 0.2, "friction.b_n_s_m": 0.0, "drive.amplitude_m": 0.03},
    scene_with(
        striker={"spring_n_m": 71.0}, drive={"amplitude_m": 0.03}, friction={"law": "coulomb", "mu": 0.19}
    ),
)


@cache
def held(dry: bool, mode: int) -> Bench:
    """A module that is not nominal, 22 s from the start on; its last 6 s are kept."""
    parameters, scene = DRY if dry else WET
    bench = Bench({**parameters, "identify.mode": mode}, scene, ratio=0.95 if dry else 1.1).started()
    bench.run(16.0, keep=False)
    assert bench.node.outputs.mode == Mode.RUN
    bench.run(6.0)
    return bench


@pytest.mark.parametrize(("dry", "spring", "friction"), [(False, -0.02, 0.3), (True, 1.0 / 70.0, -0.05)])
def test_the_truth_is_found(dry: bool, spring: float, friction: float) -> None:
    state = held(dry, 2).node.state
    assert state.identify.spring == pytest.approx(spring, abs=0.003)
    assert state.identify.friction == pytest.approx(friction, abs=0.08)
    assert state.estimator.spring_share == pytest.approx(state.identify.spring, abs=1e-6)


def rms_mm(bench: Bench) -> float:
    errors_m = bench.column(lambda s, _, m: s.estimator.x_m - m.x_m)[-6000:]
    return 1e3 * float(np.sqrt(np.mean(errors_m**2)))


@pytest.mark.parametrize("dry", [False, True])
def test_with_the_identified_force_the_estimate_is_better_and_without_feeding_it_unchanged(dry: bool) -> None:
    off, identified, fed = (held(dry, mode) for mode in range(3))
    assert rms_mm(fed) < 0.9 * rms_mm(off)
    assert rms_mm(identified) == rms_mm(off)
    assert identified.node.state.identify.spring != 0.0
    assert off.node.state.identify == identify.INITIAL
    assert off.node.state.estimator.flight == estimator_state.NO_FLIGHT
