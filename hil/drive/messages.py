"""What the drive says of itself: the contents of its messages."""

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
from plant_sim.kernels import shared


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
