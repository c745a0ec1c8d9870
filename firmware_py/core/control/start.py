"""The start: S-curves of the crank's speed into the impact regime, and back to rest.

Near the fold, a sudden start from rest ends in non-impact motion for every crank phase. The impact regime is
reached only by raising the speed slowly from below, so the speed follows an S-curve

    ω(s) = ω₀ + (ω₁ − ω₀) (3 s² − 2 s³),  s = t / T

with a continuous speed and zero acceleration at both ends. A first S-curve leads quickly to a speed below
resonance, where there are no impacts yet. The second is slow, so that the striker's own transient does not
add to the oscillation at resonance. Impacts in consecutive periods confirm the capture. If the capture fails,
or the impacts are lost later, the speed dips to a ratio at which only the impact regime exists, and rises
again. After a bounded number of attempts the start has failed.
"""

from enum import IntEnum
from typing import NamedTuple

from firmware_py.core.estimation.regime import RegimeState
from firmware_py.core.numbers import at_least
from firmware_py.core.records import zeroed
from firmware_py.interface.enums import RUN, SOFT_START, STOPPING, Mode

DIP_S = 1.0
"""Duration of the S-curve down to the dip."""
SHORTEST_CHANGE_S = 0.5
"""Shortest duration of a change of the target."""


class Stage(IntEnum):
    """The stage of a start or a stop."""

    REST = 0
    RISE = 1
    CONFIRM = 2
    HOLD = 3
    DIP = 4
    DWELL = 5
    STOP = 6
    APPROACH = 7


REST, RISE, CONFIRM, HOLD, DIP, DWELL, STOP, APPROACH = Stage


class StartConfig(NamedTuple):
    """Times of the S-curves; `natural_rad_s` is the nominal ω that ratios refer to."""

    tick_s: float
    natural_rad_s: float
    lowest_ratio: float
    highest_ratio: float
    free_ratio: float
    capture_ratio: float
    dip_ratio: float
    approach_ratio: float
    approach_s: float
    rise_s: float
    again_s: float
    stop_s: float
    confirm_periods: int
    missing_periods: int
    lost_periods: int
    dwell_periods: int
    attempts: int
    retreat_ratio: float


class StartState(NamedTuple):
    """The S-curve runs from `from_rad_s` to `to_rad_s`; `s` is its progress.

    `ceiling_ratio` is the highest ratio at which a curve may end since impacts were lost. `searching_s` is
    the time for which the impacts have been missing.
    """

    stage: Stage
    from_rad_s: float
    to_rad_s: float
    duration_s: float
    s: float
    target_omega_rad_s: float
    target_acceleration_rad_s2: float
    hits: int
    misses: int
    attempts: int
    captured: bool
    failed: bool
    ceiling_ratio: float
    searching_s: float


LONGEST_SEARCH_S = 29.0
"""Longest start, and longest recovery in RUN: 30 s with the second in which the drive closes its axis."""

SMALL_CHANGE = 1e-3
"""Smallest change of the target that begins a new curve, as a share of ω; the hold follows smaller ones."""

NO_CEILING = 10.0
"""A `ceiling_ratio` above every valid ratio: no ceiling."""


INITIAL = zeroed(StartState, stage=REST, duration_s=1.0, s=1.0, ceiling_ratio=NO_CEILING)


def s_curve(s: float) -> tuple[float, float]:
    """Height and slope of the S-curve at progress `s` in 0…1."""
    if s <= 0.0:
        return 0.0, 0.0
    if s >= 1.0:
        return 1.0, 0.0
    return s * s * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s)


def valid_ratio(config: StartConfig, ratio: float) -> bool:
    """Whether the operator's ratio is within the valid range; NaN is not."""
    return config.lowest_ratio <= ratio <= config.highest_ratio


def _curve(
    state: StartState, stage: Stage, from_rad_s: float, to_rad_s: float, duration_s: float, attempts: int
) -> StartState:
    """The state at the beginning of a new S-curve."""
    return state._replace(
        stage=stage,
        from_rad_s=from_rad_s,
        to_rad_s=to_rad_s,
        duration_s=duration_s,
        s=0.0,
        target_omega_rad_s=from_rad_s,
        target_acceleration_rad_s2=0.0,
        hits=0,
        misses=0,
        attempts=attempts,
    )


