"""Records to 64-bit words and back: written by `generate.py` out of `vibro.dbc`; do not edit.

A frame's data is a signed 64-bit word: byte 0 in the lowest bits, unused high bytes 0. All of it is the
firmware's subset, so that one source runs interpreted, compiled and on a microcontroller.

`pack_x(record, counter)` gives `(word, sendable)`. Quantities saturate at full scale, in counts; a record
with NaN, an infinity or a value outside its list is not sendable, and its word is 0. Frames without a
rolling counter ignore `counter`.
`unpack_x(length, word)` gives `(record, reason)`; the record may be used only if the reason is NONE.
"""

from math import isfinite

from firmware_py.interface.crc import TABLE
from firmware_py.interface.errors import FrameErrorReason
from firmware_py.interface.float32 import FLOAT32_OVERFLOW, float32_bits, float32_of
from firmware_py.interface.records import (
    Accelerometer,
    ClearErrors,
    CoarsePosition,
    DriveCurrent,
    DriveErrors,
    DriveEstop,
    DriveHeartbeat,
    DriveSupply,
    DriveTemperature,
    EncoderEstimates,
    FaultEvent,
    FirmwareHeartbeat,
    GaitReport,
    GaitSensors,
    ImpactEvent,
    OperatorCommand,
    ParameterRequest,
    ParameterValue,
    RegimeReport,
    SetAbsolutePosition,
    SetAxisState,
    SetControllerMode,
    SetInputTorque,
    SetInputVelocity,
    SetLimits,
    StrikerEstimate,
)

OK = FrameErrorReason.NONE
LENGTH = FrameErrorReason.LENGTH
CRC = FrameErrorReason.CRC
RANGE = FrameErrorReason.RANGE
ENUMERATION = FrameErrorReason.ENUMERATION
NOT_FINITE = FrameErrorReason.NOT_FINITE

DRIVE_HEARTBEAT_ID = 0x001
DRIVE_HEARTBEAT_LENGTH = 8
DRIVE_HEARTBEAT_PERIOD_S = 0.1

DRIVE_ESTOP_ID = 0x002
DRIVE_ESTOP_LENGTH = 0

DRIVE_ERRORS_ID = 0x003
DRIVE_ERRORS_LENGTH = 8
DRIVE_ERRORS_PERIOD_S = 0.1

SET_AXIS_STATE_ID = 0x007
SET_AXIS_STATE_LENGTH = 8

ENCODER_ESTIMATES_ID = 0x009
ENCODER_ESTIMATES_LENGTH = 8
ENCODER_ESTIMATES_PERIOD_S = 0.001

SET_CONTROLLER_MODE_ID = 0x00B
SET_CONTROLLER_MODE_LENGTH = 8

SET_INPUT_VELOCITY_ID = 0x00D
SET_INPUT_VELOCITY_LENGTH = 8

SET_INPUT_TORQUE_ID = 0x00E
SET_INPUT_TORQUE_LENGTH = 8
SET_INPUT_TORQUE_PERIOD_S = 0.001

SET_LIMITS_ID = 0x00F
SET_LIMITS_LENGTH = 8

DRIVE_CURRENT_ID = 0x014
DRIVE_CURRENT_LENGTH = 8
DRIVE_CURRENT_PERIOD_S = 0.01

DRIVE_TEMPERATURE_ID = 0x015
DRIVE_TEMPERATURE_LENGTH = 8
DRIVE_TEMPERATURE_PERIOD_S = 0.1

DRIVE_SUPPLY_ID = 0x017
DRIVE_SUPPLY_LENGTH = 8
DRIVE_SUPPLY_PERIOD_S = 0.1

CLEAR_ERRORS_ID = 0x018
CLEAR_ERRORS_LENGTH = 1

SET_ABSOLUTE_POSITION_ID = 0x019
SET_ABSOLUTE_POSITION_LENGTH = 8

ACCELEROMETER_ID = 0x028
ACCELEROMETER_LENGTH = 8
ACCELEROMETER_PERIOD_S = 0.001
ACCELEROMETER_COUNTER_BITS = 8

COARSE_POSITION_ID = 0x029
COARSE_POSITION_LENGTH = 4
COARSE_POSITION_PERIOD_S = 0.02
COARSE_POSITION_COUNTER_BITS = 4

GAIT_SENSORS_ID = 0x02A
GAIT_SENSORS_LENGTH = 6
GAIT_SENSORS_PERIOD_S = 0.005
GAIT_SENSORS_COUNTER_BITS = 4

OPERATOR_COMMAND_ID = 0x048
OPERATOR_COMMAND_LENGTH = 7
OPERATOR_COMMAND_PERIOD_S = 0.1
OPERATOR_COMMAND_COUNTER_BITS = 4

PARAMETER_REQUEST_ID = 0x049
PARAMETER_REQUEST_LENGTH = 8
PARAMETER_REQUEST_COUNTER_BITS = 4

FIRMWARE_HEARTBEAT_ID = 0x068
FIRMWARE_HEARTBEAT_LENGTH = 6
FIRMWARE_HEARTBEAT_PERIOD_S = 0.1
FIRMWARE_HEARTBEAT_COUNTER_BITS = 4

STRIKER_ESTIMATE_ID = 0x069
STRIKER_ESTIMATE_LENGTH = 8
STRIKER_ESTIMATE_PERIOD_S = 0.01
STRIKER_ESTIMATE_COUNTER_BITS = 4

REGIME_REPORT_ID = 0x06A
REGIME_REPORT_LENGTH = 7
REGIME_REPORT_COUNTER_BITS = 4

IMPACT_EVENT_ID = 0x074
IMPACT_EVENT_LENGTH = 8
IMPACT_EVENT_COUNTER_BITS = 4

FAULT_EVENT_ID = 0x075
FAULT_EVENT_LENGTH = 7
FAULT_EVENT_COUNTER_BITS = 4

