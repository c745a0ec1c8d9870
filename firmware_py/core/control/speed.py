"""The speed loop: PI with the crank's load fed forward, and limits that fail safe.

    T = J α* + B ω + T_dry sign ω* + T_crank + K_p e + K_i ∫e dt,   T_crank = c (A sin θ + l0 − x) A cos θ

Positive torque turns the crank forward. The command acts one to two ticks after the sensors were read, so the
load is predicted for the middle of that time. The integral stops while a limit acts on the torque
(conditional integration). NaN gives 0 N m, never the torque limit.
"""

import math
from typing import NamedTuple

from firmware_py.core.elementary import sine_cosine
from firmware_py.core.estimation.crank import CrankState
from firmware_py.core.estimation.estimator_state import StrikerMotion
from firmware_py.core.numbers import clamp
from firmware_py.interface.enums import ActingLimit
from firmware_py.interface.generated.parameters import Parameters
from firmware_py.interface.zeroed import zeroed

LEAD_TICKS = 1.5
"""From the sensors' time t_k to the middle of the torque, which acts from t_{k+1} to t_{k+2}."""


class SpeedState(NamedTuple):
    """`acting_n_m` is the torque that acts until the next sensor sample: the previous tick's command."""

    integral_n_m: float
    error_rad_s: float
    feedforward_n_m: float
    torque_n_m: float
    acting_n_m: float
    acting_limit: ActingLimit


INITIAL = zeroed(SpeedState, acting_limit=ActingLimit.SAFE_STATE)


def crank_load(p: Parameters, crank: CrankState, striker: StrikerMotion, ahead_s: float) -> float:
    """The torque by which the spring opposes the crank `ahead_s` after the estimate, N m."""
    sine, cosine = sine_cosine(crank.angle_rad + crank.omega_rad_s * ahead_s)
    x_m = striker.x_m + striker.v_m_s * ahead_s
    stretch_m = p.drive.amplitude_m * sine + p.striker.rest_length_m - x_m
    if not abs(stretch_m) <= p.limit.stretch_m:
        return 0.0  # the estimate is lost
    return p.striker.spring_n_m * stretch_m * p.drive.amplitude_m * cosine


def rest(state: SpeedState) -> SpeedState:
    """The state with zero torque, and the integral reset."""
    return INITIAL._replace(acting_n_m=state.torque_n_m)


def keep(state: SpeedState) -> SpeedState:
    """The state after a period in which no torque was sent: the last one went on acting."""
    return state._replace(acting_n_m=state.torque_n_m)


def step(
    p: Parameters,
    state: SpeedState,
    crank: CrankState,
    striker: StrikerMotion,
    target_omega_rad_s: float,
    target_acceleration_rad_s2: float,
) -> SpeedState:
    """One tick of the loop; the torque is finite and within all limits for any input."""
    motor, limit_rad_s = p.motor, p.limit.speed_rad_s
    dry_n_m = motor.dry_n_m * clamp(target_omega_rad_s, 0.5) / 0.5
    feedforward_n_m = clamp(
        motor.inertia_kg_m2 * target_acceleration_rad_s2
        + motor.viscous_n_m_s * target_omega_rad_s
        + dry_n_m
        + p.speed.load_share * crank_load(p, crank, striker, LEAD_TICKS * p.control.tick_s),
        p.speed.torque_limit_n_m,
    )
    error_rad_s = target_omega_rad_s - crank.omega_rad_s
    wanted_n_m = feedforward_n_m + p.speed.gain_p_n_m_s * error_rad_s + state.integral_n_m

    acting_limit = ActingLimit.NONE
    torque_n_m = clamp(wanted_n_m, p.speed.torque_limit_n_m)
    if torque_n_m != wanted_n_m:
        acting_limit = ActingLimit.TORQUE
    change_n_m = clamp(torque_n_m - state.torque_n_m, p.speed.torque_rate_n_m_s * p.control.tick_s)
    if state.torque_n_m + change_n_m != torque_n_m and abs(torque_n_m - state.torque_n_m) > abs(change_n_m):
        acting_limit = ActingLimit.TORQUE_RATE
        torque_n_m = state.torque_n_m + change_n_m
    # The limit of the speed and NaN come last: they cut the torque at once, whatever its rate.
    forward = torque_n_m > 0.0 and not crank.omega_rad_s <= limit_rad_s
    backward = torque_n_m < 0.0 and not crank.omega_rad_s >= -limit_rad_s
    if forward or backward:
        torque_n_m = 0.0
        acting_limit = ActingLimit.SPEED
    if not math.isfinite(wanted_n_m):
        torque_n_m = 0.0
        acting_limit = ActingLimit.TORQUE

    integral_n_m = state.integral_n_m
    pushes_on = error_rad_s * (wanted_n_m - torque_n_m) > 0.0
    if acting_limit == ActingLimit.NONE or not pushes_on:
        integral_n_m = clamp(
            integral_n_m + p.speed.gain_i_n_m * error_rad_s * p.control.tick_s, p.speed.torque_limit_n_m
        )
    return SpeedState(
        integral_n_m,
        error_rad_s,
        feedforward_n_m,
        clamp(torque_n_m, p.speed.torque_limit_n_m),
        state.torque_n_m,
        acting_limit,
    )
