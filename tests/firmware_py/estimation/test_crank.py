import math
from collections.abc import Callable

import numpy as np
import pytest

from firmware_py.core.estimation import crank
from firmware_py.core.inputs import EncoderInput
from firmware_py.core.numbers import TAU, wrap_pi
from firmware_py.interface.arrivals import NEVER_TICKS, NOTHING_YET, Arrival, Now, accept, age
from firmware_py.interface.frame import ACCEPTED
from firmware_py.interface.generated.kinds import ENCODER_ESTIMATES
from firmware_py.shell.parameters import config_from

CONFIG = config_from({})
OMEGA_RAD_S = 12.0
TICKS = 1200


def follow(
    position_rev: np.ndarray, velocity_rev_s: float = 0.0, acceleration: float = 0.0
) -> list[crank.CrankState]:
    state, states = crank.INITIAL, []
    for position in position_rev:
        state = crank.step(
            CONFIG.crank,
            state,
            crank.read(CONFIG.crank, EncoderInput(float(position), velocity_rev_s, 0, 1)),
            acceleration,
        )
        states.append(state)
    return states


def test_constant_speed_is_followed_without_lag() -> None:
    t = np.arange(2000) * 1e-3
    last = follow(12.0 * t / TAU)[-1]
    assert last.omega_rad_s == pytest.approx(12.0, rel=1e-6)
    assert wrap_pi(last.angle_rad - 12.0 * t[-1]) == pytest.approx(0.0, abs=1e-9)


def test_a_circular_and_a_running_count_give_the_same() -> None:
    turns = 12.0 * np.arange(3000) * 1e-3 / TAU
    running, circular, far = follow(turns), follow(turns % 1.0), follow(turns + 5000.0)
    np.testing.assert_allclose(
        [s.omega_rad_s for s in running], [s.omega_rad_s for s in circular], rtol=0, atol=1e-6
    )
    np.testing.assert_allclose([s.omega_rad_s for s in far], [s.omega_rad_s for s in circular], atol=1e-3)


def test_an_unknown_acceleration_becomes_the_disturbance() -> None:
    t = np.arange(1000) * 1e-3
    last = follow(0.5 * 40.0 * t * t / TAU)[-1]
    assert last.disturbance_rad_s2 == pytest.approx(40.0, rel=1e-3)
    assert last.omega_rad_s == pytest.approx(40.0 * t[-1], rel=1e-4)
    known = follow(0.5 * 40.0 * t * t / TAU, acceleration=40.0)[-1]
    assert known.disturbance_rad_s2 == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("every", [2, 10, 25])
def test_few_readings_are_followed_as_fast_as_many(every: int) -> None:
    t = np.arange(300) * 1e-3
    state = crank.INITIAL
    for tick, position in enumerate(0.5 * 40.0 * t * t / TAU):
        age = tick % every
        state = crank.step(
            CONFIG.crank,
            state,
            crank.read(CONFIG.crank, EncoderInput(float(position), 0.0, age, 1)),
            0.0,
        )
    assert state.disturbance_rad_s2 == pytest.approx(40.0, rel=1e-3)
    assert state.omega_rad_s == pytest.approx(40.0 * t[-1], rel=1e-3)