def _advanced(config: StartConfig, state: StartState, elapsed_ticks: int) -> StartState:
    """The state advanced along the curve; in the hold, which sets its own target, unchanged."""
    if state.stage == HOLD:
        return state
    s = state.s + elapsed_ticks * config.tick_s / state.duration_s
    height, slope = s_curve(s)
    span = state.to_rad_s - state.from_rad_s
    return state._replace(
        s=min(s, 1.0),
        target_omega_rad_s=state.from_rad_s + span * height,
        target_acceleration_rad_s2=span * slope / state.duration_s,
    )


def _counted(state: StartState, regime: RegimeState) -> StartState:
    """Count periods with an impact (from 0 after two in a row without one), and periods without."""
    if not regime.ended:
        return state
    # A single period without an impact may be an outlier, or half of an orbit of period two.
    hit = regime.last.impacts > 0
    odd = not hit and state.misses == 0
    hits = state.hits + 1 if hit else state.hits
    return state._replace(hits=hits if hit or odd else 0, misses=0 if hit else state.misses + 1)


def _at(state: StartState, stage: Stage, hits: int, captured: bool, failed: bool) -> StartState:
    """The state at another stage, with the count of impacts at `hits` and no misses."""
    return state._replace(stage=stage, hits=hits, misses=0, captured=captured, failed=failed)


def _again(config: StartConfig, state: StartState, held_periods: int) -> StartState:
    """Dip for another attempt, which ends a step below the ratio at which the impacts were lost; or fail.

    Each step is longer than the previous one, so that three steps reach a fold that lies far below.
    """
    if state.attempts >= config.attempts:
        return _at(state, state.stage, 0, captured=False, failed=True)
    lost_ratio = min(state.target_omega_rad_s / at_least(config.natural_rad_s, 1e-3), config.free_ratio)
    if state.attempts > 0:
        lost_ratio = min(lost_ratio, state.ceiling_ratio)
    # The first time, if the impacts had lasted long, the speed was not the cause of the loss.
    has_held = held_periods >= 2 * config.confirm_periods and state.attempts == 0
    step_ratio = 0.0 if has_held else config.retreat_ratio * (1 + state.attempts)
    dip_rad_s = config.dip_ratio * config.natural_rad_s
    dip = _curve(state, DIP, state.target_omega_rad_s, dip_rad_s, DIP_S, state.attempts + 1)
    ceiling_ratio = at_least(lost_ratio - step_ratio, config.dip_ratio)
    return dip._replace(captured=False, failed=False, ceiling_ratio=ceiling_ratio)


def retreated(config: StartConfig, state: StartState, target_ratio: float) -> bool:
    """Whether the speed is below the requested one because the impacts were lost at higher speed."""
    highest_ratio = min(target_ratio, config.free_ratio)
    return (
        state.ceiling_ratio < highest_ratio
        and state.target_omega_rad_s < highest_ratio * config.natural_rad_s * (1.0 - 1e-6)
    )


def _begin(config: StartConfig, omega_rad_s: float, goal_rad_s: float) -> StartState:
    """The first S-curve, from the present speed; without the approach if the rise is shorter than that."""
    approach_rad_s = config.approach_ratio * config.natural_rad_s
    if approach_rad_s < goal_rad_s and config.approach_s < config.rise_s:
        return _curve(INITIAL, APPROACH, omega_rad_s, approach_rad_s, config.approach_s, 0)
    return _curve(INITIAL, RISE, omega_rad_s, goal_rad_s, config.rise_s, 0)


