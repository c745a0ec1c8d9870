"""The motor drive: an ODrive axis, as pure steps that run interpreted and compiled.

Positive torque and position turn the crank forward. The model covers an ODrive's reaction to its commands:
torque mode and velocity mode with their limits, calibration, errors that disarm, and the command watchdog.
Commands that are not modelled end in the protocol's own error. The plant converts torque to current.
`hil.drive.node` translates frames into these calls.

Velocity mode is ODrive's controller: a proportional and an integrating term on the speed's error, beside the
feed-forward; it runs once a tick, where an ODrive runs it 8,000 times a second.
"""

import math
from typing import NamedTuple

from firmware_py.interface.enums import AxisError, AxisState
from plant_sim.kernels import subroutine

TORQUE_CONTROL, VELOCITY_CONTROL = 1, 2
"""ODrive's ControlMode."""
PASSTHROUGH, VELOCITY_RAMP = 1, 2
"""ODrive's InputMode."""
SUCCESS, BUSY, CANCELLED, DISARMED, ENCODER_MISMATCH, NO_END_STOP, INVALID_STATE = 0, 1, 2, 3, 5, 12, 13
"""ODrive's ProcedureResult; ENCODER_MISMATCH is its POLE_PAIR_CPR_MISMATCH."""
UNDEFINED, VOLTAGE_CONTROL, INACTIVE = 0, 0, 0
"""AxisState, ControlMode and InputMode that replace a requested number that ODrive does not define."""
AXIS_IDLE, CLOSED_LOOP = AxisState.IDLE, AxisState.CLOSED_LOOP_CONTROL
FULL_CALIBRATION = AxisState.FULL_CALIBRATION_SEQUENCE
MOTOR_CALIBRATION = AxisState.MOTOR_CALIBRATION
ENCODER_CALIBRATION = AxisState.ENCODER_OFFSET_CALIBRATION
HOMING = AxisState.HOMING
TURN_RAD = 2.0 * math.pi
TIME_RESOLUTION_S = 1e-9
LARGEST_POSITION_REV = 1.0 - 2.0**-24
"""The largest float32 below 1."""
INVERTER_SHARE = 0.25
"""Temperature rise of the inverter, on its heat sink, as a share of the winding's temperature rise."""

NO_ERROR = AxisError.NONE.value
ESTOP_REQUESTED = AxisError.ESTOP_REQUESTED.value
BAD_CONFIG = AxisError.BAD_CONFIG.value
"""The answer to a mode or a message that is not modelled."""
_WATCHDOG_EXPIRED = AxisError.WATCHDOG_TIMER_EXPIRED.value
_OVERSPEED = AxisError.VELOCITY_LIMIT_VIOLATION.value
_OVER_TEMPERATURE = AxisError.MOTOR_OVER_TEMP.value
_UNDER_VOLTAGE = AxisError.DC_BUS_UNDER_VOLTAGE.value
_CALIBRATION_FAILED = AxisError.CALIBRATION_ERROR.value


