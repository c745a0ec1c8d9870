"""The drive, compiled: the bench's (`hil.drive_node`) in torque mode, with its limits and errors that disarm.

Its command watchdog cannot expire here, where every tick brings a torque. The suite holds closed loops with
this drive against those of the bench.
"""

from typing import NamedTuple

from firmware_py.interface.enums import AxisError
from hil.drive_node import DriveConfig
from tools.campaign.kernels import subroutine

_VELOCITY_LIMIT = int(AxisError.VELOCITY_LIMIT_VIOLATION)
_OVER_TEMPERATURE = int(AxisError.MOTOR_OVER_TEMP)
_ESTOP = int(AxisError.ESTOP_REQUESTED)


class Axis(NamedTuple):
    """The drive's own state."""

    closed: bool
    active_errors: int
    disarm_reason: int
    torque_n_m: float
    velocity_limit_rad_s: float
    current_limit_a: float
    motor_degc: float


class Wishes(NamedTuple):
    """What the firmware's frames of the last tick ask of the drive: a torque, and one more thing at most."""

    torque_n_m: float
    estop: bool
    clear_errors: bool
    limits: bool
    closed: bool
    idle: bool


def first_axis(config: DriveConfig) -> Axis:
    """A drive at power-up."""
    return Axis(
        closed=False,
        active_errors=0,
        disarm_reason=0,
        torque_n_m=0.0,
        velocity_limit_rad_s=config.velocity_limit_rad_s,
        current_limit_a=config.current_limit_a,
        motor_degc=config.ambient_degc,
    )


@subroutine
def obeyed(
    axis: Axis, wishes: Wishes, config: DriveConfig, velocity_limit_rad_s: float, current_limit_a: float
) -> Axis:
    """The drive after the firmware's frames, in the order in which they are sent."""
    closed, errors, reason = axis.closed, axis.active_errors, axis.disarm_reason
    torque_n_m = wishes.torque_n_m
    velocity_limit, current_limit = axis.velocity_limit_rad_s, axis.current_limit_a
    if wishes.estop:
        errors |= _ESTOP
        torque_n_m = 0.0
        if closed:
            reason = _ESTOP
        closed = False
    if wishes.clear_errors:
        errors = 0
    if wishes.limits:
        velocity_limit = max(0.0, velocity_limit_rad_s)
        current_limit = min(max(0.0, current_limit_a), config.current_limit_a)
    if wishes.idle:
        closed = False
    if wishes.closed and errors == 0 and not closed:
        closed = True
        reason = 0
        torque_n_m = 0.0
    return Axis(
        closed=closed,
        active_errors=errors,
        disarm_reason=reason,
        torque_n_m=torque_n_m,
        velocity_limit_rad_s=velocity_limit,
        current_limit_a=current_limit,
        motor_degc=axis.motor_degc,
    )


@subroutine
def torque_of(axis: Axis, config: DriveConfig, omega_rad_s: float) -> float:
    """The torque asked of the motor, within the limits of current and velocity."""
    if not axis.closed:
        return 0.0
    limit_n_m = axis.current_limit_a * config.torque_constant_n_m_a
    gain = config.velocity_gain_n_m_s
    highest = min(limit_n_m, (axis.velocity_limit_rad_s - omega_rad_s) * gain)
    lowest = max(-limit_n_m, (-axis.velocity_limit_rad_s - omega_rad_s) * gain)
    return min(max(axis.torque_n_m, lowest), highest)


@subroutine
def elapsed(axis: Axis, config: DriveConfig, dt_s: float, omega_rad_s: float, current_a: float) -> Axis:
    """A tick has passed: temperature and overspeed."""
    heating_k = config.thermal_resistance_k_w * config.resistance_ohm * current_a * current_a
    motor_degc = axis.motor_degc + (heating_k - (axis.motor_degc - config.ambient_degc)) * (
        dt_s / config.thermal_time_s
    )
    error = 0
    if axis.closed and abs(omega_rad_s) > axis.velocity_limit_rad_s * config.velocity_tolerance:
        error = _VELOCITY_LIMIT
    elif axis.closed and motor_degc > config.over_temperature_degc:
        error = _OVER_TEMPERATURE
    return Axis(
        closed=axis.closed and error == 0,
        active_errors=axis.active_errors | error,
        disarm_reason=error if error != 0 else axis.disarm_reason,
        torque_n_m=0.0 if error != 0 else axis.torque_n_m,
        velocity_limit_rad_s=axis.velocity_limit_rad_s,
        current_limit_a=axis.current_limit_a,
        motor_degc=motor_degc,
    )
