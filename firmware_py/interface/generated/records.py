"""One record per CAN frame, in physical units: written by `generate.py`; do not edit.

Fields are in the order of their bits. Records contain no rolling counters and CRCs; the codec adds and checks
them.
"""

from typing import NamedTuple


class DriveHeartbeat(NamedTuple):
    """0x001, from Drive, every 100 ms. ODrive CANSimple 0.6 Heartbeat."""

    axis_error: int
    """ODrive Axis_Error: any combination of bits."""
    axis_state: int
    """ODrive Axis_State."""
    procedure_result: int
    """ODrive Procedure_Result."""
    trajectory_done: int
    """ODrive Trajectory_Done_Flag; bits 49 to 63 are not used."""


class DriveEstop(NamedTuple):
    """0x002, from Operator. ODrive CANSimple 0.6 Estop: the drive disarms with ESTOP_REQUESTED. The
    operator sends it, and the firmware repeats it.
    """


class DriveErrors(NamedTuple):
    """0x003, from Drive, every 100 ms. ODrive CANSimple 0.6 Get_Error."""

    active_errors: int
    """ODrive Active_Errors: any combination of bits."""
    disarm_reason: int
    """ODrive Disarm_Reason: the bits that disarmed the axis last."""


class SetAxisState(NamedTuple):
    """0x007, from Firmware. ODrive CANSimple 0.6 Set_Axis_State."""

    requested_state: int
    """ODrive Axis_Requested_State; bytes 4 to 7 are not used."""


class EncoderEstimates(NamedTuple):
    """0x009, from Drive, every tick. ODrive CANSimple 0.6 Get_Encoder_Estimates."""

    position_rev: float
    """ODrive Pos_Estimate. Circular in the simulated drive: 0 to 1, so that float32 keeps its
    resolution however long a run is.
    """
    velocity_rev_s: float
    """ODrive Vel_Estimate."""


class SetControllerMode(NamedTuple):
    """0x00B, from Firmware. ODrive CANSimple 0.6 Set_Controller_Mode."""

    control_mode: int
    """ODrive Control_Mode."""
    input_mode: int
    """ODrive Input_Mode."""


class SetInputVelocity(NamedTuple):
    """0x00D. ODrive CANSimple 0.6 Set_Input_Vel. No node of the bench sends it; any CANSimple client
    may.
    """

    velocity_rev_s: float
    """ODrive Input_Vel."""
    torque_feedforward_n_m: float
    """ODrive Input_Torque_FF."""


class SetInputTorque(NamedTuple):
    """0x00E, from Firmware, every tick. ODrive CANSimple 0.6 Set_Input_Torque. Feeds the drive's
    command watchdog.
    """

    torque_n_m: float
    """ODrive Input_Torque; bytes 4 to 7 are not used."""


class SetLimits(NamedTuple):
    """0x00F, from Firmware. ODrive CANSimple 0.6 Set_Limits."""

    velocity_limit_rev_s: float
    """ODrive Velocity_Limit."""
    current_limit_a: float
    """ODrive Current_Limit."""


class DriveCurrent(NamedTuple):
    """0x014, from Drive, every 10 ms. ODrive CANSimple 0.6 Get_Iq."""

    setpoint_a: float
    """ODrive Iq_Setpoint: torque-producing current."""
    measured_a: float
    """ODrive Iq_Measured: torque-producing current."""


class DriveTemperature(NamedTuple):
    """0x015, from Drive, every 100 ms. ODrive CANSimple 0.6 Get_Temperature."""

    inverter_degc: float
    """ODrive FET_Temperature."""
    motor_degc: float
    """ODrive Motor_Temperature."""


class DriveSupply(NamedTuple):
    """0x017, from Drive, every 100 ms. ODrive CANSimple 0.6 Get_Bus_Voltage_Current."""

    voltage_v: float
    """ODrive Bus_Voltage."""
    current_a: float
    """ODrive Bus_Current."""


class ClearErrors(NamedTuple):
    """0x018, from Firmware. ODrive CANSimple 0.6 Clear_Errors."""

    identify: int
    """ODrive Identify: 1 blinks the drive's light."""


class SetAbsolutePosition(NamedTuple):
    """0x019, from Firmware. ODrive CANSimple 0.6 Set_Absolute_Position."""

    position_rev: float
    """ODrive Position; bytes 4 to 7 are not used."""


class Accelerometer(NamedTuple):
    """0x028, from Sensors, every tick. Striker and housing acceleration along the striker's axis. A
    reading at full scale is clipped.
    """

    striker_low_m_s2: float
    """Striker, +-16 g at 2048 counts per g."""
    striker_high_m_s2: float
    """Striker, +-200 g at 49 mg a count: a 13-bit sensor, sign-extended."""
    housing_m_s2: float
    """Housing, +-16 g at 2048 counts per g."""