class DriveConfig(NamedTuple):
    """The drive's configuration. The limits are initial values: the frame `SetLimits` changes them."""

    torque_constant_n_m_a: float
    resistance_ohm: float
    supply_v: float
    current_limit_a: float
    velocity_limit_rad_s: float
    watchdog_s: float = 0.05
    """Longest time without a command before the axis disarms: half of the 100 ms to a safe state.

    Infinite: the watchdog is off."""
    is_fed_by_every_frame: bool = False
    """Whether every frame to the drive resets the watchdog, as a real ODrive's; else only a setpoint does."""
    velocity_tolerance: float = 1.2
    """ODrive's vel_limit_tolerance: the axis disarms above limit × tolerance."""
    velocity_gain_n_m_s: float = 0.167 / TURN_RAD
    """ODrive's vel_gain, 0.167 N m/(rev/s); also the slope of torque mode's limit near the velocity limit."""
    integrator_gain_n_m: float = 0.333 / TURN_RAD
    """ODrive's vel_integrator_gain, 0.333 N m/rev: torque per radian of integrated speed error."""
    integrator_leak_s: float = 0.0125
    """Decay time of the integral at the current limit: ODrive's decays by 1 % in 1/8,000 s."""
    ramp_rad_s2: float = TURN_RAD
    """ODrive's vel_ramp_rate, 1 rev/s²."""
    control_mode: int = TORQUE_CONTROL
    """ODrive's control_mode at power-up."""
    motor_calibration_s: float = 4.0
    """Approximate time in which an ODrive measures resistance and inductance, with the rotor at rest."""
    scan_s: float = 4.0
    """Duration of an ODrive's encoder calibration in one direction: eight electrical turns, two a second."""
    scan_rad_s: float = 2.0 * TURN_RAD / 7.0
    """Two electrical turns a second with seven pole pairs."""
    idle_current_a: float = 0.05
    """Supply current of the electronics."""
    node_id: int = 0
    """The drive's node number on its bus."""
    ambient_degc: float = 25.0
    thermal_resistance_k_w: float = 3.0
    """Winding to air, for a gimbal motor of 80 mm: at 10 A (40 W) the winding settles 120 K above ambient."""
    thermal_time_s: float = 200.0
    over_temperature_degc: float = 100.0
    """ODrive's upper limit of the motor's thermistor."""
    lowest_supply_v: float = 10.5
    """ODrive's dc_bus_undervoltage_trip_level."""


class Axis(NamedTuple):
    """State of the axis, its errors (any combination of `AxisError`), and its last reason for disarming."""

    state: AxisState
    errors: int
    disarm_reason: int
    procedure_result: int


class Setpoint(NamedTuple):
    """Commanded mode, torque and velocity. `age_s`: time since the last command.

    In velocity mode `torque_n_m` is the feed-forward. Torque mode ignores `velocity_rad_s`.
    """

    control_mode: int
    input_mode: int
    torque_n_m: float
    velocity_rad_s: float
    age_s: float


class Limits(NamedTuple):
    """The limits set by a client."""

    velocity_rad_s: float
    current_a: float


class VelocityLoop(NamedTuple):
    """State of the velocity loop, which velocity mode and calibration use.

    `target_rad_s`: commanded speed. `elapsed_s`, `turned_rad`: time and crank angle since the beginning of a
    calibration.
    """

    target_rad_s: float
    integral_n_m: float
    elapsed_s: float
    turned_rad: float


class DriveState(NamedTuple):
    """State of the drive. `position_offset_rev` is added to the encoder's position on the bus."""

    axis: Axis
    setpoint: Setpoint
    limits: Limits
    position_offset_rev: float
    motor_degc: float
    loop: VelocityLoop


class Telemetry(NamedTuple):
    """The drive's measurements at one instant."""

    current_a: float
    torque_n_m: float
    omega_rad_s: float


@subroutine
def power_up(config: DriveConfig) -> DriveState:
    """The drive at power-up: idle, cold, with the limits of its configuration."""
    return DriveState(
        Axis(AXIS_IDLE, NO_ERROR, NO_ERROR, SUCCESS),
        Setpoint(config.control_mode, PASSTHROUGH, 0.0, 0.0, 0.0),
        Limits(config.velocity_limit_rad_s, config.current_limit_a),
        0.0,
        config.ambient_degc,
        VelocityLoop(0.0, 0.0, 0.0, 0.0),
    )


# --- commands --------------------------------------------------------------------------------------


@subroutine
def set_torque(drive: DriveState, torque_n_m: float) -> DriveState:
    """Apply a torque command and reset the watchdog; in velocity mode the torque is the feed-forward."""
    return drive._replace(setpoint=drive.setpoint._replace(torque_n_m=torque_n_m, age_s=0.0))


@subroutine
def set_velocity(drive: DriveState, velocity_rev_s: float, torque_n_m: float) -> DriveState:
    """Apply a velocity command and reset the watchdog; in torque mode only its feed-forward torque acts."""
    velocity_rad_s = velocity_rev_s * TURN_RAD
    setpoint = drive.setpoint._replace(torque_n_m=torque_n_m, velocity_rad_s=velocity_rad_s, age_s=0.0)
    return drive._replace(setpoint=setpoint)