def jittering(dice: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A firmware that wakes up to a tick late for 0.1 s."""
    late = np.zeros(TICKS)
    late[800:900] = dice.uniform(0.0, 1.0, 100)
    return np.arange(TICKS) + 0.5 + late, np.arange(TICKS) + 0.0


def bundled(_: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """An adapter that hands over two readings in every second tick."""
    return np.arange(TICKS) + 0.5, np.arange(TICKS) // 2 * 2 + 1.0


def late(_: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Readings that come three ticks late for 0.1 s; those that are overtaken come after the timely ones."""
    numbers = np.arange(TICKS)
    return numbers + 0.5, numbers + np.where((numbers >= 800) & (numbers < 900), 3.0, 0.0)


def lost(dice: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Half of the readings are lost for 0.1 s."""
    numbers = np.arange(TICKS)
    is_lost = (numbers >= 800) & (numbers < 900) & (dice.uniform(size=TICKS) < 0.5)
    return numbers + 0.5, np.where(is_lost, np.inf, numbers)


def twice(_: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Half of the readings come twice."""
    return np.arange(TICKS) + 0.5, np.concatenate((np.arange(TICKS) + 0.0, np.arange(TICKS // 2) + 0.1))


def follow_frames(dice: np.random.Generator, ticks: np.ndarray, arrivals: np.ndarray) -> np.ndarray:
    """Errors of the angle in ticks; each tick has a reading, and those after the last one are repetitions."""
    turned_rad = OMEGA_RAD_S * 1e-3 * (np.arange(len(arrivals)) % len(ticks))
    position_rev = turned_rad / TAU + dice.normal(0.0, 2e-5, len(arrivals))
    order = [int(number) for number in np.argsort(arrivals, kind="stable")]
    arrival, state, errors, place = Arrival(), crank.INITIAL, [], 0
    for tick, at in enumerate(ticks):
        while place < len(order) and arrivals[order[place]] < at:
            word, now = order[place] % len(ticks), Now(tick, 1e-3)
            arrival, _, _ = accept(arrival, NOTHING_YET, ENCODER_ESTIMATES, ACCEPTED, word, now)
            place += 1
        encoder = EncoderInput(float(position_rev[arrival.word]), 0.0, age(tick, arrival), arrival.counter)
        state = crank.step(CONFIG.crank, state, crank.read(CONFIG.crank, encoder), 0.0)
        errors.append(wrap_pi(state.angle_rad - OMEGA_RAD_S * 1e-3 * (at - 0.5)) / (OMEGA_RAD_S * 1e-3))
    return np.array(errors)


@pytest.mark.parametrize("arriving", [jittering, bundled, late, lost, twice])
def test_the_age_of_a_reading_is_known_from_the_number_of_frames(arriving: Callable) -> None:
    """A tracker that loses a tick beside the readings does not come back."""
    for seed in range(20):
        dice = np.random.default_rng(seed)
        ticks, arrivals = arriving(dice)
        errors = follow_frames(dice, ticks, arrivals) + ticks - np.arange(TICKS) - 0.5
        assert np.abs(errors[500:]).max() < 0.25
        assert abs(errors[-1]) < 0.05


@pytest.mark.parametrize("late_share", [0.0, 0.001, 0.01])
@pytest.mark.parametrize("drift", [2e-4, -2e-4, -2e-5])
def test_clocks_that_drift_apart_do_not_carry_the_angle_away(drift: float, late_share: float) -> None:
    """Nor if the firmware wakes up to a tick late now and then; in such a tick the crank is further on."""
    numbers, dice = np.arange(30_000), np.random.default_rng(1)
    is_late = dice.random(30_000) < late_share
    wakes = numbers * (1.0 + drift) + 0.5 + dice.uniform(0.0, 1.0, 30_000) * is_late
    errors = follow_frames(dice, np.maximum.accumulate(wakes), numbers)[500:]
    assert np.abs(errors[~is_late[500:]]).max() < 1.2


def test_gains_after_missed_readings_are_those_of_the_longer_interval() -> None:
    g, h, k = crank.critically_damped_gains(CONFIG.p.crank.bandwidth_rad_s, 3e-3)
    state = crank.INITIAL._replace(angle_rad=0.1, missed_ticks=2)
    after = crank.step(CONFIG.crank, state, crank.read(CONFIG.crank, EncoderInput(0.2 / TAU, 0.0, 0, 1)), 0.0)
    e = 0.1
    assert after.angle_rad == pytest.approx(0.1 + g * e)
    assert after.omega_rad_s == pytest.approx(h * e / 3e-3)
    assert after.disturbance_rad_s2 == pytest.approx(2.0 * k * e / 9e-6)


def test_the_tracker_has_a_triple_pole() -> None:
    T = 1e-3
    g, h, k = crank.critically_damped_gains(200.0, T)
    f = np.array([[1.0, T, T * T / 2], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
    poles = np.linalg.eigvals((np.eye(3) - np.outer([g, h / T, 2 * k / T**2], [1, 0, 0])) @ f)
    np.testing.assert_allclose(poles, math.exp(-200.0 * T), atol=1e-4)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e30])
def test_what_is_no_position_is_a_missing_one(bad: float) -> None:
    turns = 12.0 * np.arange(500) * 1e-3 / TAU
    state = follow(turns)[-1]
    missed = crank.step(CONFIG.crank, state, crank.read(CONFIG.crank, EncoderInput(bad, 0.0, 0, 1)), 0.0)
    assert missed.missed_ticks == 1
    assert missed.omega_rad_s == pytest.approx(12.0, rel=1e-3)
    assert wrap_pi(missed.angle_rad - state.angle_rad) == pytest.approx(0.012, rel=1e-2)


def test_gaps_are_bridged_and_counted() -> None:
    state = follow(12.0 * np.arange(500) * 1e-3 / TAU)[-1]
    for _ in range(10):
        state = crank.step(CONFIG.crank, state, crank.read(CONFIG.crank, EncoderInput(0.0, 0.0, 5, 1)), 0.0)
    assert state.missed_ticks == 10


def test_nothing_is_known_before_the_first_reading() -> None:
    state = crank.step(
        CONFIG.crank,
        crank.INITIAL,
        crank.read(CONFIG.crank, EncoderInput(0.3, 0.0, NEVER_TICKS, 1)),
        0.0,
    )
    assert state == crank.INITIAL
    first = crank.step(CONFIG.crank, state, crank.read(CONFIG.crank, EncoderInput(0.25, 2.0, 0, 1)), 0.0)
    assert first.angle_rad == pytest.approx(math.pi / 2)
    assert first.omega_rad_s == pytest.approx(2.0 * TAU)


def test_losses_and_load_are_against_the_motion_and_the_acceleration_has_a_bound() -> None:
    motor = CONFIG.p.motor
    for omega_rad_s in (12.0, -12.0, 0.3, -0.3):
        lost_n_m = motor.viscous_n_m_s * omega_rad_s + math.copysign(motor.dry_n_m, omega_rad_s)
        turning = crank.INITIAL._replace(omega_rad_s=omega_rad_s)
        found = crank.known_acceleration(CONFIG.crank, 0.1, turning, -0.02)
        assert found == pytest.approx((0.1 - lost_n_m + 0.02) / motor.inertia_kg_m2, rel=1e-9)
    most_rad_s2 = 2.0 * CONFIG.p.speed.torque_limit_n_m / motor.inertia_kg_m2
    assert crank.known_acceleration(CONFIG.crank, 9.0, turning, 0.0) == most_rad_s2


def test_a_standing_crank_is_not_estimated_to_move_by_less_than_its_dry_friction() -> None:
    assert crank.known_acceleration(CONFIG.crank, 0.004, crank.INITIAL, 0.1) == 0.0
    breaking_away_n_m = 2.1 * CONFIG.p.motor.dry_n_m
    found = crank.known_acceleration(CONFIG.crank, breaking_away_n_m, crank.INITIAL, 0.0)
    assert found == pytest.approx(breaking_away_n_m / CONFIG.p.motor.inertia_kg_m2)
