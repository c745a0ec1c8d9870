"""The motor drive: an ODrive axis in torque mode, as pure steps that run interpreted and compiled.

Positive torque and position turn the crank forward. Only what an ODrive does with its commands is modelled:
axis states, torque mode with its limits, errors that disarm, and the command watchdog. The plant turns torque
into current. Frames become these calls in `hil.drive_node`.
"""

import math
from typing import NamedTuple

from firmware_py.interface.enums import AXIS_IDLE, CLOSED_LOOP, AxisError, AxisState
from firmware_py.interface.records import (
    DriveCurrent,
    DriveErrors,
    DriveHeartbeat,
    DriveSupply,
    DriveTemperature,
    EncoderEstimates,
)
from plant_sim.kernels import shared

TORQUE_CONTROL = 1
"""ODrive's ControlMode."""
PASSTHROUGH = 1
"""ODrive's InputMode."""
SUCCESS, DISARMED, INVALID_STATE = 0, 3, 13
"""ODrive's ProcedureResult."""
TURN_RAD = 2.0 * math.pi
TIME_RESOLUTION_S = 1e-9
LARGEST_POSITION_REV = 1.0 - 2.0**-24
"""The largest float32 below 1."""
INVERTER_SHARE = 0.25
"""The inverter, on its heat sink, warms a quarter as much as the winding."""

NO_ERROR = AxisError.NONE.value
ESTOP_REQUESTED = AxisError.ESTOP_REQUESTED.value
_BAD_CONFIG = AxisError.BAD_CONFIG.value
_WATCHDOG_EXPIRED = AxisError.WATCHDOG_TIMER_EXPIRED.value
_OVERSPEED = AxisError.VELOCITY_LIMIT_VIOLATION.value
_OVER_TEMPERATURE = AxisError.MOTOR_OVER_TEMP.value
_UNDER_VOLTAGE = AxisError.DC_BUS_UNDER_VOLTAGE.value


class DriveConfig(NamedTuple):
    """The drive's configuration. Frames change nothing of it except, by `SetLimits`, the two limits."""

    torque_constant_n_m_a: float
    resistance_ohm: float
    supply_v: float
    current_limit_a: float
    velocity_limit_rad_s: float
    watchdog_s: float = 0.05
    """Without a command for this long the axis disarms: half of the 100 ms to a safe state."""
    velocity_tolerance: float = 1.2
    """ODrive's vel_limit_tolerance: beyond limit × tolerance the axis disarms."""
    velocity_gain_n_m_s: float = 0.167 / TURN_RAD
    """ODrive's vel_gain, 0.167 N m/(rev/s): how steeply torque mode gives way at the velocity limit."""
    idle_current_a: float = 0.05
    """What the electronics draw."""
    ambient_degc: float = 25.0
    thermal_resistance_k_w: float = 3.0
    """Winding to air, a gimbal motor of 80 mm: 10 A (40 W) end 120 K above ambient."""
    thermal_time_s: float = 200.0
    over_temperature_degc: float = 100.0
    """ODrive's upper limit of the motor's thermistor."""
    lowest_supply_v: float = 10.5
    """ODrive's dc_bus_undervoltage_trip_level."""


class Axis(NamedTuple):
    """What the axis does, its errors (any combination of `AxisError`), and why it last disarmed."""

    state: AxisState
    errors: int
    disarm_reason: int
    procedure_result: int


class Setpoint(NamedTuple):
    """What the axis is to do. `age_s`: time since the last command."""

    control_mode: int
    input_mode: int
    torque_n_m: float
    age_s: float


class Limits(NamedTuple):
    """The limits that a client has set."""

    velocity_rad_s: float
    current_a: float


class DriveState(NamedTuple):
    """One axis. `position_offset_rev`: what is added to the encoder's position on the bus."""

    axis: Axis
    setpoint: Setpoint
    limits: Limits
    position_offset_rev: float
    motor_degc: float


class Telemetry(NamedTuple):
    """What the drive measures at one instant."""

    current_a: float
    torque_n_m: float
    omega_rad_s: float


@shared
def power_up(config: DriveConfig) -> DriveState:
    """The axis as its supply comes on: idle, cold, with the limits of its configuration."""
    return DriveState(
        Axis(AXIS_IDLE, NO_ERROR, NO_ERROR, SUCCESS),
        Setpoint(TORQUE_CONTROL, PASSTHROUGH, 0.0, 0.0),
        Limits(config.velocity_limit_rad_s, config.current_limit_a),
        0.0,
        config.ambient_degc,
    )


