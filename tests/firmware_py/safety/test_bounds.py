"""No pattern of impacts, misses, commands or readings keeps the crank moving beyond its bounds."""

import math
from collections.abc import Callable

import pytest

from firmware_py.core.control import spin_down, start
from firmware_py.core.control.start import StartState
from firmware_py.core.estimation import crank, estimator_state, regime
from firmware_py.core.request import Request
from firmware_py.interface.enums import Mode, Refusal
from firmware_py.interface.zeroed import zeroed
from firmware_py.shell.parameters import config_from

CONFIG = config_from({})
GOAL = zeroed(Request, ratio=1.3, refusal=Refusal.NONE, unmet=Refusal.NONE)
PERIOD_TICKS = 500
LONGEST_S = 30.0
HIT, MISS = 1, 0


def ended(impacts: int) -> regime.RegimeState:
    return regime.INITIAL._replace(ended=True, last=regime.INITIAL.last._replace(impacts=impacts))


def started(
    mode: Mode,
    pattern: Callable[[int], int],
    ratio: Callable[[int], float],
    seconds: float,
    state: StartState = start.INITIAL,
) -> list[StartState]:
    """A start with `pattern` of impacts by period and `ratio` requested by tick."""
    states = []
    for tick in range(0, round(1000 * seconds)):
        period = tick // PERIOD_TICKS
        what = ended(pattern(period)) if tick % PERIOD_TICKS == 0 else regime.INITIAL
        state = start.step(
            CONFIG.p, CONFIG.nominal, state, mode, GOAL._replace(ratio=ratio(tick)), True, 0.0, what
        )
        states.append(state)
    return states


def held() -> StartState:
    """In the hold at r = 1.3, captured."""
    state = started(Mode.SOFT_START, lambda _: HIT, lambda _: 1.3, 20.0)[-1]
    assert (state.stage, state.captured) == (start.HOLD, True)
    return state


PATTERNS: dict[str, Callable[[int], int]] = {
    "hit, miss, miss": lambda period: HIT if period % 3 == 0 else MISS,
    "hit, hit, miss, miss": lambda period: HIT if period % 4 < 2 else MISS,
    "always": lambda _: HIT,
    "never": lambda _: MISS,
}
DITHERS: dict[str, Callable[[int], float]] = {
    "still": lambda _: 1.3,
    "by 0.0001": lambda tick: 1.3 + 0.0001 * (tick // 100 % 2),
    "by 0.05": lambda tick: 1.25 + 0.05 * (tick // 100 % 2),
    "by a minute's sweep": lambda tick: 1.0 + 0.3 * (tick / 60_000),
}


EVERY = [(pattern, dither) for pattern in PATTERNS for dither in DITHERS]


def test_a_start_ends_within_30_s() -> None:
    endless = []
    for pattern, dither in EVERY:
        states = started(Mode.SOFT_START, PATTERNS[pattern], DITHERS[dither], LONGEST_S)
        if not any(state.captured or state.failed for state in states):
            endless.append((pattern, dither))
    assert endless == []


def test_impacts_that_are_lost_in_the_hold_are_back_within_30_s_or_it_has_failed() -> None:
    lost = start.dip_again(CONFIG.p, CONFIG.nominal, held(), 0)
    endless = []
    for pattern, dither in EVERY:
        since_s, run, longest_s = 0.0, 0, 0.0
        for tick, state in enumerate(started(Mode.RUN, PATTERNS[pattern], DITHERS[dither], 70.0, lost)):
            if tick % PERIOD_TICKS == 0:
                run = run + 1 if PATTERNS[pattern](tick // PERIOD_TICKS) == HIT else 0
            found = run >= CONFIG.p.start.confirm_periods or state.stage == start.HOLD or state.failed
            since_s = 0.0 if found else since_s + 0.001
            longest_s = max(longest_s, since_s)
        if longest_s > LONGEST_S:
            endless.append((pattern, dither))
    assert endless == []


def test_a_target_that_dithers_by_less_than_a_thousandth_restarts_nothing() -> None:
    states = started(Mode.SOFT_START, PATTERNS["always"], DITHERS["by 0.0001"], 12.0)
    assert states[-1].captured


@pytest.mark.parametrize("dither", ["by 0.05", "by a minute's sweep"])
def test_an_operator_who_goes_on_changing_the_target_is_no_fault(dither: str) -> None:
    states = started(Mode.RUN, PATTERNS["always"], DITHERS[dither], 60.0, held())
    assert not any(state.failed for state in states)


def test_a_stop_begins_at_the_crank_s_speed_where_that_lags_behind_its_target() -> None:
    state = held()._replace(target_omega_rad_s=12.0)
    for omega_rad_s in (-1.0, 0.0, 5.0, 12.0, 15.0):
        stops, omega = state, min(max(omega_rad_s, 0.0), 12.0)
        for _ in range(1100):
            goal = GOAL
            stops = start.step(
                CONFIG.p, CONFIG.nominal, stops, Mode.STOPPING, goal, True, omega_rad_s, regime.INITIAL
            )
            assert stops.target_omega_rad_s <= omega
            omega = stops.target_omega_rad_s
        assert omega == 0.0


@pytest.mark.parametrize("omega_rad_s", [-3.0, 0.0, 2.0, 9.0, 12.0])
def test_no_target_of_a_walk_s_stop_is_above_the_speed_it_began_with(omega_rad_s: float) -> None:
    config = config_from({"gait.follow": 1})
    state = spin_down.INITIAL
    for tick in range(4000):
        # A striker that swings far ahead of the crank asks for the highest speed.
        swing = estimator_state.striker_of(estimator_state.INITIAL)._replace(
            x_m=0.12 + 0.05 * math.cos(0.0094 * tick), v_m_s=-0.47 * math.sin(0.0094 * tick)
        )
        speed_rad_s = omega_rad_s if tick == 0 else state.target_omega_rad_s
        turning_crank = crank.INITIAL._replace(angle_rad=0.005 * tick % math.tau, omega_rad_s=speed_rad_s)
        state = spin_down.step(config.p, config.nominal, state, turning_crank, swing)
        assert abs(state.target_omega_rad_s) <= max(omega_rad_s, 0.0)