@subroutine
def set_mode(drive: DriveState, control_mode: int, input_mode: int) -> DriveState:
    """Set control mode and input mode; an armed axis disarms if the mode is not modelled."""
    setpoint, loop = drive.setpoint, drive.loop
    if setpoint.control_mode != control_mode:
        loop = loop._replace(target_rad_s=setpoint.velocity_rad_s, integral_n_m=0.0)
    setpoint = setpoint._replace(control_mode=control_mode, input_mode=input_mode)
    drive = drive._replace(setpoint=setpoint, loop=loop)
    if is_armed(drive) and not is_modelled(setpoint):
        return disarm(drive, BAD_CONFIG)
    return drive


@subroutine
def is_modelled(setpoint: Setpoint) -> bool:
    """Whether the mode is modelled: torque with passthrough, velocity with passthrough or ramp."""
    if setpoint.input_mode == PASSTHROUGH:
        return setpoint.control_mode in (TORQUE_CONTROL, VELOCITY_CONTROL)
    return setpoint.input_mode == VELOCITY_RAMP and setpoint.control_mode == VELOCITY_CONTROL


@subroutine
def set_limits(config: DriveConfig, drive: DriveState, velocity_rev_s: float, current_a: float) -> DriveState:
    """Set the limits: not negative, and the current limit at most the configuration's."""
    current_a = min(max(0.0, current_a), config.current_limit_a)
    return drive._replace(limits=Limits(max(0.0, velocity_rev_s) * TURN_RAD, current_a))


@subroutine
def set_position(drive: DriveState, position_rev: float, encoder_position_rev: float) -> DriveState:
    """Set the offset so that the encoder's present position is reported as `position_rev`."""
    return drive._replace(position_offset_rev=position_rev - encoder_position_rev)


@subroutine
def request_state(drive: DriveState, requested: int) -> DriveState:
    """Arm, calibrate, or disarm the axis; a refusal appears in its procedure result.

    An axis with errors or in a mode that is not modelled does not arm. Homing ends with NO_END_STOP. Other
    states are not modelled: the procedure ends with INVALID_STATE.
    """
    axis, setpoint, loop = drive.axis, drive.setpoint, drive.loop
    if requested == AXIS_IDLE:
        result = CANCELLED if is_calibration(axis.state) else SUCCESS
        axis = axis._replace(state=AXIS_IDLE, procedure_result=result)
    elif requested not in (CLOSED_LOOP, HOMING) and not is_calibration(requested):
        axis = axis._replace(procedure_result=INVALID_STATE)
    elif axis.errors != NO_ERROR:
        axis = axis._replace(procedure_result=DISARMED)
    elif requested == HOMING:
        axis = axis._replace(state=AXIS_IDLE, procedure_result=NO_END_STOP)
    elif requested == CLOSED_LOOP and not is_modelled(setpoint):
        axis = axis._replace(errors=BAD_CONFIG, procedure_result=DISARMED)
    elif axis.state != requested:
        result = SUCCESS if requested == CLOSED_LOOP else BUSY
        axis = Axis(armed_state(requested), axis.errors, NO_ERROR, result)
        setpoint = setpoint._replace(torque_n_m=0.0, velocity_rad_s=0.0, age_s=0.0)
        loop = VelocityLoop(0.0, 0.0, 0.0, 0.0)
    return drive._replace(axis=axis, setpoint=setpoint, loop=loop)


@subroutine
def is_calibration(state: int) -> bool:
    """Whether `state` is a modelled calibration."""
    return state in (FULL_CALIBRATION, MOTOR_CALIBRATION, ENCODER_CALIBRATION)


@subroutine
def armed_state(requested: int) -> AxisState:
    """The armed state with the requested number: a calibration, or closed loop."""
    if requested == FULL_CALIBRATION:
        return FULL_CALIBRATION
    if requested == MOTOR_CALIBRATION:
        return MOTOR_CALIBRATION
    return ENCODER_CALIBRATION if requested == ENCODER_CALIBRATION else CLOSED_LOOP


@subroutine
def clear_errors(drive: DriveState) -> DriveState:
    """Clear the errors, so that the axis may arm again."""
    return drive._replace(axis=drive.axis._replace(errors=NO_ERROR))