# --- commands --------------------------------------------------------------------------------------


@shared
def set_torque(drive: DriveState, torque_n_m: float) -> DriveState:
    """A torque command, which feeds the watchdog."""
    axis, setpoint, limits, offset_rev, motor_degc = drive
    setpoint = Setpoint(setpoint.control_mode, setpoint.input_mode, torque_n_m, 0.0)
    return DriveState(axis, setpoint, limits, offset_rev, motor_degc)


@shared
def set_mode(drive: DriveState, control_mode: int, input_mode: int) -> DriveState:
    """What the axis controls and how its input acts; an armed axis disarms in a mode that is not modelled."""
    axis, setpoint, limits, offset_rev, motor_degc = drive
    setpoint = Setpoint(control_mode, input_mode, setpoint.torque_n_m, setpoint.age_s)
    drive = DriveState(axis, setpoint, limits, offset_rev, motor_degc)
    if is_armed(drive) and not is_modelled(setpoint):
        return disarm(drive, _BAD_CONFIG)
    return drive


@shared
def is_modelled(setpoint: Setpoint) -> bool:
    """Whether the drive can do what its mode says: torque control, passed through."""
    return setpoint.control_mode == TORQUE_CONTROL and setpoint.input_mode == PASSTHROUGH


@shared
def set_limits(config: DriveConfig, drive: DriveState, velocity_rev_s: float, current_a: float) -> DriveState:
    """New limits: at least 0, and no more current than the configuration allows."""
    axis, setpoint, _, offset_rev, motor_degc = drive
    current_a = min(max(0.0, current_a), config.current_limit_a)
    limits = Limits(max(0.0, velocity_rev_s) * TURN_RAD, current_a)
    return DriveState(axis, setpoint, limits, offset_rev, motor_degc)


@shared
def set_position(drive: DriveState, position_rev: float, encoder_position_rev: float) -> DriveState:
    """Call the encoder's present position `position_rev`."""
    axis, setpoint, limits, _, motor_degc = drive
    return DriveState(axis, setpoint, limits, position_rev - encoder_position_rev, motor_degc)


@shared
def request_state(drive: DriveState, requested: int) -> DriveState:
    """Arm, or let go. An axis with errors or in a mode that is not modelled does not arm, and says why.

    Other states are not modelled: the procedure ends with INVALID_STATE.
    """
    axis, setpoint, limits, offset_rev, motor_degc = drive
    if requested == AXIS_IDLE:
        axis = Axis(AXIS_IDLE, axis.errors, axis.disarm_reason, SUCCESS)
    elif requested == CLOSED_LOOP and axis.errors != NO_ERROR:
        axis = Axis(axis.state, axis.errors, axis.disarm_reason, DISARMED)
    elif requested == CLOSED_LOOP and not is_modelled(setpoint):
        axis = Axis(axis.state, _BAD_CONFIG, axis.disarm_reason, DISARMED)
    elif requested != CLOSED_LOOP:
        axis = Axis(axis.state, axis.errors, axis.disarm_reason, INVALID_STATE)
    elif axis.state != CLOSED_LOOP:
        axis = Axis(CLOSED_LOOP, axis.errors, NO_ERROR, SUCCESS)
        setpoint = Setpoint(setpoint.control_mode, setpoint.input_mode, 0.0, 0.0)
    return DriveState(axis, setpoint, limits, offset_rev, motor_degc)


@shared
def clear_errors(drive: DriveState) -> DriveState:
    """Forget the errors, so that the axis may arm again."""
    axis, setpoint, limits, offset_rev, motor_degc = drive
    axis = Axis(axis.state, NO_ERROR, axis.disarm_reason, axis.procedure_result)
    return DriveState(axis, setpoint, limits, offset_rev, motor_degc)


@shared
def disarm(drive: DriveState, error: int) -> DriveState:
    """Let go of the motor and say why; the error (one of `AxisError`) stays until it is cleared."""
    axis, setpoint, limits, offset_rev, motor_degc = drive
    if axis.state == CLOSED_LOOP:
        axis = Axis(AXIS_IDLE, axis.errors | error, error, DISARMED)
    else:
        axis = Axis(AXIS_IDLE, axis.errors | error, axis.disarm_reason, axis.procedure_result)
    setpoint = Setpoint(setpoint.control_mode, setpoint.input_mode, 0.0, setpoint.age_s)
    return DriveState(axis, setpoint, limits, offset_rev, motor_degc)


# --- time ------------------------------------------------------------------------------------------


@shared
def is_armed(drive: DriveState) -> bool:
    """Whether the motor carries current at all."""
    return drive.axis.state == CLOSED_LOOP


