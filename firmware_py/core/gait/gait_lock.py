"""The crank's lock to the gait: n turns per stride, with one of their impacts in the push-off window.

    r = n f_stride 2π/ω,  n such that r lies nearest to the centre of the impact region

The crank's angle is controlled so that an impact falls on the middle p_c of the window:

    θ* = 2π n (p − p_c) + θ_b,   ω_crank = n ω_stride + g (θ* − θ)

with p the phase of the gait and θ_b the crank angle at impact, filtered from the regime's reports: a
phase-locked loop (Gardner, Phaselock Techniques, ch. 2, first order with its frequency fed forward). Any of
the n impacts may be in the window, so the error is wrapped to one turn. If n changes by one, θ* jumps by
2π (p − p_c); n changes at the phase where this jump equals the angle that the crank gains or loses while its
speed changes. The lock only trims the ratio in the hold, with limits on size and rate, so that the striker
stays in the impact regime.
"""

import math
from typing import NamedTuple

from firmware_py.core.estimation.regime import RegimeState
from firmware_py.core.gait.gait import Constants, CycleState
from firmware_py.core.numbers import TAU, clamp, fraction, wrap_pi
from firmware_py.interface.enums import Refusal
from firmware_py.interface.zeroed import zeroed

MOST_TURNS = 15
"""Largest number of crank turns per stride that the report can hold."""

COUNTS = 65536

AIM_HYSTERESIS = 0.01
"""Hysteresis of r with a requested impulse: the uncertainty of the mean impact over some strides."""

LARGEST_SHARE = 0.45
"""Largest `turning_share`: n then changes after the heel strike, which determines the stride."""


class LockState(NamedTuple):
    """`base_ratio` is the ratio at the end of a start, `trim` the present difference from it.

    `phase` is the phase of the gait, `error_rad` is θ* − θ, `impact_rad` is θ_b. `in_window` and `outside`
    count pulses, modulo COUNTS.
    """

    harmonic: int
    phase: float
    base_ratio: float
    trim: float
    trim_rate_1_s: float
    error_rad: float
    impact_rad: float
    in_window: int
    outside: int
    refusal: Refusal


class Moment(NamedTuple):
    """The motion at this tick's sample. `moving`: a start, a run or a stop; `holding`: captured in RUN.

    `impact_n_s`: impulse of the last impact. `since_touch_down_s`: time from the last touch-down.
    """

    moving: bool
    holding: bool
    angle_rad: float
    regime: RegimeState
    touch_down: bool
    since_touch_down_s: float
    impact_n_s: float


INITIAL = zeroed(LockState, base_ratio=1.0, impact_rad=0.5 * math.pi, refusal=Refusal.NOT_WALKING)


def choose_turns(own: Constants, stride_s: float, before: int, aim_ratio: float) -> int:
    """The number of turns per stride nearest to `aim_ratio`, or to the centre if that is 0.

    0 if no number gives a ratio within the region.
    """
    one = TAU / (stride_s * own.natural_rad_s)
    aim = aim_ratio if aim_ratio > 0.0 else own.gait.centre_ratio
    hysteresis = AIM_HYSTERESIS if aim_ratio > 0.0 else own.gait.hysteresis
    below = int(aim / one)
    best = 0
    for turns in (below, below + 1):
        fits = 1 <= turns <= MOST_TURNS and own.gait.lowest_ratio <= turns * one <= own.gait.highest_ratio
        if fits and (best == 0 or abs(turns * one - aim) < abs(best * one - aim)):
            best = turns
    most = 2.0 * own.gait.margin
    stays = own.gait.lowest_ratio - most <= before * one <= own.gait.highest_ratio + most
    if stays and (best == 0 or abs(before * one - aim) <= abs(best * one - aim) + hysteresis):
        return before
    return best


def find_refusal(own: Constants, gait: CycleState, harmonic: int) -> Refusal:
    """The reason why the crank cannot follow, or NONE."""
    if gait.confidence < own.gait.lowest_confidence:
        return Refusal.NOT_WALKING
    return Refusal.NONE if harmonic > 0 else Refusal.NO_HARMONIC