PARAMETER_VALUE_ID = 0x077
PARAMETER_VALUE_LENGTH = 8
PARAMETER_VALUE_COUNTER_BITS = 4

GAIT_REPORT_ID = 0x07C
GAIT_REPORT_LENGTH = 8
GAIT_REPORT_PERIOD_S = 0.04
GAIT_REPORT_COUNTER_BITS = 4


def pack_drive_heartbeat(record: DriveHeartbeat, _counter: int) -> tuple[int, bool]:
    axis_error, axis_state, procedure_result, trajectory_done = record
    if not (
        0 <= axis_error <= 4294967295
        and 0 <= axis_state <= 14
        and 0 <= procedure_result <= 15
        and 0 <= trajectory_done <= 1
    ):
        return 0, False
    return axis_error | axis_state << 32 | procedure_result << 40 | trajectory_done << 48, True


NO_DRIVE_HEARTBEAT = DriveHeartbeat(0, 0, 0, 0)


def unpack_drive_heartbeat(length: int, word: int) -> tuple[DriveHeartbeat, FrameErrorReason]:
    if length != 8:
        return NO_DRIVE_HEARTBEAT, LENGTH
    axis_error = word & 0xFFFFFFFF
    axis_state = word >> 32 & 0xFF
    if not (0 <= axis_state <= 14):
        return NO_DRIVE_HEARTBEAT, ENUMERATION
    procedure_result = word >> 40 & 0xFF
    if not (0 <= procedure_result <= 15):
        return NO_DRIVE_HEARTBEAT, ENUMERATION
    trajectory_done = word >> 48 & 0x1
    return DriveHeartbeat(axis_error, axis_state, procedure_result, trajectory_done), OK


def pack_drive_estop(_record: DriveEstop, _counter: int) -> tuple[int, bool]:
    return 0, True


NO_DRIVE_ESTOP = DriveEstop()


def unpack_drive_estop(length: int, _word: int) -> tuple[DriveEstop, FrameErrorReason]:
    if length != 0:
        return NO_DRIVE_ESTOP, LENGTH
    return DriveEstop(), OK


def pack_drive_errors(record: DriveErrors, _counter: int) -> tuple[int, bool]:
    active_errors, disarm_reason = record
    if not (0 <= active_errors <= 4294967295 and 0 <= disarm_reason <= 4294967295):
        return 0, False
    return active_errors | (disarm_reason ^ 0x80000000) - 0x80000000 << 32, True


NO_DRIVE_ERRORS = DriveErrors(0, 0)


def unpack_drive_errors(length: int, word: int) -> tuple[DriveErrors, FrameErrorReason]:
    if length != 8:
        return NO_DRIVE_ERRORS, LENGTH
    active_errors = word & 0xFFFFFFFF
    disarm_reason = word >> 32 & 0xFFFFFFFF
    return DriveErrors(active_errors, disarm_reason), OK


def pack_set_axis_state(record: SetAxisState, _counter: int) -> tuple[int, bool]:
    (requested_state,) = record
    if not (0 <= requested_state <= 14):
        return 0, False
    return requested_state, True


NO_SET_AXIS_STATE = SetAxisState(0)


def unpack_set_axis_state(length: int, word: int) -> tuple[SetAxisState, FrameErrorReason]:
    if length != 8:
        return NO_SET_AXIS_STATE, LENGTH
    requested_state = word & 0xFFFFFFFF
    if not (0 <= requested_state <= 14):
        return NO_SET_AXIS_STATE, ENUMERATION
    return SetAxisState(requested_state), OK


def pack_encoder_estimates(record: EncoderEstimates, _counter: int) -> tuple[int, bool]:
    position_rev, velocity_rev_s = record
    if not (
        -FLOAT32_OVERFLOW < position_rev < FLOAT32_OVERFLOW
        and -FLOAT32_OVERFLOW < velocity_rev_s < FLOAT32_OVERFLOW
    ):
        return 0, False
    position_rev_counts = float32_bits(position_rev)
    velocity_rev_s_counts = float32_bits(velocity_rev_s)
    return position_rev_counts | (velocity_rev_s_counts ^ 0x80000000) - 0x80000000 << 32, True


NO_ENCODER_ESTIMATES = EncoderEstimates(0.0, 0.0)


def unpack_encoder_estimates(length: int, word: int) -> tuple[EncoderEstimates, FrameErrorReason]:
    if length != 8:
        return NO_ENCODER_ESTIMATES, LENGTH
    position_rev = float32_of(word & 0xFFFFFFFF)
    if not isfinite(position_rev):
        return NO_ENCODER_ESTIMATES, NOT_FINITE
    velocity_rev_s = float32_of(word >> 32 & 0xFFFFFFFF)
    if not isfinite(velocity_rev_s):
        return NO_ENCODER_ESTIMATES, NOT_FINITE
    return EncoderEstimates(position_rev, velocity_rev_s), OK


def pack_set_controller_mode(record: SetControllerMode, _counter: int) -> tuple[int, bool]:
    control_mode, input_mode = record
    if not (0 <= control_mode <= 3 and 0 <= input_mode <= 8):
        return 0, False
    return control_mode | (input_mode ^ 0x80000000) - 0x80000000 << 32, True


NO_SET_CONTROLLER_MODE = SetControllerMode(0, 0)


def unpack_set_controller_mode(length: int, word: int) -> tuple[SetControllerMode, FrameErrorReason]:
    if length != 8:
        return NO_SET_CONTROLLER_MODE, LENGTH
    control_mode = word & 0xFFFFFFFF
    if not (0 <= control_mode <= 3):
        return NO_SET_CONTROLLER_MODE, ENUMERATION
    input_mode = word >> 32 & 0xFFFFFFFF
    if not (0 <= input_mode <= 8):
        return NO_SET_CONTROLLER_MODE, ENUMERATION
    return SetControllerMode(control_mode, input_mode), OK