@shared
def watchdog_left_s(config: DriveConfig, drive: DriveState) -> float:
    """Time until the watchdog disarms; infinite while there is nothing to disarm."""
    return config.watchdog_s - drive.setpoint.age_s if is_armed(drive) else math.inf


@shared
def torque_n_m(config: DriveConfig, drive: DriveState, omega_rad_s: float) -> float:
    """The torque asked of the motor, within the limits of current and velocity."""
    if not is_armed(drive) or drive.setpoint.control_mode != TORQUE_CONTROL:
        return 0.0
    limits = drive.limits
    limit_n_m = limits.current_a * config.torque_constant_n_m_a
    highest = min(limit_n_m, (limits.velocity_rad_s - omega_rad_s) * config.velocity_gain_n_m_s)
    lowest = max(-limit_n_m, (-limits.velocity_rad_s - omega_rad_s) * config.velocity_gain_n_m_s)
    return min(max(drive.setpoint.torque_n_m, lowest), highest)


@shared
def elapse(
    config: DriveConfig, drive: DriveState, dt_s: float, omega_rad_s: float, current_a: float
) -> DriveState:
    """Let `dt_s` pass: watchdog, temperature and overspeed."""
    axis, setpoint, limits, offset_rev, motor_degc = drive
    age_s = setpoint.age_s + dt_s
    heating_k = config.thermal_resistance_k_w * config.resistance_ohm * current_a * current_a
    excess_k = motor_degc - config.ambient_degc
    motor_degc += (heating_k - excess_k) * dt_s / config.thermal_time_s
    setpoint = Setpoint(setpoint.control_mode, setpoint.input_mode, setpoint.torque_n_m, age_s)
    drive = DriveState(axis, setpoint, limits, offset_rev, motor_degc)
    if not is_armed(drive):
        return drive
    if age_s >= config.watchdog_s - TIME_RESOLUTION_S:
        return disarm(drive, _WATCHDOG_EXPIRED)
    if abs(omega_rad_s) > limits.velocity_rad_s * config.velocity_tolerance:
        return disarm(drive, _OVERSPEED)
    if motor_degc > config.over_temperature_degc:
        return disarm(drive, _OVER_TEMPERATURE)
    if config.supply_v < config.lowest_supply_v:
        return disarm(drive, _UNDER_VOLTAGE)
    return drive


# --- reports ---------------------------------------------------------------------------------------


@shared
def position_rev(drive: DriveState, encoder_position_rev: float) -> float:
    """The position on the bus, circular in [0, 1)."""
    return (encoder_position_rev + drive.position_offset_rev) % 1.0


@shared
def encoder_estimates(
    drive: DriveState, encoder_position_rev: float, velocity_rev_s: float
) -> EncoderEstimates:
    """0x09. The last float32 below 1 may round up to it: that is 0 again."""
    circular_rev = position_rev(drive, encoder_position_rev)
    return EncoderEstimates(circular_rev if circular_rev <= LARGEST_POSITION_REV else 0.0, velocity_rev_s)


@shared
def heartbeat(drive: DriveState) -> DriveHeartbeat:
    """0x01. The trajectory flag is 1 where there is none to follow."""
    axis = drive.axis
    return DriveHeartbeat(axis.errors, axis.state.value, axis.procedure_result, 1)


@shared
def errors(drive: DriveState) -> DriveErrors:
    """0x03."""
    return DriveErrors(drive.axis.errors, drive.axis.disarm_reason)


@shared
def current(config: DriveConfig, drive: DriveState, telemetry: Telemetry) -> DriveCurrent:
    """0x14."""
    setpoint_n_m = torque_n_m(config, drive, telemetry.omega_rad_s)
    return DriveCurrent(setpoint_n_m / config.torque_constant_n_m_a, telemetry.current_a)


@shared
def temperature(config: DriveConfig, drive: DriveState) -> DriveTemperature:
    """0x15."""
    excess_k = drive.motor_degc - config.ambient_degc
    return DriveTemperature(config.ambient_degc + INVERTER_SHARE * excess_k, drive.motor_degc)


@shared
def supply(config: DriveConfig, telemetry: Telemetry) -> DriveSupply:
    """0x17. Shaft power and copper loss over the supply's voltage."""
    power_w = telemetry.torque_n_m * telemetry.omega_rad_s
    power_w += config.resistance_ohm * telemetry.current_a * telemetry.current_a
    return DriveSupply(config.supply_v, config.idle_current_a + power_w / config.supply_v)
