"""One record a CAN frame, in physical units; `vibro.dbc` gives each its id, scaling, range and period.

The drive's frames are ODrive CANSimple 0.6 (revolutions, float32); the rest is this module's own. Frames of
the sensors, the firmware and the operator end in a rolling counter (four bits; the accelerometer's has
eight, as it dates its samples across pauses) and a CRC-8, which the codec adds and checks and which no record
carries.
"""

from typing import NamedTuple

# --- drive, node 0: ODrive CANSimple 0.6 -------------------------------------------------------------


class DriveHeartbeat(NamedTuple):
    """0x01, drive → all, every 100 ms."""

    axis_error: int
    axis_state: int
    procedure_result: int
    trajectory_done: int


class DriveEstop(NamedTuple):
    """0x02, operator or firmware → drive and firmware; no data."""


class DriveErrors(NamedTuple):
    """0x03, drive → all, every 100 ms."""

    active_errors: int
    disarm_reason: int


class SetAxisState(NamedTuple):
    """0x07, firmware → drive."""

    requested_state: int


class EncoderEstimates(NamedTuple):
    """0x09, drive → all, every tick. Position is circular in the simulated drive: [0, 1) revolutions."""

    position_rev: float
    velocity_rev_s: float


class SetControllerMode(NamedTuple):
    """0x0B, firmware → drive. Torque control is mode 1, pass-through input mode 1."""

    control_mode: int
    input_mode: int


class SetInputVelocity(NamedTuple):
    """0x0D, any CANSimple client → drive."""

    velocity_rev_s: float
    torque_feedforward_n_m: float


class SetInputTorque(NamedTuple):
    """0x0E, firmware → drive, every tick."""

    torque_n_m: float


class SetLimits(NamedTuple):
    """0x0F, firmware → drive."""

    velocity_limit_rev_s: float
    current_limit_a: float


class DriveCurrent(NamedTuple):
    """0x14, drive → all, every 10 ms: torque-producing current."""

    setpoint_a: float
    measured_a: float


class DriveTemperature(NamedTuple):
    """0x15, drive → all, every 100 ms."""

    inverter_degc: float
    motor_degc: float


class DriveSupply(NamedTuple):
    """0x17, drive → all, every 100 ms."""

    voltage_v: float
    current_a: float


class ClearErrors(NamedTuple):
    """0x18, firmware → drive."""

    identify: int


class SetAbsolutePosition(NamedTuple):
    """0x19, firmware → drive."""

    position_rev: float


# --- sensors, node 1 ----------------------------------------------------------------------------------


class Accelerometer(NamedTuple):
    """0x028, sensors → all, every tick. Low range ±16 g, high range ±200 g, both on the striker's axis."""

    striker_low_m_s2: float
    striker_high_m_s2: float
    housing_m_s2: float


class CoarsePosition(NamedTuple):
    """0x029, sensors → all, every 20 ms where the scene has one."""

    striker_position_m: float


class GaitSensors(NamedTuple):
    """0x02A, sensors → all, every 5 ms where somebody walks in the scene.

    The shank's rate is positive where its top goes forward; `along_m_s2` is the specific force along the
    shank, upward positive, gravity included.
    """

    shank_rate_rad_s: float
    along_m_s2: float
    heel_contact: int
    toe_contact: int


# --- operator, node 2 ---------------------------------------------------------------------------------


class OperatorCommand(NamedTuple):
    """0x048, operator → firmware, every 100 ms. `target_ratio` is Ω over the nominal ω.

    A `target_impulse_n_s` above 0 is what the impacts on the stop are to give, once the ratio is reached.
    """

    request: int
    target_ratio: float
    target_impulse_n_s: float = 0.0


class ParameterRequest(NamedTuple):
    """0x049, operator → firmware."""

    parameter_index: int
    operation: int
    value: float


# --- firmware, node 3 ---------------------------------------------------------------------------------


class FirmwareHeartbeat(NamedTuple):
    """0x068, firmware → all, every 100 ms."""

    mode: int
    fault: int
    acting_limit: int
    regime: int
    target_omega_rad_s: float


class StrikerEstimate(NamedTuple):
    """0x069, firmware → all, every 10 ms."""

    position_m: float
    velocity_m_s: float
    crank_omega_rad_s: float


class RegimeReport(NamedTuple):
    """0x06A, firmware → all, once a drive period. The phase is past the crank's forward dead centre."""

    regime: int
    impacts: int
    impact_phase_deg: float
    peak_acceleration_m_s2: float


class ImpactEvent(NamedTuple):
    """0x074, firmware → all, one an impact. `age_s`: from touch-down to this frame's tick."""

    age_s: float
    approach_speed_m_s: float
    impulse_n_s: float


class FaultEvent(NamedTuple):
    """0x075, firmware → all, one a fault or refusal. `disarm_reason` repeats the drive's, if it gave one."""

    fault: int
    disarm_reason: int
    refusal: int = 0


class ParameterValue(NamedTuple):
    """0x077, firmware → all: the answer to a parameter request.

    `tier` is the parameter's; MODULE where there is no such parameter.
    """

    parameter_index: int
    status: int
    value: float
    tier: int


class GaitReport(NamedTuple):
    """0x07C, firmware → all, every 40 ms where the firmware receives gait sensors.

    The phase runs from 0 at heel strike to 1; `harmonic` is the crank's turns a stride, 0 where it is not
    locked. Both counts of pulses wrap: whoever sends them takes them modulo 256.
    """

    gait_phase: float
    stride_hz: float
    confidence: float
    gait_state: int
    harmonic: int
    pulses_in_window: int
    pulses_outside: int
