"""A stop that first removes the striker's energy and then parks the crank where the gap is widest.

A striker with little damping continues to hit the stop after the crank has stopped. The displacement x_A of
the crank changes the striker's energy by the power P = c x_A v. With the striker's free motion as a phasor,

    x − l₀ = R cos ψ,  v = −R ω sin ψ,  x_A = A sin θ        P = −c A R ω sin θ sin ψ

P removes most energy if θ = ψ. The crank therefore continues to turn at the striker's own frequency, in phase
with the striker,

    ω_crank = ω + g ω (ψ − θ)

(a phase-locked loop, as in `gait_lock`), until the swing no longer reaches the stop. Then it turns to its
backward dead centre, θ = −90°, where the gap is wider by A and the spring exerts no torque on the crank. The
braking lasts at most `longest_s`, so that a stop always ends with the crank at rest.
"""

import math
from enum import IntEnum
from typing import NamedTuple

from firmware_py.core.elementary import atan2
from firmware_py.core.estimation.crank import CrankState
from firmware_py.core.estimation.estimator_state import StrikerMotion
from firmware_py.core.estimation.striker_model import Nominal
from firmware_py.core.numbers import at_least, clamp, wrap_pi
from firmware_py.interface.generated.parameters import Parameters
from firmware_py.interface.zeroed import zeroed

WAITS_RAD = 0.75 * math.pi
"""If the crank lags by more than π minus this angle, it waits for the next swing; waiting needs no speed."""

PARK_GAIN = 1.5
"""Gain over ω: the crank reaches the dead centre within half a swing and hardly excites the striker."""


class SpinDownStage(IntEnum):
    """The stage of a stop."""

    OFF = 0
    BRAKE = 1
    PARK = 2


def longest_s(p: Parameters) -> float:
    """The longest braking; 0: a stop is the S-curve alone."""
    return p.spin_down.longest_s if p.gait.follow > 0 else 0.0


class SpinDownState(NamedTuple):
    """`swing_m` is the striker's amplitude about its rest position with the crank parked.

    `highest_rad_s` is the crank's speed when the stop began; no target of the stop exceeds it.
    """

    stage: SpinDownStage
    highest_rad_s: float
    since_s: float
    swing_m: float
    target_omega_rad_s: float


INITIAL = zeroed(SpinDownState, stage=SpinDownStage.OFF)


def step(
    p: Parameters, nominal: Nominal, state: SpinDownState, crank: CrankState, striker: StrikerMotion
) -> SpinDownState:
    """One tick of a stop: the crank's target speed."""
    natural_rad_s, amplitude_m = nominal.natural_rad_s, nominal.drive.amplitude_m
    highest_rad_s = state.highest_rad_s
    if state.stage == SpinDownStage.OFF:
        fastest_rad_s = min(1.5 * natural_rad_s, 0.97 * p.limit.speed_rad_s)
        highest_rad_s = clamp(at_least(crank.omega_rad_s, 0.0), fastest_rad_s)
    away_m, lag_m = striker.x_m - nominal.striker.rest_length_m, striker.v_m_s / natural_rad_s
    swing_m = math.sqrt((away_m + amplitude_m) * (away_m + amplitude_m) + lag_m * lag_m)
    since_s = state.since_s + p.control.tick_s
    reach_m = nominal.stop.position_m - nominal.striker.rest_length_m + amplitude_m
    swings = swing_m > p.spin_down.share * reach_m and since_s < longest_s(p)  # NaN: False
    stage = SpinDownStage.BRAKE if swings and state.stage != SpinDownStage.PARK else SpinDownStage.PARK
    if stage == SpinDownStage.BRAKE:
        error_rad = wrap_pi(atan2(-lag_m, away_m) - crank.angle_rad + WAITS_RAD) - WAITS_RAD
        wanted_rad_s = at_least(natural_rad_s * (1.0 + p.spin_down.gain * error_rad), 0.0)
    else:
        error_rad = wrap_pi(-0.5 * math.pi - crank.angle_rad)
        wanted_rad_s = clamp(natural_rad_s * PARK_GAIN * error_rad, natural_rad_s)
    return SpinDownState(stage, highest_rad_s, since_s, swing_m, clamp(wanted_rad_s, highest_rad_s))
