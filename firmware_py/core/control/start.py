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
from firmware_py.core.estimation.striker_model import Nominal
from firmware_py.core.numbers import at_least
from firmware_py.core.request import Request
from firmware_py.interface.enums import Mode
from firmware_py.interface.generated.parameters import Parameters
from firmware_py.interface.modes import MODES, Target
from firmware_py.interface.zeroed import zeroed

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


def is_valid_ratio(p: Parameters, ratio: float) -> bool:
    """Whether the operator's ratio is within the valid range; NaN is not."""
    return p.start.lowest_ratio <= ratio <= p.start.highest_ratio


def begin_curve(
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


def advance(p: Parameters, state: StartState) -> StartState:
    """The state advanced along the curve; in the hold, which sets its own target, unchanged."""
    if state.stage == HOLD:
        return state
    s = state.s + p.control.tick_s / state.duration_s
    height, slope = s_curve(s)
    span = state.to_rad_s - state.from_rad_s
    return state._replace(
        s=min(s, 1.0),
        target_omega_rad_s=state.from_rad_s + span * height,
        target_acceleration_rad_s2=span * slope / state.duration_s,
    )


def count_periods(state: StartState, regime: RegimeState) -> StartState:
    """Count periods: `hits` with an impact, from 0 again after two misses; `misses` in a row."""
    if not regime.ended:
        return state
    # A single period without an impact may be an outlier, or half of an orbit of period two.
    hit = regime.last.impacts > 0
    odd = not hit and state.misses == 0
    hits = state.hits + 1 if hit else state.hits
    return state._replace(hits=hits if hit or odd else 0, misses=0 if hit else state.misses + 1)


def enter_stage(state: StartState, stage: Stage, hits: int, captured: bool, failed: bool) -> StartState:
    """The state at another stage, with the count of impacts at `hits` and no misses."""
    return state._replace(stage=stage, hits=hits, misses=0, captured=captured, failed=failed)


def dip_again(p: Parameters, nominal: Nominal, state: StartState, held_periods: int) -> StartState:
    """Dip for another attempt, which ends a step below the ratio at which the impacts were lost; or fail.

    Each step is longer than the previous one, so that three steps reach a fold that lies far below.
    """
    if state.attempts >= p.start.attempts:
        return enter_stage(state, state.stage, 0, captured=False, failed=True)
    lost_ratio = min(state.target_omega_rad_s / at_least(nominal.natural_rad_s, 1e-3), p.start.free_ratio)
    if state.attempts > 0:
        lost_ratio = min(lost_ratio, state.ceiling_ratio)
    # The first time, if the impacts had lasted long, the speed was not the cause of the loss.
    has_held = held_periods >= 2 * p.start.confirm_periods and state.attempts == 0
    step_ratio = 0.0 if has_held else p.start.retreat_ratio * (1 + state.attempts)
    dip_rad_s = p.start.dip_ratio * nominal.natural_rad_s
    dip = begin_curve(state, DIP, state.target_omega_rad_s, dip_rad_s, DIP_S, state.attempts + 1)
    ceiling_ratio = at_least(lost_ratio - step_ratio, p.start.dip_ratio)
    return dip._replace(captured=False, failed=False, ceiling_ratio=ceiling_ratio)


def has_retreated(p: Parameters, nominal: Nominal, state: StartState, target_ratio: float) -> bool:
    """Whether the speed is below the requested one because the impacts were lost at higher speed."""
    highest_ratio = min(target_ratio, p.start.free_ratio)
    return (
        state.ceiling_ratio < highest_ratio
        and state.target_omega_rad_s < highest_ratio * nominal.natural_rad_s * (1.0 - 1e-6)
    )


def begin_start(p: Parameters, nominal: Nominal, omega_rad_s: float, goal_rad_s: float) -> StartState:
    """The first S-curve, from the present speed; without the approach if the rise is shorter than that."""
    approach_rad_s = p.start.approach_ratio * nominal.natural_rad_s
    if approach_rad_s < goal_rad_s and p.start.approach_s < p.start.rise_s:
        return begin_curve(INITIAL, APPROACH, omega_rad_s, approach_rad_s, p.start.approach_s, 0)
    return begin_curve(INITIAL, RISE, omega_rad_s, goal_rad_s, p.start.rise_s, 0)


def begin_rise(state: StartState, goal_rad_s: float, duration_s: float, attempts: int) -> StartState:
    """The state at the beginning of an S-curve from the present target to the goal."""
    return begin_curve(state, RISE, state.target_omega_rad_s, goal_rad_s, duration_s, attempts)


def lead_to_rise(p: Parameters, state: StartState, goal_rad_s: float) -> StartState:
    """One tick of approach, dip or dwell, each of which a rise to the goal follows."""
    arrived = state.s >= 1.0
    if state.stage == APPROACH:
        return begin_rise(state, goal_rad_s, p.start.rise_s, 0) if arrived else state
    if state.stage == DIP:
        return enter_stage(state, DWELL, 0, captured=False, failed=False) if arrived else state
    has_impacts = state.hits >= p.start.dwell_periods
    if not (has_impacts or state.misses >= p.start.missing_periods):
        return state
    # If the dip has no impacts either, there may be none at any speed: the attempt counts twice.
    attempts = state.attempts + (0 if has_impacts else 1)
    return begin_rise(state, goal_rad_s, p.start.again_s, attempts)


def follow_goal(p: Parameters, nominal: Nominal, state: StartState, goal_rad_s: float) -> StartState:
    """The beginning of an S-curve to a goal that has changed; the counts of impacts and misses continue."""
    share = abs(goal_rad_s - state.target_omega_rad_s) / at_least(nominal.natural_rad_s, 1e-3)
    duration_s = at_least(p.start.rise_s * share, SHORTEST_CHANGE_S)
    curve = begin_rise(state, goal_rad_s, duration_s, state.attempts)
    return curve._replace(hits=state.hits, misses=state.misses)


def end_rise(p: Parameters, state: StartState) -> StartState:
    """One tick of a rise; at its end the impacts are to be confirmed."""
    if state.s < 1.0:
        return state
    # Impacts during the rise count, but the last two of the required ones must occur at the target.
    hits = min(state.hits, max(p.start.confirm_periods - 2, 0))
    return enter_stage(state, CONFIRM, hits, captured=state.captured, failed=False)


def confirm(p: Parameters, nominal: Nominal, state: StartState, needs_impacts: bool) -> StartState:
    """One tick at the goal until the required number of periods with impacts, or too many without."""
    if not needs_impacts or state.hits >= p.start.confirm_periods:
        return enter_stage(state, HOLD, 0, captured=True, failed=False)
    return dip_again(p, nominal, state, 0) if state.misses >= p.start.missing_periods else state


def keep_ratio(
    p: Parameters, nominal: Nominal, state: StartState, goal_rad_s: float, request: Request
) -> StartState:
    """One tick of the hold: the target with its trim."""
    lasted = state.attempts > 0 and state.hits >= 10 * p.start.confirm_periods
    return state._replace(
        stage=HOLD,
        to_rad_s=goal_rad_s,
        target_omega_rad_s=goal_rad_s + request.trim * nominal.natural_rad_s,
        target_acceleration_rad_s2=request.trim_rate_1_s * nominal.natural_rad_s,
        attempts=0 if lasted else state.attempts,
    )


def move_target(
    p: Parameters,
    nominal: Nominal,
    state: StartState,
    goal_rad_s: float,
    needs_impacts: bool,
    regime: RegimeState,
    request: Request,
) -> StartState:
    """One tick of a start or of the hold after it. Approach, dip and dwell end before a new goal counts."""
    held_periods = state.hits  # before a miss resets the count
    state = advance(p, count_periods(state, regime))
    if state.stage in (APPROACH, DIP, DWELL):
        return lead_to_rise(p, state, goal_rad_s)
    if abs(goal_rad_s - state.to_rad_s) > SMALL_CHANGE * nominal.natural_rad_s:
        return follow_goal(p, nominal, state, goal_rad_s)
    if state.stage == RISE:
        return end_rise(p, state)
    if state.stage == CONFIRM:
        return confirm(p, nominal, state, needs_impacts)
    if needs_impacts and state.misses >= p.start.lost_periods:
        return dip_again(p, nominal, state, held_periods)
    return keep_ratio(p, nominal, state, goal_rad_s, request)


def bound_search(p: Parameters, state: StartState, mode: Mode, needs_impacts: bool) -> StartState:
    """The state, failed if the impacts have been missing for longer than `LONGEST_SEARCH_S`."""
    found = state.stage == HOLD or state.hits >= p.start.confirm_periods or not needs_impacts
    searching_s = state.searching_s + p.control.tick_s
    if mode == Mode.RUN and found:
        searching_s = 0.0
    overdue = searching_s > LONGEST_SEARCH_S
    return state._replace(
        captured=state.captured and not overdue, failed=state.failed or overdue, searching_s=searching_s
    )


def step(
    p: Parameters,
    nominal: Nominal,
    state: StartState,
    mode: Mode,
    request: Request,
    drive_ready: bool,
    omega_rad_s: float,
    regime: RegimeState,
) -> StartState:
    """One tick: the target speed, and whether the requested regime is captured or the start has failed.

    The S-curve ends at the requested ratio, but not above `free_ratio`, the highest ratio that needs no guard
    on the impact phase, nor, where the request does not set the ratio of the hold, above `ceiling_ratio`.
    """
    if MODES[mode.value].target == Target.STOP:
        if state.stage != STOP:
            # If the crank is slower than its target, begin at its speed: a stop must not accelerate it.
            from_rad_s = min(at_least(omega_rad_s, 0.0), state.target_omega_rad_s)
            state = begin_curve(state, STOP, from_rad_s, 0.0, p.start.stop_s, 0)
        return advance(p, state)
    if MODES[mode.value].target != Target.START:
        return INITIAL
    if not drive_ready or state.failed:
        return state
    goal_ratio = min(request.ratio, p.start.free_ratio)
    if not request.sets_hold_ratio:
        goal_ratio = min(goal_ratio, state.ceiling_ratio)
    goal_rad_s = goal_ratio * nominal.natural_rad_s
    needs_impacts = request.ratio >= p.start.capture_ratio
    if state.stage in (REST, STOP):
        return begin_start(p, nominal, omega_rad_s, goal_rad_s)
    now = move_target(p, nominal, state, goal_rad_s, needs_impacts, regime, request=request)
    return bound_search(p, now, mode, needs_impacts)