class CoarsePosition(NamedTuple):
    """0x029, from Sensors, every 20 ms. Slow absolute position of the striker, where a scene has the
    sensor.
    """

    striker_position_m: float
    """From the crank's mean position, positive towards the stop."""


class GaitSensors(NamedTuple):
    """0x02A, from Sensors, every 5 ms. The wearer's shank and foot, where a scene has somebody
    walking.
    """

    shank_rate_rad_s: float
    """Angular rate of the shank in the sagittal plane; positive if its top goes forward."""
    along_m_s2: float
    """Specific force along the shank, positive upward, gravity included: +9.8 on an upright shank at
    rest.
    """
    heel_contact: int
    """1: the heel switch is closed."""
    toe_contact: int
    """1: the toe switch is closed."""


class OperatorCommand(NamedTuple):
    """0x048, from Operator, every 100 ms. The operator's current command. If it is missing, the
    module stops.
    """

    request: int
    """Mode request."""
    target_ratio: float
    """Drive speed over the nominal natural frequency."""
    target_impulse_n_s: float
    """Requested impulse of an impact on the stop, reached by a change of the ratio within the impact
    regime or of the turns per stride; 0: no request.
    """


class XcpCommand(NamedTuple):
    """0x049, from Operator. XCP command (CMD) of a measurement and calibration system, always of
    eight bytes (MAX_DLC_REQUIRED); one at a time.
    """

    command: int
    """XCP command code. Unknown codes are answered, so no values are listed."""
    low: int
    """Bytes 1 to 3."""
    high: int
    """Bytes 4 to 7."""


class FirmwareHeartbeat(NamedTuple):
    """0x068, from Firmware, every 100 ms. Status of the firmware."""

    mode: int
    """Supervisor mode."""
    acting_limit: int
    """Limit that acts on the torque."""
    fault: int
    """Latched fault."""
    target_omega_rad_s: float
    """Target speed of the speed loop."""
    regime: int
    """Regime decision."""


class StrikerEstimate(NamedTuple):
    """0x069, from Firmware, every 10 ms. The estimator's state."""

    position_m: float
    """From the crank's mean position, positive towards the stop."""
    velocity_m_s: float
    """Positive towards the stop."""
    crank_omega_rad_s: float
    """Crank speed."""


class RegimeReport(NamedTuple):
    """0x06A, from Firmware. Summary of one drive period, sent at its end."""

    impacts: int
    """Impacts within the period; 255 means 255 or more."""
    impact_phase_deg: float
    """Crank angle of the last impact past the forward dead centre; 0 without one."""
    peak_acceleration_m_s2: float
    """Largest magnitude of striker acceleration within the period."""
    regime: int
    """Regime decision."""


class ImpactEvent(NamedTuple):
    """0x074, from Firmware. One detected impact."""

    age_s: float
    """From touch-down to the tick that sent this frame."""
    approach_speed_m_s: float
    """Striker speed at touch-down."""
    impulse_n_s: float
    """Impulse on the stop."""


class FaultEvent(NamedTuple):
    """0x075, from Firmware. A fault at the moment it latches, or a request at the moment it is
    refused; a refusal latches nothing.
    """

    disarm_reason: int
    """The drive's disarm reason, where it gave one."""
    fault: int
    """Reason of disarming."""
    refusal: int
    """Reason of a refusal; NONE with a fault."""


class GaitReport(NamedTuple):
    """0x07C, from Firmware, every 40 ms. Estimate of the wearer's gait, and the crank's lock to it."""

    gait_phase: float
    """Phase of the gait cycle since heel strike; 0 if there is no estimate."""
    stride_hz: float
    """Gait cycles per second."""
    harmonic: int
    """Crank turns per stride at which the crank is locked; 0: not locked."""
    gait_state: int
    """State of the leg."""
    pulses_in_window: int
    """Pulses within the push-off window since power-up, modulo 256."""
    pulses_outside: int
    """Pulses outside of the push-off window since power-up, modulo 256."""
    confidence: float
    """Confidence in phase and frequency: 0 none, 1 full."""


class XcpResponse(NamedTuple):
    """0x07E, from Firmware. XCP response (RES), error (ERR) or measured sample (DAQ), always of eight
    bytes.
    """

    packet: int
    """XCP packet identifier: 255 response, 254 error, otherwise the number of the sample's ODT."""
    low: int
    """Bytes 1 to 3."""
    high: int
    """Bytes 4 to 7."""