@subroutine
def disarm(drive: DriveState, error: int) -> DriveState:
    """Disarm the axis with an error (one of `AxisError`), which stays until it is cleared."""
    axis = drive.axis._replace(state=AXIS_IDLE, errors=drive.axis.errors | error)
    if is_armed(drive):
        axis = axis._replace(disarm_reason=error, procedure_result=DISARMED)
    return drive._replace(axis=axis, setpoint=drive.setpoint._replace(torque_n_m=0.0, velocity_rad_s=0.0))


@subroutine
def feed_watchdog(drive: DriveState) -> DriveState:
    """Reset the watchdog without a setpoint."""
    return drive._replace(setpoint=drive.setpoint._replace(age_s=0.0))


# --- time ------------------------------------------------------------------------------------------


@subroutine
def is_armed(drive: DriveState) -> bool:
    """Whether the axis is armed, so that the motor can carry current."""
    return drive.axis.state != AXIS_IDLE


@subroutine
def watchdog_left_s(config: DriveConfig, drive: DriveState) -> float:
    """Time until the watchdog disarms the axis; infinite in states that expect no commands."""
    return config.watchdog_s - drive.setpoint.age_s if drive.axis.state == CLOSED_LOOP else math.inf


@subroutine
def torque_n_m(config: DriveConfig, drive: DriveState, omega_rad_s: float) -> float:
    """Torque requested of the motor, within the limits of current and velocity."""
    if not is_armed(drive):
        return 0.0
    limits = drive.limits
    limit_n_m = limits.current_a * config.torque_constant_n_m_a
    if holds_velocity(drive):
        return min(max(velocity_torque_n_m(config, drive, omega_rad_s), -limit_n_m), limit_n_m)
    highest = min(limit_n_m, (limits.velocity_rad_s - omega_rad_s) * config.velocity_gain_n_m_s)
    lowest = max(-limit_n_m, (-limits.velocity_rad_s - omega_rad_s) * config.velocity_gain_n_m_s)
    return min(max(drive.setpoint.torque_n_m, lowest), highest)


@subroutine
def elapse(  # noqa: PLR0911 - one cause to disarm after the other
    config: DriveConfig, drive: DriveState, dt_s: float, omega_rad_s: float, current_a: float
) -> DriveState:
    """Advance by `dt_s`: watchdog, temperature, overspeed and supply, then velocity mode or a calibration."""
    axis, limits, motor_degc = drive.axis, drive.limits, drive.motor_degc
    age_s = drive.setpoint.age_s + dt_s
    heating_k = config.thermal_resistance_k_w * config.resistance_ohm * current_a * current_a
    excess_k = motor_degc - config.ambient_degc
    motor_degc += (heating_k - excess_k) * dt_s / config.thermal_time_s
    drive = drive._replace(setpoint=drive.setpoint._replace(age_s=age_s), motor_degc=motor_degc)
    if not is_armed(drive):
        return drive
    if axis.state == CLOSED_LOOP and age_s >= config.watchdog_s - TIME_RESOLUTION_S:
        return disarm(drive, _WATCHDOG_EXPIRED)
    if abs(omega_rad_s) > limits.velocity_rad_s * config.velocity_tolerance:
        return disarm(drive, _OVERSPEED)
    if motor_degc > config.over_temperature_degc:
        return disarm(drive, _OVER_TEMPERATURE)
    if config.supply_v < config.lowest_supply_v:
        return disarm(drive, _UNDER_VOLTAGE)
    if not holds_velocity(drive):
        return drive
    drive = regulate(config, drive, dt_s, omega_rad_s)
    return drive if axis.state == CLOSED_LOOP else calibrate(config, drive, dt_s, omega_rad_s)


# --- velocity mode ---------------------------------------------------------------------------------


@subroutine
def holds_velocity(drive: DriveState) -> bool:
    """Whether an armed axis controls speed, not torque."""
    return drive.axis.state != CLOSED_LOOP or drive.setpoint.control_mode == VELOCITY_CONTROL