def pack_set_input_velocity(record: SetInputVelocity, _counter: int) -> tuple[int, bool]:
    velocity_rev_s, torque_feedforward_n_m = record
    if not (
        -FLOAT32_OVERFLOW < velocity_rev_s < FLOAT32_OVERFLOW
        and -FLOAT32_OVERFLOW < torque_feedforward_n_m < FLOAT32_OVERFLOW
    ):
        return 0, False
    velocity_rev_s_counts = float32_bits(velocity_rev_s)
    torque_feedforward_n_m_counts = float32_bits(torque_feedforward_n_m)
    return velocity_rev_s_counts | (torque_feedforward_n_m_counts ^ 0x80000000) - 0x80000000 << 32, True


NO_SET_INPUT_VELOCITY = SetInputVelocity(0.0, 0.0)


def unpack_set_input_velocity(length: int, word: int) -> tuple[SetInputVelocity, FrameErrorReason]:
    if length != 8:
        return NO_SET_INPUT_VELOCITY, LENGTH
    velocity_rev_s = float32_of(word & 0xFFFFFFFF)
    if not isfinite(velocity_rev_s):
        return NO_SET_INPUT_VELOCITY, NOT_FINITE
    torque_feedforward_n_m = float32_of(word >> 32 & 0xFFFFFFFF)
    if not isfinite(torque_feedforward_n_m):
        return NO_SET_INPUT_VELOCITY, NOT_FINITE
    return SetInputVelocity(velocity_rev_s, torque_feedforward_n_m), OK


def pack_set_input_torque(record: SetInputTorque, _counter: int) -> tuple[int, bool]:
    (torque_n_m,) = record
    if not (-FLOAT32_OVERFLOW < torque_n_m < FLOAT32_OVERFLOW):
        return 0, False
    torque_n_m_counts = float32_bits(torque_n_m)
    return torque_n_m_counts, True


NO_SET_INPUT_TORQUE = SetInputTorque(0.0)


def unpack_set_input_torque(length: int, word: int) -> tuple[SetInputTorque, FrameErrorReason]:
    if length != 8:
        return NO_SET_INPUT_TORQUE, LENGTH
    torque_n_m = float32_of(word & 0xFFFFFFFF)
    if not isfinite(torque_n_m):
        return NO_SET_INPUT_TORQUE, NOT_FINITE
    return SetInputTorque(torque_n_m), OK


def pack_set_limits(record: SetLimits, _counter: int) -> tuple[int, bool]:
    velocity_limit_rev_s, current_limit_a = record
    if not (
        -FLOAT32_OVERFLOW < velocity_limit_rev_s < FLOAT32_OVERFLOW
        and -FLOAT32_OVERFLOW < current_limit_a < FLOAT32_OVERFLOW
    ):
        return 0, False
    velocity_limit_rev_s_counts = float32_bits(velocity_limit_rev_s)
    current_limit_a_counts = float32_bits(current_limit_a)
    return velocity_limit_rev_s_counts | (current_limit_a_counts ^ 0x80000000) - 0x80000000 << 32, True


NO_SET_LIMITS = SetLimits(0.0, 0.0)


def unpack_set_limits(length: int, word: int) -> tuple[SetLimits, FrameErrorReason]:
    if length != 8:
        return NO_SET_LIMITS, LENGTH
    velocity_limit_rev_s = float32_of(word & 0xFFFFFFFF)
    if not isfinite(velocity_limit_rev_s):
        return NO_SET_LIMITS, NOT_FINITE
    current_limit_a = float32_of(word >> 32 & 0xFFFFFFFF)
    if not isfinite(current_limit_a):
        return NO_SET_LIMITS, NOT_FINITE
    return SetLimits(velocity_limit_rev_s, current_limit_a), OK


def pack_drive_current(record: DriveCurrent, _counter: int) -> tuple[int, bool]:
    setpoint_a, measured_a = record
    if not (
        -FLOAT32_OVERFLOW < setpoint_a < FLOAT32_OVERFLOW
        and -FLOAT32_OVERFLOW < measured_a < FLOAT32_OVERFLOW
    ):
        return 0, False
    setpoint_a_counts = float32_bits(setpoint_a)
    measured_a_counts = float32_bits(measured_a)
    return setpoint_a_counts | (measured_a_counts ^ 0x80000000) - 0x80000000 << 32, True


NO_DRIVE_CURRENT = DriveCurrent(0.0, 0.0)


def unpack_drive_current(length: int, word: int) -> tuple[DriveCurrent, FrameErrorReason]:
    if length != 8:
        return NO_DRIVE_CURRENT, LENGTH
    setpoint_a = float32_of(word & 0xFFFFFFFF)
    if not isfinite(setpoint_a):
        return NO_DRIVE_CURRENT, NOT_FINITE
    measured_a = float32_of(word >> 32 & 0xFFFFFFFF)
    if not isfinite(measured_a):
        return NO_DRIVE_CURRENT, NOT_FINITE
    return DriveCurrent(setpoint_a, measured_a), OK


def pack_drive_temperature(record: DriveTemperature, _counter: int) -> tuple[int, bool]:
    inverter_degc, motor_degc = record
    if not (
        -FLOAT32_OVERFLOW < inverter_degc < FLOAT32_OVERFLOW
        and -FLOAT32_OVERFLOW < motor_degc < FLOAT32_OVERFLOW
    ):
        return 0, False
    inverter_degc_counts = float32_bits(inverter_degc)
    motor_degc_counts = float32_bits(motor_degc)
    return inverter_degc_counts | (motor_degc_counts ^ 0x80000000) - 0x80000000 << 32, True


NO_DRIVE_TEMPERATURE = DriveTemperature(0.0, 0.0)


