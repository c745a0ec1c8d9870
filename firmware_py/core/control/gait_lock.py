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

from firmware_py.core.control.gait import CycleState
from firmware_py.core.estimation.regime import RegimeState
from firmware_py.core.numbers import TAU, clamp, fraction, wrap_pi
from firmware_py.core.records import zeroed
from firmware_py.interface.enums import Refusal

MOST_TURNS = 15
"""Largest number of crank turns per stride that the report can hold."""

COUNTS = 65536

AIM_HYSTERESIS = 0.01
"""Hysteresis of r with a requested impulse: the uncertainty of the mean impact over some strides."""

LARGEST_SHARE = 0.45
"""Largest `turning_share`: n then changes after the heel strike, which determines the stride."""


class LockConfig(NamedTuple):
    """`hysteresis`: advantage in r that another n must have over the present one.

    Strides vary, so the ratio may leave the region by `margin`, and the present n is kept up to twice
    `margin` outside of it. Ratios refer to the nominal ω.
    """

    follow: bool
    tick_s: float
    natural_rad_s: float
    lowest_ratio: float
    centre_ratio: float
    highest_ratio: float
    hysteresis: float
    margin: float
    window_start: float
    window_end: float
    lowest_confidence: float
    gain_1_s: float
    largest_trim: float
    rate_1_s: float


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


INITIAL = zeroed(LockState, base_ratio=1.0, impact_rad=0.5 * math.pi, refusal=Refusal.NOT_WALKING)


def chosen(config: LockConfig, stride_s: float, before: int, aim_ratio: float) -> int:
    """The number of turns per stride nearest to `aim_ratio`, or to the centre if that is 0.

    0 if no number gives a ratio within the region.
    """
    one = TAU / (stride_s * config.natural_rad_s)
    aim = aim_ratio if aim_ratio > 0.0 else config.centre_ratio
    hysteresis = AIM_HYSTERESIS if aim_ratio > 0.0 else config.hysteresis
    below = int(aim / one)
    best = 0
    for turns in (below, below + 1):
        fits = 1 <= turns <= MOST_TURNS and config.lowest_ratio <= turns * one <= config.highest_ratio
        if fits and (best == 0 or abs(turns * one - aim) < abs(best * one - aim)):
            best = turns
    most = 2.0 * config.margin
    stays = config.lowest_ratio - most <= before * one <= config.highest_ratio + most
    if stays and (best == 0 or abs(before * one - aim) <= abs(best * one - aim) + hysteresis):
        return before
    return best


def refused(config: LockConfig, gait: CycleState, harmonic: int) -> Refusal:
    """The reason why the crank cannot follow, or NONE."""
    if gait.confidence < config.lowest_confidence:
        return Refusal.NOT_WALKING
    return Refusal.NONE if harmonic > 0 else Refusal.NO_HARMONIC


def turning_share(config: LockConfig, stride_s: float) -> float:
    """The share of the cycle before p_c at which n changes.

    One turn more or less per stride changes the ratio by Δr, at its rate ρ. Meanwhile the crank's angle
    changes by ω Δr²/2ρ relative to the new θ*. The jump of θ* cancels this angle if n changes ω Δr²/4πρ of a
    cycle before p_c.
    """
    turn = TAU / (stride_s * config.natural_rad_s)
    share = config.natural_rad_s * turn * turn / (2.0 * TAU * config.rate_1_s)
    return min(share, LARGEST_SHARE)


def within(config: LockConfig, phase: float) -> bool:
    """Whether a phase of the cycle is in the window."""
    return config.window_start <= phase <= config.window_end


def step(
    config: LockConfig,
    state: LockState,
    gait: CycleState,
    moving: bool,
    holding: bool,
    angle_rad: float,
    regime: RegimeState,
    touch_down: bool,
    age_s: float,
    elapsed_ticks: int,
    aim_ratio: float,
) -> LockState:
    """One tick. `moving`: a start to the base ratio is running; `holding`: captured, the ratio may change.

    `aim_ratio` is the ratio of a requested impulse, or 0.
    """
    middle = 0.5 * (config.window_start + config.window_end)
    harmonic = 0
    if gait.confidence >= config.lowest_confidence:
        harmonic = chosen(config, gait.stride.mean_s, state.harmonic, aim_ratio)
        change_at = middle - turning_share(config, gait.stride.mean_s)
        if holding and harmonic > 0 and state.harmonic > 0 and not state.phase < change_at <= gait.phase:
            harmonic = state.harmonic
    one = TAU / (gait.stride.expected_s * config.natural_rad_s)
    base_ratio = state.base_ratio
    if not moving and harmonic > 0:
        base_ratio = harmonic * TAU / (gait.stride.mean_s * config.natural_rad_s)

    impact_rad = state.impact_rad
    if regime.ended and regime.last.impacts == 1:
        impact_rad += 0.3 * wrap_pi(regime.last.phase_rad + 0.5 * math.pi - impact_rad)
    trim, rate_1_s, error_rad = 0.0, 0.0, 0.0
    if holding:
        wanted = base_ratio + state.trim
        if harmonic > 0:
            error_rad = wrap_pi(TAU * harmonic * (gait.phase - middle) + impact_rad - angle_rad)
            wanted = harmonic * one + clamp(
                config.gain_1_s * error_rad / config.natural_rad_s, config.largest_trim
            )
            wanted = min(
                max(wanted, config.lowest_ratio - config.margin), config.highest_ratio + config.margin
            )
        dt_s = elapsed_ticks * config.tick_s
        change = clamp(wanted - base_ratio - state.trim, config.rate_1_s * dt_s)
        trim = state.trim + change
        rate_1_s = change / dt_s

    in_window, outside = state.in_window, state.outside
    if holding and touch_down and harmonic > 0:
        phase = gait.phase - age_s / gait.stride.expected_s
        if within(config, fraction(phase)):
            in_window = (in_window + 1) % COUNTS
        else:
            outside = (outside + 1) % COUNTS
    return LockState(
        harmonic,
        gait.phase,
        base_ratio,
        trim,
        rate_1_s,
        error_rad,
        impact_rad,
        in_window,
        outside,
        refused(config, gait, harmonic),
    )
