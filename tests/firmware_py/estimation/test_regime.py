import math

import pytest

from firmware_py.core.estimation import crank, regime
from firmware_py.core.estimation.detector import FLYING
from firmware_py.core.estimation.estimator_state import Contact
from firmware_py.core.estimation.regime import Period
from firmware_py.interface.enums import Regime

OMEGA = 12.0


def hit(speed: float = 0.9, impacts: int = 1) -> Period:
    return Period(impacts, speed, 0.5, 300.0)


MISS = Period(0, 0.0, 0.0, 10.0)
STILL = Period(0, 0.0, 0.0, 0.3)


@pytest.mark.parametrize(
    ("periods", "expected"),
    [
        ([hit(), hit(), hit(), hit()], Regime.IMPACT),
        ([hit(), hit(), MISS, MISS], Regime.IMPACT),
        ([hit(impacts=2), hit(impacts=2), hit(impacts=2), hit(impacts=2)], Regime.IMPACT),
        ([MISS] * 4, Regime.NON_IMPACT),
        ([STILL] * 4, Regime.STUCK),
        ([hit(), MISS, hit(), MISS], Regime.PERIOD_N),
        ([MISS, hit(), MISS, hit()], Regime.PERIOD_N),
        ([hit(0.9), hit(0.5), hit(0.9), hit(0.5)], Regime.PERIOD_N),
        ([hit(impacts=2), hit(), hit(impacts=2), hit()], Regime.PERIOD_N),
        ([hit(), MISS, MISS, hit()], Regime.PERIOD_N),
        ([hit(impacts=6), hit(impacts=5), hit(impacts=6), hit(impacts=5)], Regime.CHATTERING),
        ([hit(0.03), hit(0.03), hit(0.03), hit(0.03)], Regime.UNCERTAIN),
        ([hit(), MISS, MISS, MISS], Regime.UNCERTAIN),
        ([hit(impacts=3), hit(impacts=2), hit(), MISS], Regime.UNCERTAIN),
    ],
)
def test_four_periods_decide(periods: list[Period], expected: Regime) -> None:
    assert regime.decide(*periods) == expected


def step(
    state: regime.RegimeState,
    angle_rad: float,
    omega_rad_s: float,
    contact: Contact = FLYING,
    acceleration_m_s2: float = 0.1,
) -> regime.RegimeState:
    turning = crank.INITIAL._replace(angle_rad=angle_rad, omega_rad_s=omega_rad_s)
    return regime.step(state, turning, contact, acceleration_m_s2)


def turn(
    state: regime.RegimeState, impacts: int, speed: float = 0.9, phase_deg: float = 48.0
) -> regime.RegimeState:
    """One drive period at constant speed, with `impacts` that many degrees past the forward dead centre."""
    ticks = round(2 * math.pi / OMEGA * 1000)
    at = math.radians(90.0 + phase_deg)
    places = [at + 0.1 * i for i in range(impacts)]
    for tick in range(ticks):
        angle = 2 * math.pi * tick / ticks
        touch = any(angle - 2 * math.pi / ticks < place <= angle for place in places)
        state = step(
            state, angle, OMEGA, Contact(touch, False, 0.0, speed, True, True), -250.0 if touch else 20.0
        )
    return state


def settled() -> regime.RegimeState:
    """After six turns with one impact each."""
    state = regime.INITIAL
    for _ in range(6):
        state = turn(state, 1)
    return state


def test_a_steady_motion_is_reported_with_its_phase_and_peak() -> None:
    state = settled()
    assert state.regime == Regime.IMPACT
    assert math.degrees(state.last.phase_rad) == pytest.approx(48.0, abs=1.0)
    assert state.last.peak_m_s2 == 250.0
    assert state.last.speed_m_s == pytest.approx(0.9)


def test_one_odd_period_does_not_change_the_report() -> None:
    state = regime.INITIAL
    for impacts in (1, 1, 1, 1, 1, 2, 1, 1):
        state = turn(state, impacts)
        if impacts == 2:
            assert state.regime == Regime.IMPACT
    assert state.regime == Regime.IMPACT


def test_impacts_that_stop_are_lost_first_and_then_gone() -> None:
    state, seen = regime.INITIAL, []
    for impacts in (1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0):
        state = turn(state, impacts)
        seen.append(state.regime)
    assert Regime.LOST in seen
    assert seen[-1] == Regime.NON_IMPACT
    assert seen.index(Regime.LOST) <= 8


def test_every_period_ends_once() -> None:
    state, ended = regime.INITIAL, 0
    for _ in range(5):
        before = state.periods
        state = turn(state, 1)
        ended += state.periods - before
    assert ended == 4  # the fifth ends with the next turn's first tick


@pytest.mark.parametrize("omega", [0.0, -OMEGA, 0.99 * regime.SLOWEST_RAD_S, math.nan])
def test_a_crank_that_stands_has_no_regime(omega: float) -> None:
    state = settled()
    assert state.regime == Regime.IMPACT
    state = step(state, 1.0, omega)
    assert state == regime.INITIAL._replace(angle_rad=1.0)


def test_the_slowest_crank_that_turns_keeps_its_regime() -> None:
    state = settled()
    state = step(state, 1.0, regime.SLOWEST_RAD_S)
    assert state.regime == Regime.IMPACT


def test_an_encoder_that_flickers_about_zero_at_rest_ends_no_period() -> None:
    state = regime.INITIAL
    for tick in range(20):
        angle = 1e-3 if tick % 2 else 2.0 * math.pi - 1e-3
        state = step(state, angle, 0.0)
        assert not state.ended
    assert state.periods == 0


def test_after_a_stand_a_regime_is_found_anew() -> None:
    state = settled()
    state = step(state, 0.0, 0.0)
    seen = []
    for _ in range(6):
        state = turn(state, 0)
        seen.append(state.regime)
    assert seen[0] == Regime.UNCERTAIN
    assert seen[-1] == Regime.NON_IMPACT
    assert Regime.LOST not in seen