def unpack_drive_temperature(length: int, word: int) -> tuple[DriveTemperature, FrameErrorReason]:
    if length != 8:
        return NO_DRIVE_TEMPERATURE, LENGTH
    inverter_degc = float32_of(word & 0xFFFFFFFF)
    if not isfinite(inverter_degc):
        return NO_DRIVE_TEMPERATURE, NOT_FINITE
    motor_degc = float32_of(word >> 32 & 0xFFFFFFFF)
    if not isfinite(motor_degc):
        return NO_DRIVE_TEMPERATURE, NOT_FINITE
    return DriveTemperature(inverter_degc, motor_degc), OK


def pack_drive_supply(record: DriveSupply, _counter: int) -> tuple[int, bool]:
    voltage_v, current_a = record
    if not (
        -FLOAT32_OVERFLOW < voltage_v < FLOAT32_OVERFLOW and -FLOAT32_OVERFLOW < current_a < FLOAT32_OVERFLOW
    ):
        return 0, False
    voltage_v_counts = float32_bits(voltage_v)
    current_a_counts = float32_bits(current_a)
    return voltage_v_counts | (current_a_counts ^ 0x80000000) - 0x80000000 << 32, True


NO_DRIVE_SUPPLY = DriveSupply(0.0, 0.0)


def unpack_drive_supply(length: int, word: int) -> tuple[DriveSupply, FrameErrorReason]:
    if length != 8:
        return NO_DRIVE_SUPPLY, LENGTH
    voltage_v = float32_of(word & 0xFFFFFFFF)
    if not isfinite(voltage_v):
        return NO_DRIVE_SUPPLY, NOT_FINITE
    current_a = float32_of(word >> 32 & 0xFFFFFFFF)
    if not isfinite(current_a):
        return NO_DRIVE_SUPPLY, NOT_FINITE
    return DriveSupply(voltage_v, current_a), OK


def pack_clear_errors(record: ClearErrors, _counter: int) -> tuple[int, bool]:
    (identify,) = record
    if not (0 <= identify <= 255):
        return 0, False
    return identify, True


NO_CLEAR_ERRORS = ClearErrors(0)


def unpack_clear_errors(length: int, word: int) -> tuple[ClearErrors, FrameErrorReason]:
    if length != 1:
        return NO_CLEAR_ERRORS, LENGTH
    identify = word & 0xFF
    return ClearErrors(identify), OK


def pack_set_absolute_position(record: SetAbsolutePosition, _counter: int) -> tuple[int, bool]:
    (position_rev,) = record
    if not (-FLOAT32_OVERFLOW < position_rev < FLOAT32_OVERFLOW):
        return 0, False
    position_rev_counts = float32_bits(position_rev)
    return position_rev_counts, True


NO_SET_ABSOLUTE_POSITION = SetAbsolutePosition(0.0)


def unpack_set_absolute_position(length: int, word: int) -> tuple[SetAbsolutePosition, FrameErrorReason]:
    if length != 8:
        return NO_SET_ABSOLUTE_POSITION, LENGTH
    position_rev = float32_of(word & 0xFFFFFFFF)
    if not isfinite(position_rev):
        return NO_SET_ABSOLUTE_POSITION, NOT_FINITE
    return SetAbsolutePosition(position_rev), OK


def pack_accelerometer(record: Accelerometer, counter: int) -> tuple[int, bool]:
    striker_low_m_s2, striker_high_m_s2, housing_m_s2 = record
    if not (isfinite(striker_low_m_s2) and isfinite(striker_high_m_s2) and isfinite(housing_m_s2)):
        return 0, False
    striker_low_m_s2_scaled = striker_low_m_s2 / 0.0047884033203125
    striker_low_m_s2_counts = (
        round(striker_low_m_s2_scaled)
        if -32767 < striker_low_m_s2_scaled < 32767
        else (32767 if striker_low_m_s2_scaled > 0 else -32767)
    )
    striker_high_m_s2_scaled = striker_high_m_s2 / 0.48052585
    striker_high_m_s2_counts = (
        round(striker_high_m_s2_scaled)
        if -4095 < striker_high_m_s2_scaled < 4095
        else (4095 if striker_high_m_s2_scaled > 0 else -4095)
    )
    housing_m_s2_scaled = housing_m_s2 / 0.0047884033203125
    housing_m_s2_counts = (
        round(housing_m_s2_scaled)
        if -32767 < housing_m_s2_scaled < 32767
        else (32767 if housing_m_s2_scaled > 0 else -32767)
    )
    word = (
        striker_low_m_s2_counts & 0xFFFF
        | (striker_high_m_s2_counts & 0xFFFF) << 16
        | (housing_m_s2_counts & 0xFFFF) << 32
        | (counter & 255) << 48
    )
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[171 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8]
    crc = TABLE[crc ^ lane_3 & 0xFF] ^ 0xFF
    return word | (crc ^ 128) - 128 << 56, True


NO_ACCELEROMETER = Accelerometer(0.0, 0.0, 0.0)


def unpack_accelerometer(length: int, word: int) -> tuple[Accelerometer, FrameErrorReason]:
    if length != 8:
        return NO_ACCELEROMETER, LENGTH
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[171 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8]
    crc = TABLE[crc ^ lane_3 & 0xFF] ^ 0xFF
    if crc != lane_3 >> 8:
        return NO_ACCELEROMETER, CRC
    striker_low_m_s2 = (lane_0 ^ 0x8000) - 0x8000
    if not (-32767 <= striker_low_m_s2 <= 32767):
        return NO_ACCELEROMETER, RANGE
    striker_high_m_s2 = (lane_1 ^ 0x8000) - 0x8000
    if not (-4095 <= striker_high_m_s2 <= 4095):
        return NO_ACCELEROMETER, RANGE
    housing_m_s2 = (lane_2 ^ 0x8000) - 0x8000
    if not (-32767 <= housing_m_s2 <= 32767):
        return NO_ACCELEROMETER, RANGE
    return Accelerometer(
        striker_low_m_s2 * 0.0047884033203125,
        striker_high_m_s2 * 0.48052585,
        housing_m_s2 * 0.0047884033203125,
    ), OK