def turning_share(own: Constants, stride_s: float) -> float:
    """The share of the cycle before p_c at which n changes.

    One turn more or less per stride changes the ratio by Δr, at its rate ρ. Meanwhile the crank's angle
    changes by ω Δr²/2ρ relative to the new θ*. The jump of θ* cancels this angle if n changes ω Δr²/4πρ of a
    cycle before p_c.
    """
    turn = TAU / (stride_s * own.natural_rad_s)
    share = own.natural_rad_s * turn * turn / (2.0 * TAU * own.gait.rate_1_s)
    return min(share, LARGEST_SHARE)


def is_in_window(own: Constants, phase: float) -> bool:
    """Whether a phase of the cycle is in the window."""
    return own.gait.window_start <= phase <= own.gait.window_end


def follow_phase(
    own: Constants, state: LockState, gait: CycleState, harmonic: int, now: Moment, impact_rad: float
) -> tuple[float, float]:
    """`(wanted, error_rad)`: the ratio that leads the crank to θ*, within its limits, and θ* − θ."""
    if harmonic == 0:
        return state.base_ratio + state.trim, 0.0
    middle = 0.5 * (own.gait.window_start + own.gait.window_end)
    error_rad = wrap_pi(TAU * harmonic * (gait.phase - middle) + impact_rad - now.angle_rad)
    one = TAU / (gait.stride.expected_s * own.natural_rad_s)
    wanted = harmonic * one + clamp(own.gait.gain_1_s * error_rad / own.natural_rad_s, own.gait.largest_trim)
    lowest = own.gait.lowest_ratio - own.gait.margin
    return min(max(wanted, lowest), own.gait.highest_ratio + own.gait.margin), error_rad


def keep_turns(own: Constants, state: LockState, gait: CycleState, now: Moment, aim_ratio: float) -> int:
    """The number of turns per stride in this tick; in the hold it changes at one phase only. 0: none."""
    if gait.confidence < own.gait.lowest_confidence:
        return 0
    harmonic = choose_turns(own, gait.stride.mean_s, state.harmonic, aim_ratio)
    middle = 0.5 * (own.gait.window_start + own.gait.window_end)
    change_at = middle - turning_share(own, gait.stride.mean_s)
    if now.holding and harmonic > 0 and state.harmonic > 0 and not state.phase < change_at <= gait.phase:
        return state.harmonic
    return harmonic


def step(own: Constants, state: LockState, gait: CycleState, now: Moment, aim_ratio: float) -> LockState:
    """One tick. `aim_ratio`: the ratio of a requested impulse, or 0."""
    harmonic = keep_turns(own, state, gait, now, aim_ratio)
    base_ratio = state.base_ratio
    if not now.moving and harmonic > 0:
        base_ratio = harmonic * TAU / (gait.stride.mean_s * own.natural_rad_s)
    impact_rad = state.impact_rad
    if now.regime.ended and now.regime.last.impacts == 1:
        impact_rad += 0.3 * wrap_pi(now.regime.last.phase_rad + 0.5 * math.pi - impact_rad)
    trim, rate_1_s, error_rad = 0.0, 0.0, 0.0
    if now.holding:
        state = state._replace(base_ratio=base_ratio)
        wanted, error_rad = follow_phase(own, state, gait, harmonic, now, impact_rad)
        change = clamp(wanted - base_ratio - state.trim, own.gait.rate_1_s * own.tick_s)
        trim = state.trim + change
        rate_1_s = change / own.tick_s
    in_window, outside = state.in_window, state.outside
    if now.holding and now.touch_down and harmonic > 0:
        phase = gait.phase - now.since_touch_down_s / gait.stride.expected_s
        if is_in_window(own, fraction(phase)):
            in_window = (in_window + 1) % COUNTS
        else:
            outside = (outside + 1) % COUNTS
    return LockState(
        harmonic=harmonic,
        phase=gait.phase,
        base_ratio=base_ratio,
        trim=trim,
        trim_rate_1_s=rate_1_s,
        error_rad=error_rad,
        impact_rad=impact_rad,
        in_window=in_window,
        outside=outside,
        refusal=find_refusal(own, gait, harmonic),
    )