def _moved(  # noqa: PLR0911 - stages, read top to bottom
    config: StartConfig,
    state: StartState,
    goal_rad_s: float,
    needs_impacts: bool,
    regime: RegimeState,
    trim: float,
    trim_rate_1_s: float,
    elapsed_ticks: int,
) -> StartState:
    """One tick of a start or of the hold after it."""
    held_periods = state.hits  # before a miss resets the count
    state = _advanced(config, _counted(state, regime), elapsed_ticks)
    arrived, target_rad_s = state.s >= 1.0, state.target_omega_rad_s
    if state.stage == APPROACH:
        return _curve(state, RISE, target_rad_s, goal_rad_s, config.rise_s, 0) if arrived else state
    if state.stage == DIP:
        return _at(state, DWELL, 0, captured=False, failed=False) if arrived else state
    if state.stage == DWELL:
        settled = state.hits >= config.dwell_periods or state.misses >= config.missing_periods
        # If the dip has no impacts either, there may be none at any speed: the attempt counts twice.
        attempts = state.attempts + (0 if state.hits >= config.dwell_periods else 1)
        return _curve(state, RISE, target_rad_s, goal_rad_s, config.again_s, attempts) if settled else state
    if abs(goal_rad_s - state.to_rad_s) > SMALL_CHANGE * config.natural_rad_s:
        share = abs(goal_rad_s - target_rad_s) / at_least(config.natural_rad_s, 1e-3)
        duration_s = at_least(config.rise_s * share, SHORTEST_CHANGE_S)
        # The counts of impacts and misses continue.
        curve = _curve(state, RISE, target_rad_s, goal_rad_s, duration_s, state.attempts)
        return curve._replace(hits=state.hits, misses=state.misses)
    if state.stage == RISE:
        # Impacts during the rise count, but the last two of the required ones must occur at the target.
        hits = min(state.hits, max(config.confirm_periods - 2, 0))
        return _at(state, CONFIRM, hits, captured=state.captured, failed=False) if arrived else state
    if state.stage == CONFIRM:
        if not needs_impacts or state.hits >= config.confirm_periods:
            return _at(state, HOLD, 0, captured=True, failed=False)
        return _again(config, state, 0) if state.misses >= config.missing_periods else state
    if needs_impacts and state.misses >= config.lost_periods:
        return _again(config, state, held_periods)
    again = state.attempts > 0 and state.hits >= 10 * config.confirm_periods
    return state._replace(
        stage=HOLD,
        to_rad_s=goal_rad_s,
        target_omega_rad_s=goal_rad_s + trim * config.natural_rad_s,
        target_acceleration_rad_s2=trim_rate_1_s * config.natural_rad_s,
        attempts=0 if again else state.attempts,
    )


def _bounded(
    config: StartConfig, state: StartState, mode: Mode, needs_impacts: bool, elapsed_ticks: int
) -> StartState:
    """The state, failed if the impacts have been missing for longer than `LONGEST_SEARCH_S`."""
    found = state.stage == HOLD or state.hits >= config.confirm_periods or not needs_impacts
    searching_s = state.searching_s + elapsed_ticks * config.tick_s
    if mode == RUN and found:
        searching_s = 0.0
    overdue = searching_s > LONGEST_SEARCH_S
    return state._replace(
        captured=state.captured and not overdue, failed=state.failed or overdue, searching_s=searching_s
    )


def step(
    config: StartConfig,
    state: StartState,
    mode: Mode,
    target_ratio: float,
    drive_ready: bool,
    omega_rad_s: float,
    regime: RegimeState,
    trim: float,
    trim_rate_1_s: float,
    may_retreat: bool,
    elapsed_ticks: int,
) -> StartState:
    """One tick: the target speed, and whether the requested regime is captured or the start has failed.

    The S-curve ends at the requested ratio, but not above `free_ratio`, the highest ratio that needs no guard
    on the impact phase, nor, if `may_retreat`, above `ceiling_ratio`; in the hold `trim` is added.
    """
    if mode == STOPPING:
        if state.stage != STOP:
            # If the crank is slower than its target, begin at its speed: a stop must not accelerate it.
            from_rad_s = min(at_least(omega_rad_s, 0.0), state.target_omega_rad_s)
            state = _curve(state, STOP, from_rad_s, 0.0, config.stop_s, 0)
        return _advanced(config, state, elapsed_ticks)
    if mode not in (SOFT_START, RUN):
        return INITIAL
    if not drive_ready or state.failed:
        return state
    goal_ratio = min(target_ratio, config.free_ratio)
    if may_retreat:
        goal_ratio = min(goal_ratio, state.ceiling_ratio)
    goal_rad_s = goal_ratio * config.natural_rad_s
    needs_impacts = target_ratio >= config.capture_ratio
    if state.stage in (REST, STOP):
        return _begin(config, omega_rad_s, goal_rad_s)
    now = _moved(config, state, goal_rad_s, needs_impacts, regime, trim, trim_rate_1_s, elapsed_ticks)
    return _bounded(config, now, mode, needs_impacts, elapsed_ticks)
