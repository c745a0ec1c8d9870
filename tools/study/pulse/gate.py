"""One impact a stride from a resting crank: two swings, one impact, braking, rest.

Pumping reverses the braking of `firmware_py.core.control.spin_down`. A striker that swings as x − l₀ = R cos
ψ gains the most energy if the crank is half a turn from the angle at which it loses the most, that is, if the
piston is 90° ahead of the striker:

    θ = ψ + π        ω_crank = ω + g ω (ψ + π − θ)

A crank that starts from the backward dead centre at ω under a striker at rest satisfies this. With τ = ω t

    (x − l₀)/A = −cos τ − (τ/2) sin τ

has maxima of 2.4 after three quarters of a turn and of 5.5 after one more turn. A module with a gap between
2.4 A and 5.5 A therefore has its impact in the second swing. The start of pumping is adjusted by the lateness
of the previous impacts. Between impacts the crank rests at its backward dead centre, where the spring has no
lever arm. It moves forward a little only while the striker swings back, which damps the remaining swing.
"""

import math
from enum import IntEnum
from typing import NamedTuple

from firmware_py.core.control import spin_down
from firmware_py.core.estimation import crank, estimator_state
from firmware_py.core.numbers import clamp, wrap_pi

WINDOW_MIDDLE = 0.525
"""Middle of the firmware's push-off window, 45 to 60 % of the gait cycle."""


class Stage(IntEnum):
    """Stage of the crank within a stride."""

    REST = 0
    PUMP = 1
    BRAKE = 2


class Gate(NamedTuple):
    """Parameters of the gate; `braking` has the firmware's own values.

    `lowest_confidence` is the confidence in the gait phase below which no pumping starts. `lead_gain` is the
    share of an impact's lateness by which the lead changes. `swinging`, in amplitudes, is the swing above
    which the crank follows the striker's phase. `park_gain`, over ω, is the gain of the crank's angle at
    rest. To damp the remaining swing, the resting crank moves forward by 1 rad for a swing of A, at most by
    `most_rad`, for the swing's phase `ahead_rad` later.
    """

    braking: spin_down.SpinDownConfig
    lowest_confidence: float
    lead_gain: float = 0.3
    swinging: float = 1.5
    park_gain: float = 2.0
    ahead_rad: float = 1.0
    most_rad: float = 1.2


class GateState(NamedTuple):
    """State of the gate.

    `armed` means that pumping has not yet started in this stride. `since_s` is the time since pumping
    started. `lead_s` is the adapted time from the start of pumping to the impact.
    """

    stage: Stage
    armed: bool
    since_s: float
    lead_s: float
    braking: spin_down.SpinDownState
    target_rad_s: float


def impact_at_rad(gap_over_amplitude: float) -> float:
    """Return τ at the impact if the crank starts at ω under a striker at rest; the gap is 2.4 to 5.5 A."""

    def short(tau: float) -> float:
        return gap_over_amplitude + math.cos(tau) + 0.5 * tau * math.sin(tau)

    low, high = 2.5 * math.pi, 3.5 * math.pi
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if short(middle) > 0.0 else (low, middle)
    return low


def initial(gate: Gate) -> GateState:
    """Return the state at rest, with the lead of the nominal module."""
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
    """Advance the gate by one tick.

    `cycle`: gait phase, confidence and expected stride in s. `striker`: x in m and v in m/s.
    """
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
    """Return the lateness of an impact relative to the window's middle, as a share of the cycle."""
    return (phase - WINDOW_MIDDLE + 0.5) % 1.0 - 0.5


def _pumping(gate: Gate, since_s: float, crank_rad: float, striker: tuple[float, float]) -> float:
    """Return the crank's target speed while pumping, rad/s.

    The crank starts at ω; once the striker swings, the crank follows the phase of the swing.
    """
    nominal = gate.braking
    natural_rad_s = nominal.natural_rad_s
    away_m, lag_m = striker[0] - nominal.rest_length_m, striker[1] / natural_rad_s
    wanted_rad = natural_rad_s * since_s - 0.5 * math.pi
    if math.hypot(away_m, lag_m) > gate.swinging * nominal.amplitude_m:
        wanted_rad = math.atan2(-lag_m, away_m) + math.pi
    ahead = clamp(wrap_pi(wanted_rad - crank_rad), 1.0)
    return min(natural_rad_s * (1.0 + nominal.gain * ahead), nominal.highest_rad_s)


def _resting(gate: Gate, crank_rad: float, striker: tuple[float, float]) -> float:
    """Return the crank's target speed at rest, rad/s.

    The crank is held at the backward dead centre, and forward of it while the striker swings back.
    """
    nominal = gate.braking
    natural_rad_s = nominal.natural_rad_s
    away_m = striker[0] - nominal.rest_length_m + nominal.amplitude_m
    lag_m = striker[1] / natural_rad_s
    back = (away_m * math.sin(gate.ahead_rad) - lag_m * math.cos(gate.ahead_rad)) / nominal.amplitude_m
    forward_rad = min(max(back, 0.0), gate.most_rad)
    error_rad = wrap_pi(forward_rad - 0.5 * math.pi - crank_rad)
    return clamp(natural_rad_s * gate.park_gain * error_rad, nominal.highest_rad_s)