@subroutine
def velocity_torque_n_m(config: DriveConfig, drive: DriveState, omega_rad_s: float) -> float:
    """Torque of the velocity loop before the current limit."""
    error_rad_s = target_rad_s(config, drive, 0.0) - omega_rad_s
    torque_n_m = config.velocity_gain_n_m_s * error_rad_s + drive.loop.integral_n_m
    if drive.axis.state == CLOSED_LOOP and drive.setpoint.input_mode == PASSTHROUGH:
        torque_n_m += drive.setpoint.torque_n_m
    return torque_n_m


@subroutine
def target_rad_s(config: DriveConfig, drive: DriveState, dt_s: float) -> float:
    """Target speed `dt_s` from now, within the velocity limit: command, ramp, or calibration scan."""
    _, setpoint, limits, _, _, loop = drive
    wanted_rad_s = setpoint.velocity_rad_s
    if drive.axis.state != CLOSED_LOOP:
        wanted_rad_s = scan_rad_s(config, drive)
    elif setpoint.input_mode == VELOCITY_RAMP:
        step_rad_s = config.ramp_rad_s2 * dt_s
        wanted_rad_s = loop.target_rad_s + min(max(wanted_rad_s - loop.target_rad_s, -step_rad_s), step_rad_s)
    return min(max(wanted_rad_s, -limits.velocity_rad_s), limits.velocity_rad_s)


@subroutine
def regulate(config: DriveConfig, drive: DriveState, dt_s: float, omega_rad_s: float) -> DriveState:
    """Advance the velocity loop by `dt_s`: its ramp and its integral, which decays at the current limit."""
    integral_n_m = drive.loop.integral_n_m
    limit_n_m = drive.limits.current_a * config.torque_constant_n_m_a
    reached_rad_s = target_rad_s(config, drive, dt_s)
    if abs(velocity_torque_n_m(config, drive, omega_rad_s)) > limit_n_m:
        integral_n_m -= integral_n_m * min(1.0, dt_s / config.integrator_leak_s)
    else:
        integral_n_m += config.integrator_gain_n_m * (reached_rad_s - omega_rad_s) * dt_s
    return drive._replace(loop=drive.loop._replace(target_rad_s=reached_rad_s, integral_n_m=integral_n_m))


# --- calibration -----------------------------------------------------------------------------------


@subroutine
def scan_begins_s(config: DriveConfig, state: AxisState) -> float:
    """Time from the beginning of a calibration until it turns the crank."""
    return 0.0 if state == ENCODER_CALIBRATION else config.motor_calibration_s


@subroutine
def scan_rad_s(config: DriveConfig, drive: DriveState) -> float:
    """Crank speed in a calibration: 0 for the motor's, forward and then back for the encoder's."""
    state, elapsed_s = drive.axis.state, drive.loop.elapsed_s - scan_begins_s(config, drive.axis.state)
    if state == MOTOR_CALIBRATION or elapsed_s < 0.0:
        return 0.0
    return config.scan_rad_s if elapsed_s < config.scan_s else -config.scan_rad_s


@subroutine
def calibrate(config: DriveConfig, drive: DriveState, dt_s: float, omega_rad_s: float) -> DriveState:
    """Advance a calibration by `dt_s`; a crank that does not follow the scan ends it with an error."""
    axis, before_s = drive.axis, drive.loop.elapsed_s
    elapsed_s, turned_rad = before_s + dt_s, drive.loop.turned_rad + omega_rad_s * dt_s
    drive = drive._replace(loop=drive.loop._replace(elapsed_s=elapsed_s, turned_rad=turned_rad))
    turns_s = scan_begins_s(config, axis.state) + config.scan_s
    ends_s = config.motor_calibration_s if axis.state == MOTOR_CALIBRATION else turns_s + config.scan_s
    if elapsed_s >= ends_s - TIME_RESOLUTION_S:
        return drive._replace(axis=axis._replace(state=AXIS_IDLE, procedure_result=SUCCESS))
    if before_s < turns_s <= elapsed_s and turned_rad < 0.5 * config.scan_rad_s * config.scan_s:
        drive = disarm(drive, _CALIBRATION_FAILED)
        return drive._replace(axis=drive.axis._replace(procedure_result=ENCODER_MISMATCH))
    return drive