def pack_coarse_position(record: CoarsePosition, counter: int) -> tuple[int, bool]:
    (striker_position_m,) = record
    if not (isfinite(striker_position_m)):
        return 0, False
    striker_position_m_scaled = striker_position_m / 1e-05
    striker_position_m_counts = (
        round(striker_position_m_scaled)
        if -32767 < striker_position_m_scaled < 32767
        else (32767 if striker_position_m_scaled > 0 else -32767)
    )
    word = striker_position_m_counts & 0xFFFF | (counter & 15) << 20
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    crc = TABLE[TABLE[182 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[crc ^ lane_1 & 0xFF] ^ 0xFF
    return word | crc << 24, True


NO_COARSE_POSITION = CoarsePosition(0.0)


def unpack_coarse_position(length: int, word: int) -> tuple[CoarsePosition, FrameErrorReason]:
    if length != 4:
        return NO_COARSE_POSITION, LENGTH
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    crc = TABLE[TABLE[182 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[crc ^ lane_1 & 0xFF] ^ 0xFF
    if crc != lane_1 >> 8:
        return NO_COARSE_POSITION, CRC
    striker_position_m = (lane_0 ^ 0x8000) - 0x8000
    if not (-32767 <= striker_position_m <= 32767):
        return NO_COARSE_POSITION, RANGE
    return CoarsePosition(striker_position_m * 1e-05), OK


def pack_gait_sensors(record: GaitSensors, counter: int) -> tuple[int, bool]:
    shank_rate_rad_s, along_m_s2, heel_contact, toe_contact = record
    if not (
        isfinite(shank_rate_rad_s)
        and isfinite(along_m_s2)
        and 0 <= heel_contact <= 1
        and 0 <= toe_contact <= 1
    ):
        return 0, False
    shank_rate_rad_s_scaled = shank_rate_rad_s / 0.001
    shank_rate_rad_s_counts = (
        round(shank_rate_rad_s_scaled)
        if -32767 < shank_rate_rad_s_scaled < 32767
        else (32767 if shank_rate_rad_s_scaled > 0 else -32767)
    )
    along_m_s2_scaled = along_m_s2 / 0.0047884033203125
    along_m_s2_counts = (
        round(along_m_s2_scaled)
        if -32767 < along_m_s2_scaled < 32767
        else (32767 if along_m_s2_scaled > 0 else -32767)
    )
    word = (
        shank_rate_rad_s_counts & 0xFFFF
        | (along_m_s2_counts & 0xFFFF) << 16
        | heel_contact << 32
        | toe_contact << 33
        | (counter & 15) << 36
    )
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    crc = TABLE[TABLE[145 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[crc ^ lane_2 & 0xFF] ^ 0xFF
    return word | crc << 40, True


NO_GAIT_SENSORS = GaitSensors(0.0, 0.0, 0, 0)


def unpack_gait_sensors(length: int, word: int) -> tuple[GaitSensors, FrameErrorReason]:
    if length != 6:
        return NO_GAIT_SENSORS, LENGTH
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    crc = TABLE[TABLE[145 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[crc ^ lane_2 & 0xFF] ^ 0xFF
    if crc != lane_2 >> 8:
        return NO_GAIT_SENSORS, CRC
    shank_rate_rad_s = (lane_0 ^ 0x8000) - 0x8000
    if not (-32767 <= shank_rate_rad_s <= 32767):
        return NO_GAIT_SENSORS, RANGE
    along_m_s2 = (lane_1 ^ 0x8000) - 0x8000
    if not (-32767 <= along_m_s2 <= 32767):
        return NO_GAIT_SENSORS, RANGE
    heel_contact = word >> 32 & 0x1
    toe_contact = word >> 33 & 0x1
    return GaitSensors(
        shank_rate_rad_s * 0.001, along_m_s2 * 0.0047884033203125, heel_contact, toe_contact
    ), OK


def pack_operator_command(record: OperatorCommand, counter: int) -> tuple[int, bool]:
    request, target_ratio, target_impulse_n_s = record
    if not (0 <= request <= 2 and isfinite(target_ratio) and isfinite(target_impulse_n_s)):
        return 0, False
    target_ratio_scaled = target_ratio / 0.0001
    target_ratio_counts = (
        round(target_ratio_scaled)
        if 0 < target_ratio_scaled < 40000
        else (40000 if target_ratio_scaled > 0 else 0)
    )
    target_impulse_n_s_scaled = target_impulse_n_s / 0.0001
    target_impulse_n_s_counts = (
        round(target_impulse_n_s_scaled)
        if 0 < target_impulse_n_s_scaled < 65535
        else (65535 if target_impulse_n_s_scaled > 0 else 0)
    )
    word = request | target_ratio_counts << 8 | target_impulse_n_s_counts << 24 | (counter & 15) << 44
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    crc = TABLE[TABLE[63 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8] ^ 0xFF
    return word | crc << 48, True


NO_OPERATOR_COMMAND = OperatorCommand(0, 0.0, 0.0)


def unpack_operator_command(length: int, word: int) -> tuple[OperatorCommand, FrameErrorReason]:
    if length != 7:
        return NO_OPERATOR_COMMAND, LENGTH
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[63 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8] ^ 0xFF
    if crc != lane_3 & 0xFF:
        return NO_OPERATOR_COMMAND, CRC
    request = word & 0xFF
    if not (0 <= request <= 2):
        return NO_OPERATOR_COMMAND, ENUMERATION
    target_ratio = word >> 8 & 0xFFFF
    if not (0 <= target_ratio <= 40000):
        return NO_OPERATOR_COMMAND, RANGE
    target_impulse_n_s = word >> 24 & 0xFFFF
    return OperatorCommand(request, target_ratio * 0.0001, target_impulse_n_s * 0.0001), OK


def pack_parameter_request(record: ParameterRequest, counter: int) -> tuple[int, bool]:
    parameter_index, operation, value = record
    if not (
        0 <= parameter_index <= 16383 and 0 <= operation <= 1 and -FLOAT32_OVERFLOW < value < FLOAT32_OVERFLOW
    ):
        return 0, False
    value_counts = float32_bits(value)
    word = value_counts | parameter_index << 32 | operation << 48 | (counter & 15) << 52
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[34 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8]
    crc = TABLE[crc ^ lane_3 & 0xFF] ^ 0xFF
    return word | (crc ^ 128) - 128 << 56, True


NO_PARAMETER_REQUEST = ParameterRequest(0, 0, 0.0)


def unpack_parameter_request(length: int, word: int) -> tuple[ParameterRequest, FrameErrorReason]:
    if length != 8:
        return NO_PARAMETER_REQUEST, LENGTH
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[34 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8]
    crc = TABLE[crc ^ lane_3 & 0xFF] ^ 0xFF
    if crc != lane_3 >> 8:
        return NO_PARAMETER_REQUEST, CRC
    value = float32_of(word & 0xFFFFFFFF)
    if not isfinite(value):
        return NO_PARAMETER_REQUEST, NOT_FINITE
    parameter_index = word >> 32 & 0x3FFF
    operation = word >> 48 & 0xF
    if not (0 <= operation <= 1):
        return NO_PARAMETER_REQUEST, ENUMERATION
    return ParameterRequest(parameter_index, operation, value), OK


def pack_firmware_heartbeat(record: FirmwareHeartbeat, counter: int) -> tuple[int, bool]:
    mode, fault, acting_limit, regime, target_omega_rad_s = record
    if not (
        0 <= mode <= 6
        and 0 <= fault <= 23
        and 0 <= acting_limit <= 6
        and 0 <= regime <= 6
        and isfinite(target_omega_rad_s)
    ):
        return 0, False
    target_omega_rad_s_scaled = target_omega_rad_s / 0.002
    target_omega_rad_s_counts = (
        round(target_omega_rad_s_scaled)
        if -32767 < target_omega_rad_s_scaled < 32767
        else (32767 if target_omega_rad_s_scaled > 0 else -32767)
    )
    word = (
        mode
        | acting_limit << 4
        | fault << 8
        | (target_omega_rad_s_counts & 0xFFFF) << 16
        | regime << 32
        | (counter & 15) << 36
    )
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    crc = TABLE[TABLE[184 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[crc ^ lane_2 & 0xFF] ^ 0xFF
    return word | crc << 40, True


NO_FIRMWARE_HEARTBEAT = FirmwareHeartbeat(0, 0, 0, 0, 0.0)


def unpack_firmware_heartbeat(length: int, word: int) -> tuple[FirmwareHeartbeat, FrameErrorReason]:
    if length != 6:
        return NO_FIRMWARE_HEARTBEAT, LENGTH
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    crc = TABLE[TABLE[184 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[crc ^ lane_2 & 0xFF] ^ 0xFF
    if crc != lane_2 >> 8:
        return NO_FIRMWARE_HEARTBEAT, CRC
    mode = word & 0xF
    if not (0 <= mode <= 6):
        return NO_FIRMWARE_HEARTBEAT, ENUMERATION
    acting_limit = word >> 4 & 0xF
    if not (0 <= acting_limit <= 6):
        return NO_FIRMWARE_HEARTBEAT, ENUMERATION
    fault = word >> 8 & 0xFF
    if not (0 <= fault <= 23):
        return NO_FIRMWARE_HEARTBEAT, ENUMERATION
    target_omega_rad_s = (lane_1 ^ 0x8000) - 0x8000
    if not (-32767 <= target_omega_rad_s <= 32767):
        return NO_FIRMWARE_HEARTBEAT, RANGE
    regime = word >> 32 & 0xF
    if not (0 <= regime <= 6):
        return NO_FIRMWARE_HEARTBEAT, ENUMERATION
    return FirmwareHeartbeat(mode, fault, acting_limit, regime, target_omega_rad_s * 0.002), OK


def pack_striker_estimate(record: StrikerEstimate, counter: int) -> tuple[int, bool]:
    position_m, velocity_m_s, crank_omega_rad_s = record
    if not (isfinite(position_m) and isfinite(velocity_m_s) and isfinite(crank_omega_rad_s)):
        return 0, False
    position_m_scaled = position_m / 1e-05
    position_m_counts = (
        round(position_m_scaled)
        if -32767 < position_m_scaled < 32767
        else (32767 if position_m_scaled > 0 else -32767)
    )
    velocity_m_s_scaled = velocity_m_s / 0.0002
    velocity_m_s_counts = (
        round(velocity_m_s_scaled)
        if -32767 < velocity_m_s_scaled < 32767
        else (32767 if velocity_m_s_scaled > 0 else -32767)
    )
    crank_omega_rad_s_scaled = crank_omega_rad_s / 0.002
    crank_omega_rad_s_counts = (
        round(crank_omega_rad_s_scaled)
        if -32767 < crank_omega_rad_s_scaled < 32767
        else (32767 if crank_omega_rad_s_scaled > 0 else -32767)
    )
    word = (
        position_m_counts & 0xFFFF
        | (velocity_m_s_counts & 0xFFFF) << 16
        | (crank_omega_rad_s_counts & 0xFFFF) << 32
        | (counter & 15) << 52
    )
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[165 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8]
    crc = TABLE[crc ^ lane_3 & 0xFF] ^ 0xFF
    return word | (crc ^ 128) - 128 << 56, True


NO_STRIKER_ESTIMATE = StrikerEstimate(0.0, 0.0, 0.0)


def unpack_striker_estimate(length: int, word: int) -> tuple[StrikerEstimate, FrameErrorReason]:
    if length != 8:
        return NO_STRIKER_ESTIMATE, LENGTH
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[165 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8]
    crc = TABLE[crc ^ lane_3 & 0xFF] ^ 0xFF
    if crc != lane_3 >> 8:
        return NO_STRIKER_ESTIMATE, CRC
    position_m = (lane_0 ^ 0x8000) - 0x8000
    if not (-32767 <= position_m <= 32767):
        return NO_STRIKER_ESTIMATE, RANGE
    velocity_m_s = (lane_1 ^ 0x8000) - 0x8000
    if not (-32767 <= velocity_m_s <= 32767):
        return NO_STRIKER_ESTIMATE, RANGE
    crank_omega_rad_s = (lane_2 ^ 0x8000) - 0x8000
    if not (-32767 <= crank_omega_rad_s <= 32767):
        return NO_STRIKER_ESTIMATE, RANGE
    return StrikerEstimate(position_m * 1e-05, velocity_m_s * 0.0002, crank_omega_rad_s * 0.002), OK


def pack_regime_report(record: RegimeReport, counter: int) -> tuple[int, bool]:
    regime, impacts, impact_phase_deg, peak_acceleration_m_s2 = record
    if not (
        0 <= regime <= 6
        and isfinite(impacts)
        and isfinite(impact_phase_deg)
        and isfinite(peak_acceleration_m_s2)
    ):
        return 0, False
    impacts_counts = impacts if 0 < impacts < 255 else (255 if impacts > 0 else 0)
    impact_phase_deg_scaled = impact_phase_deg / 0.01
    impact_phase_deg_counts = (
        round(impact_phase_deg_scaled)
        if 0 < impact_phase_deg_scaled < 36000
        else (36000 if impact_phase_deg_scaled > 0 else 0)
    )
    peak_acceleration_m_s2_scaled = peak_acceleration_m_s2 / 0.05
    peak_acceleration_m_s2_counts = (
        round(peak_acceleration_m_s2_scaled)
        if 0 < peak_acceleration_m_s2_scaled < 65535
        else (65535 if peak_acceleration_m_s2_scaled > 0 else 0)
    )
    word = (
        impacts_counts
        | impact_phase_deg_counts << 8
        | peak_acceleration_m_s2_counts << 24
        | regime << 40
        | (counter & 15) << 44
    )
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    crc = TABLE[TABLE[130 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8] ^ 0xFF
    return word | crc << 48, True


NO_REGIME_REPORT = RegimeReport(0, 0, 0.0, 0.0)


def unpack_regime_report(length: int, word: int) -> tuple[RegimeReport, FrameErrorReason]:
    if length != 7:
        return NO_REGIME_REPORT, LENGTH
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[130 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8] ^ 0xFF
    if crc != lane_3 & 0xFF:
        return NO_REGIME_REPORT, CRC
    impacts = word & 0xFF
    impact_phase_deg = word >> 8 & 0xFFFF
    if not (0 <= impact_phase_deg <= 36000):
        return NO_REGIME_REPORT, RANGE
    peak_acceleration_m_s2 = word >> 24 & 0xFFFF
    regime = word >> 40 & 0xF
    if not (0 <= regime <= 6):
        return NO_REGIME_REPORT, ENUMERATION
    return RegimeReport(regime, impacts, impact_phase_deg * 0.01, peak_acceleration_m_s2 * 0.05), OK


def pack_impact_event(record: ImpactEvent, counter: int) -> tuple[int, bool]:
    age_s, approach_speed_m_s, impulse_n_s = record
    if not (isfinite(age_s) and isfinite(approach_speed_m_s) and isfinite(impulse_n_s)):
        return 0, False
    age_s_scaled = age_s / 1e-05
    age_s_counts = round(age_s_scaled) if 0 < age_s_scaled < 65535 else (65535 if age_s_scaled > 0 else 0)
    approach_speed_m_s_scaled = approach_speed_m_s / 0.0002
    approach_speed_m_s_counts = (
        round(approach_speed_m_s_scaled)
        if 0 < approach_speed_m_s_scaled < 65535
        else (65535 if approach_speed_m_s_scaled > 0 else 0)
    )
    impulse_n_s_scaled = impulse_n_s / 0.0002
    impulse_n_s_counts = (
        round(impulse_n_s_scaled)
        if 0 < impulse_n_s_scaled < 65535
        else (65535 if impulse_n_s_scaled > 0 else 0)
    )
    word = age_s_counts | approach_speed_m_s_counts << 16 | impulse_n_s_counts << 32 | (counter & 15) << 52
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[233 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8]
    crc = TABLE[crc ^ lane_3 & 0xFF] ^ 0xFF
    return word | (crc ^ 128) - 128 << 56, True


NO_IMPACT_EVENT = ImpactEvent(0.0, 0.0, 0.0)


def unpack_impact_event(length: int, word: int) -> tuple[ImpactEvent, FrameErrorReason]:
    if length != 8:
        return NO_IMPACT_EVENT, LENGTH
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[233 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8]
    crc = TABLE[crc ^ lane_3 & 0xFF] ^ 0xFF
    if crc != lane_3 >> 8:
        return NO_IMPACT_EVENT, CRC
    age_s = lane_0
    approach_speed_m_s = lane_1
    impulse_n_s = lane_2
    return ImpactEvent(age_s * 1e-05, approach_speed_m_s * 0.0002, impulse_n_s * 0.0002), OK


def pack_fault_event(record: FaultEvent, counter: int) -> tuple[int, bool]:
    fault, disarm_reason, refusal = record
    if not (0 <= fault <= 23 and 0 <= disarm_reason <= 4294967295 and 0 <= refusal <= 8):
        return 0, False
    word = disarm_reason | fault << 32 | refusal << 40 | (counter & 15) << 44
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    crc = TABLE[TABLE[244 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8] ^ 0xFF
    return word | crc << 48, True


NO_FAULT_EVENT = FaultEvent(0, 0, 0)


def unpack_fault_event(length: int, word: int) -> tuple[FaultEvent, FrameErrorReason]:
    if length != 7:
        return NO_FAULT_EVENT, LENGTH
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[244 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8] ^ 0xFF
    if crc != lane_3 & 0xFF:
        return NO_FAULT_EVENT, CRC
    disarm_reason = word & 0xFFFFFFFF
    fault = word >> 32 & 0xFF
    if not (0 <= fault <= 23):
        return NO_FAULT_EVENT, ENUMERATION
    refusal = word >> 40 & 0xF
    if not (0 <= refusal <= 8):
        return NO_FAULT_EVENT, ENUMERATION
    return FaultEvent(fault, disarm_reason, refusal), OK


def pack_parameter_value(record: ParameterValue, counter: int) -> tuple[int, bool]:
    parameter_index, status, value, tier = record
    if not (
        0 <= parameter_index <= 16383
        and 0 <= status <= 4
        and -FLOAT32_OVERFLOW < value < FLOAT32_OVERFLOW
        and 0 <= tier <= 2
    ):
        return 0, False
    value_counts = float32_bits(value)
    word = value_counts | parameter_index << 32 | tier << 46 | status << 48 | (counter & 15) << 52
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[206 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8]
    crc = TABLE[crc ^ lane_3 & 0xFF] ^ 0xFF
    return word | (crc ^ 128) - 128 << 56, True


NO_PARAMETER_VALUE = ParameterValue(0, 0, 0.0, 0)


def unpack_parameter_value(length: int, word: int) -> tuple[ParameterValue, FrameErrorReason]:
    if length != 8:
        return NO_PARAMETER_VALUE, LENGTH
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[206 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8]
    crc = TABLE[crc ^ lane_3 & 0xFF] ^ 0xFF
    if crc != lane_3 >> 8:
        return NO_PARAMETER_VALUE, CRC
    value = float32_of(word & 0xFFFFFFFF)
    if not isfinite(value):
        return NO_PARAMETER_VALUE, NOT_FINITE
    parameter_index = word >> 32 & 0x3FFF
    tier = word >> 46 & 0x3
    if not (0 <= tier <= 2):
        return NO_PARAMETER_VALUE, ENUMERATION
    status = word >> 48 & 0xF
    if not (0 <= status <= 4):
        return NO_PARAMETER_VALUE, ENUMERATION
    return ParameterValue(parameter_index, status, value, tier), OK


def pack_gait_report(record: GaitReport, counter: int) -> tuple[int, bool]:
    gait_phase, stride_hz, confidence, gait_state, harmonic, pulses_in_window, pulses_outside = record
    if not (
        isfinite(gait_phase)
        and isfinite(stride_hz)
        and isfinite(confidence)
        and 0 <= gait_state <= 3
        and 0 <= harmonic <= 15
        and 0 <= pulses_in_window <= 255
        and 0 <= pulses_outside <= 255
    ):
        return 0, False
    gait_phase_scaled = gait_phase / 1.52587890625e-05
    gait_phase_counts = (
        round(gait_phase_scaled) if 0 < gait_phase_scaled < 65535 else (65535 if gait_phase_scaled > 0 else 0)
    )
    stride_hz_scaled = stride_hz / 0.01
    stride_hz_counts = (
        round(stride_hz_scaled) if 0 < stride_hz_scaled < 255 else (255 if stride_hz_scaled > 0 else 0)
    )
    confidence_scaled = confidence / 0.1
    confidence_counts = (
        round(confidence_scaled) if 0 < confidence_scaled < 10 else (10 if confidence_scaled > 0 else 0)
    )
    word = (
        gait_phase_counts
        | stride_hz_counts << 16
        | harmonic << 24
        | gait_state << 28
        | pulses_in_window << 32
        | pulses_outside << 40
        | confidence_counts << 48
        | (counter & 15) << 52
    )
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[1 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8]
    crc = TABLE[crc ^ lane_3 & 0xFF] ^ 0xFF
    return word | (crc ^ 128) - 128 << 56, True


NO_GAIT_REPORT = GaitReport(0.0, 0.0, 0.0, 0, 0, 0, 0)


def unpack_gait_report(length: int, word: int) -> tuple[GaitReport, FrameErrorReason]:
    if length != 8:
        return NO_GAIT_REPORT, LENGTH
    lane_0 = word & 0xFFFF
    lane_1 = word >> 16 & 0xFFFF
    lane_2 = word >> 32 & 0xFFFF
    lane_3 = word >> 48 & 0xFFFF
    crc = TABLE[TABLE[1 ^ lane_0 & 0xFF] ^ lane_0 >> 8]
    crc = TABLE[TABLE[crc ^ lane_1 & 0xFF] ^ lane_1 >> 8]
    crc = TABLE[TABLE[crc ^ lane_2 & 0xFF] ^ lane_2 >> 8]
    crc = TABLE[crc ^ lane_3 & 0xFF] ^ 0xFF
    if crc != lane_3 >> 8:
        return NO_GAIT_REPORT, CRC
    gait_phase = lane_0
    stride_hz = word >> 16 & 0xFF
    harmonic = word >> 24 & 0xF
    gait_state = word >> 28 & 0xF
    if not (0 <= gait_state <= 3):
        return NO_GAIT_REPORT, ENUMERATION
    pulses_in_window = word >> 32 & 0xFF
    pulses_outside = word >> 40 & 0xFF
    confidence = word >> 48 & 0xF
    if not (0 <= confidence <= 10):
        return NO_GAIT_REPORT, RANGE
    return GaitReport(
        gait_phase * 1.52587890625e-05,
        stride_hz * 0.01,
        confidence * 0.1,
        gait_state,
        harmonic,
        pulses_in_window,
        pulses_outside,
    ), OK
