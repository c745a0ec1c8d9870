"""One impact a stride from a resting crank: two swings, one impact, braking, rest.

Pumping is the mirror of `firmware_py.core.control.spin_down`, which brakes: a striker that swings as x − l₀ =
R cos ψ gains most from a crank half a turn from where it loses most, the piston then being 90° ahead of it,

    θ = ψ + π        ω_crank = ω + g ω (ψ + π − θ)

From rest at the rear dead centre a crank that sets out at ω does just that. With τ = ω t

    (x − l₀)/A = −cos τ − (τ/2) sin τ

has crests of 2.4 after three quarters of a turn and of 5.5 after one more: a module with its stop between
2.4 A and 5.5 A has its impact in the second swing, whatever else. When to set out follows from how early or
late the last impacts came. In between the crank rests at its rear dead centre, where the spring has no lever
on it, and moves forward a little only while the striker swings back: that damps what is left of the swing.
"""

import math
from enum import IntEnum
from typing import NamedTuple

from firmware_py.core.control import spin_down
from firmware_py.core.estimation import crank, estimator_state
from firmware_py.core.numbers import clamp, wrap_pi

WINDOW_MIDDLE = 0.525
"""Of the firmware's push-off window, 45 to 60 % of the cycle."""


class Stage(IntEnum):
    """The crank's stage."""

    REST = 0
    PUMP = 1
    BRAKE = 2


class Gate(NamedTuple):
    """`braking` is the firmware's own; `lead_gain` is what an impact's lateness moves the next start by.

    `park_gain` over ω leads the crank to its place; a swing of A about rest moves it by up to `most_rad`, as
    that swing will be `ahead_rad` later.
    """

    braking: spin_down.SpinDownConfig
    lowest_confidence: float
    lead_gain: float = 0.3
    swinging: float = 1.5
    park_gain: float = 2.0
    ahead_rad: float = 1.0
    most_rad: float = 1.2


class GateState(NamedTuple):
    """`lead_s`: learnt, from setting out to the impact. `since_s`: since then. `armed`: yet to do so
    in this stride.
    """

    stage: Stage
    armed: bool
    since_s: float
    lead_s: float
    braking: spin_down.SpinDownState
    target_rad_s: float


def impact_at_rad(gap_over_amplitude: float) -> float:
    """τ at the impact of a crank that sets out at ω under a striker at rest; a gap of 2.4 to 5.5 A."""

    def short(tau: float) -> float:
        return gap_over_amplitude + math.cos(tau) + 0.5 * tau * math.sin(tau)

    low, high = 2.5 * math.pi, 3.5 * math.pi
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if short(middle) > 0.0 else (low, middle)
    return low


def initial(gate: Gate) -> GateState:
    """At rest, with the lead by the nominal module."""
    nominal = gate.braking
    gap_m = nominal.stop_m - nominal.rest_length_m
    lead_s = impact_at_rad(gap_m / nominal.amplitude_m) / nominal.natural_rad_s
    return GateState(Stage.REST, True, 0.0, lead_s, spin_down.INITIAL, 0.0)


def step(
    gate: Gate,
    state: GateState,
    cycle: tuple[float, float, float],
    crank_rad: float,
    striker: tuple[float, float],
    touch_down: bool,
) -> GateState:
    """One tick. `cycle`: phase, confidence and expected stride in s; `striker`: x in m and v in m/s."""
    nominal = gate.braking
    phase, confidence, stride_s = cycle
    stage, since_s, lead_s, braking = (
        state.stage,
        state.since_s + nominal.tick_s,
        state.lead_s,
        state.braking,
    )
    if touch_down and stage == Stage.PUMP:
        lead_s += gate.lead_gain * stride_s * _from_middle(phase)
        stage, braking = Stage.BRAKE, spin_down.INITIAL
    elif stage == Stage.PUMP and since_s > 2.0 * lead_s:
        stage, braking = Stage.BRAKE, spin_down.INITIAL

    late = (phase - WINDOW_MIDDLE + lead_s / stride_s) % 1.0
    armed = state.armed or late > 0.5
    if armed and late < 0.2 and stage != Stage.PUMP and confidence >= gate.lowest_confidence:
        stage, armed, since_s = Stage.PUMP, False, 0.0

    if stage == Stage.PUMP:
        target_rad_s = _pumping(gate, since_s, crank_rad, striker)
    else:
        braking = spin_down.step(
            nominal,
            braking,
            crank.INITIAL._replace(angle_rad=crank_rad),
            estimator_state.INITIAL._replace(x_m=striker[0], v_m_s=striker[1]),
            1,
        )
        stage = Stage.BRAKE if braking.stage == spin_down.SpinDownStage.BRAKE else Stage.REST
        target_rad_s = braking.target_omega_rad_s
        if stage == Stage.REST:
            target_rad_s = _resting(gate, crank_rad, striker)
    return GateState(stage, armed, since_s, lead_s, braking, target_rad_s)


def _from_middle(phase: float) -> float:
    """Lateness of an impact after the window's middle, as a share of the cycle."""
    return (phase - WINDOW_MIDDLE + 0.5) % 1.0 - 0.5


def _pumping(gate: Gate, since_s: float, crank_rad: float, striker: tuple[float, float]) -> float:
    """Out at ω; in step with the swing as soon as there is one."""
    nominal = gate.braking
    natural_rad_s = nominal.natural_rad_s
    away_m, lag_m = striker[0] - nominal.rest_length_m, striker[1] / natural_rad_s
    wanted_rad = natural_rad_s * since_s - 0.5 * math.pi
    if math.hypot(away_m, lag_m) > gate.swinging * nominal.amplitude_m:
        wanted_rad = math.atan2(-lag_m, away_m) + math.pi
    ahead = clamp(wrap_pi(wanted_rad - crank_rad), 1.0)
    return min(natural_rad_s * (1.0 + nominal.gain * ahead), nominal.highest_rad_s)


def _resting(gate: Gate, crank_rad: float, striker: tuple[float, float]) -> float:
    """To the rear dead centre, and forward of it while the striker swings back."""
    nominal = gate.braking
    natural_rad_s = nominal.natural_rad_s
    away_m = striker[0] - nominal.rest_length_m + nominal.amplitude_m
    lag_m = striker[1] / natural_rad_s
    back = (away_m * math.sin(gate.ahead_rad) - lag_m * math.cos(gate.ahead_rad)) / nominal.amplitude_m
    forward_rad = min(max(back, 0.0), gate.most_rad)
    error_rad = wrap_pi(forward_rad - 0.5 * math.pi - crank_rad)
    return clamp(natural_rad_s * gate.park_gain * error_rad, nominal.highest_rad_s)
