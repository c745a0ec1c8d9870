"""The contents of the drive's reports."""

from firmware_py.interface.generated.records import (
    DriveCurrent,
    DriveErrors,
    DriveHeartbeat,
    DriveSupply,
    DriveTemperature,
    EncoderEstimates,
)
from hil.drive.axis import (
    INVERTER_SHARE,
    LARGEST_POSITION_REV,
    DriveConfig,
    DriveState,
    Telemetry,
    torque_n_m,
)
from plant_sim.kernels import subroutine


@subroutine
def position_rev(drive: DriveState, encoder_position_rev: float) -> float:
    """The position on the bus, circular in [0, 1)."""
    return (encoder_position_rev + drive.position_offset_rev) % 1.0


@subroutine
def encoder_estimates(
    drive: DriveState, encoder_position_rev: float, velocity_rev_s: float
) -> EncoderEstimates:
    """Frame 0x09. A position that float32 would round up to 1 is reported as 0."""
    circular_rev = position_rev(drive, encoder_position_rev)
    return EncoderEstimates(circular_rev if circular_rev <= LARGEST_POSITION_REV else 0.0, velocity_rev_s)


@subroutine
def heartbeat(drive: DriveState) -> DriveHeartbeat:
    """Frame 0x01. The flag for a finished trajectory is 1, since trajectories are not modelled."""
    axis = drive.axis
    return DriveHeartbeat(axis.errors, axis.state.value, axis.procedure_result, 1)


@subroutine
def errors(drive: DriveState) -> DriveErrors:
    """Frame 0x03."""
    return DriveErrors(drive.axis.errors, drive.axis.disarm_reason)


@subroutine
def current(config: DriveConfig, drive: DriveState, telemetry: Telemetry) -> DriveCurrent:
    """Frame 0x14."""
    setpoint_n_m = torque_n_m(config, drive, telemetry.omega_rad_s)
    return DriveCurrent(setpoint_n_m / config.torque_constant_n_m_a, telemetry.current_a)


@subroutine
def temperature(config: DriveConfig, drive: DriveState) -> DriveTemperature:
    """Frame 0x15."""
    excess_k = drive.motor_degc - config.ambient_degc
    return DriveTemperature(config.ambient_degc + INVERTER_SHARE * excess_k, drive.motor_degc)


@subroutine
def supply(config: DriveConfig, telemetry: Telemetry) -> DriveSupply:
    """Frame 0x17. The current is (shaft power + copper loss) / supply voltage, plus the idle current."""
    power_w = telemetry.torque_n_m * telemetry.omega_rad_s
    power_w += config.resistance_ohm * telemetry.current_a * telemetry.current_a
    return DriveSupply(config.supply_v, config.idle_current_a + power_w / config.supply_v)
