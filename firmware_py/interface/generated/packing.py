"""Records to frames: written by `generate.py` out of `vibro.dbc`; do not edit.

`pack_x(record, counter)` gives `(frame, sendable)`. Quantities saturate at full scale, in counts; a record
with NaN, an infinity or a value outside its list is not sendable, and its frame's word is 0. Frames without
a rolling counter ignore `counter`. All of it is the firmware's subset, as in `unpacking.py`, so that one
source runs interpreted, compiled and on a microcontroller.
"""

from math import isfinite

from firmware_py.interface.frame import WordFrame
from firmware_py.interface.framing import float32_counts, is_float32, saturate, seal, signed
from firmware_py.interface.generated import kinds, records


def pack_drive_heartbeat(record: records.DriveHeartbeat, counter: int) -> tuple[WordFrame, bool]:
    axis_error, axis_state, procedure_result, trajectory_done = record
    word = axis_error | axis_state << 32 | procedure_result << 40 | trajectory_done << 48
    sendable = (
        0 <= axis_error <= 4294967295
        and 0 <= axis_state <= 14
        and 0 <= procedure_result <= 15
        and 0 <= trajectory_done <= 1
    )
    return seal(kinds.DRIVE_HEARTBEAT, word, counter, sendable)


def pack_drive_estop(_record: records.DriveEstop, counter: int) -> tuple[WordFrame, bool]:
    word = 0
    sendable = True
    return seal(kinds.DRIVE_ESTOP, word, counter, sendable)


def pack_drive_errors(record: records.DriveErrors, counter: int) -> tuple[WordFrame, bool]:
    active_errors, disarm_reason = record
    word = active_errors | signed(disarm_reason, 32) << 32
    sendable = 0 <= active_errors <= 4294967295 and 0 <= disarm_reason <= 4294967295
    return seal(kinds.DRIVE_ERRORS, word, counter, sendable)


def pack_set_axis_state(record: records.SetAxisState, counter: int) -> tuple[WordFrame, bool]:
    (requested_state,) = record
    word = requested_state
    sendable = 0 <= requested_state <= 14
    return seal(kinds.SET_AXIS_STATE, word, counter, sendable)


def pack_encoder_estimates(record: records.EncoderEstimates, counter: int) -> tuple[WordFrame, bool]:
    position_rev, velocity_rev_s = record
    word = float32_counts(position_rev) | signed(float32_counts(velocity_rev_s), 32) << 32
    sendable = is_float32(position_rev) and is_float32(velocity_rev_s)
    return seal(kinds.ENCODER_ESTIMATES, word, counter, sendable)


def pack_set_controller_mode(record: records.SetControllerMode, counter: int) -> tuple[WordFrame, bool]:
    control_mode, input_mode = record
    word = control_mode | signed(input_mode, 32) << 32
    sendable = 0 <= control_mode <= 3 and 0 <= input_mode <= 8
    return seal(kinds.SET_CONTROLLER_MODE, word, counter, sendable)


def pack_set_input_velocity(record: records.SetInputVelocity, counter: int) -> tuple[WordFrame, bool]:
    velocity_rev_s, torque_feedforward_n_m = record
    word = float32_counts(velocity_rev_s) | signed(float32_counts(torque_feedforward_n_m), 32) << 32
    sendable = is_float32(velocity_rev_s) and is_float32(torque_feedforward_n_m)
    return seal(kinds.SET_INPUT_VELOCITY, word, counter, sendable)


def pack_set_input_torque(record: records.SetInputTorque, counter: int) -> tuple[WordFrame, bool]:
    (torque_n_m,) = record
    word = float32_counts(torque_n_m)
    sendable = is_float32(torque_n_m)
    return seal(kinds.SET_INPUT_TORQUE, word, counter, sendable)


def pack_set_limits(record: records.SetLimits, counter: int) -> tuple[WordFrame, bool]:
    velocity_limit_rev_s, current_limit_a = record
    word = float32_counts(velocity_limit_rev_s) | signed(float32_counts(current_limit_a), 32) << 32
    sendable = is_float32(velocity_limit_rev_s) and is_float32(current_limit_a)
    return seal(kinds.SET_LIMITS, word, counter, sendable)


def pack_drive_current(record: records.DriveCurrent, counter: int) -> tuple[WordFrame, bool]:
    setpoint_a, measured_a = record
    word = float32_counts(setpoint_a) | signed(float32_counts(measured_a), 32) << 32
    sendable = is_float32(setpoint_a) and is_float32(measured_a)
    return seal(kinds.DRIVE_CURRENT, word, counter, sendable)


def pack_drive_temperature(record: records.DriveTemperature, counter: int) -> tuple[WordFrame, bool]:
    inverter_degc, motor_degc = record
    word = float32_counts(inverter_degc) | signed(float32_counts(motor_degc), 32) << 32
    sendable = is_float32(inverter_degc) and is_float32(motor_degc)
    return seal(kinds.DRIVE_TEMPERATURE, word, counter, sendable)


def pack_drive_supply(record: records.DriveSupply, counter: int) -> tuple[WordFrame, bool]:
    voltage_v, current_a = record
    word = float32_counts(voltage_v) | signed(float32_counts(current_a), 32) << 32
    sendable = is_float32(voltage_v) and is_float32(current_a)
    return seal(kinds.DRIVE_SUPPLY, word, counter, sendable)


def pack_clear_errors(record: records.ClearErrors, counter: int) -> tuple[WordFrame, bool]:
    (identify,) = record
    word = identify
    sendable = 0 <= identify <= 255
    return seal(kinds.CLEAR_ERRORS, word, counter, sendable)


def pack_set_absolute_position(record: records.SetAbsolutePosition, counter: int) -> tuple[WordFrame, bool]:
    (position_rev,) = record
    word = float32_counts(position_rev)
    sendable = is_float32(position_rev)
    return seal(kinds.SET_ABSOLUTE_POSITION, word, counter, sendable)


def pack_accelerometer(record: records.Accelerometer, counter: int) -> tuple[WordFrame, bool]:
    striker_low_m_s2, striker_high_m_s2, housing_m_s2 = record
    word = (
        saturate(striker_low_m_s2 / 0.0047884033203125, -32767, 32767) & 0xFFFF
        | (saturate(striker_high_m_s2 / 0.48052585, -4095, 4095) & 0xFFFF) << 16
        | (saturate(housing_m_s2 / 0.0047884033203125, -32767, 32767) & 0xFFFF) << 32
    )
    sendable = isfinite(striker_low_m_s2) and isfinite(striker_high_m_s2) and isfinite(housing_m_s2)
    return seal(kinds.ACCELEROMETER, word, counter, sendable)


def pack_coarse_position(record: records.CoarsePosition, counter: int) -> tuple[WordFrame, bool]:
    (striker_position_m,) = record
    word = saturate(striker_position_m / 1e-05, -32767, 32767) & 0xFFFF
    sendable = isfinite(striker_position_m)
    return seal(kinds.COARSE_POSITION, word, counter, sendable)


def pack_gait_sensors(record: records.GaitSensors, counter: int) -> tuple[WordFrame, bool]:
    shank_rate_rad_s, along_m_s2, heel_contact, toe_contact = record
    word = (
        saturate(shank_rate_rad_s / 0.001, -32767, 32767) & 0xFFFF
        | (saturate(along_m_s2 / 0.0047884033203125, -32767, 32767) & 0xFFFF) << 16
        | heel_contact << 32
        | toe_contact << 33
    )
    sendable = (
        isfinite(shank_rate_rad_s)
        and isfinite(along_m_s2)
        and 0 <= heel_contact <= 1
        and 0 <= toe_contact <= 1
    )
    return seal(kinds.GAIT_SENSORS, word, counter, sendable)


def pack_operator_command(record: records.OperatorCommand, counter: int) -> tuple[WordFrame, bool]:
    request, target_ratio, target_impulse_n_s = record
    word = (
        request
        | saturate(target_ratio / 0.0001, 0, 40000) << 8
        | saturate(target_impulse_n_s / 0.0001, 0, 65535) << 24
    )
    sendable = 0 <= request <= 3 and isfinite(target_ratio) and isfinite(target_impulse_n_s)
    return seal(kinds.OPERATOR_COMMAND, word, counter, sendable)


def pack_xcp_command(record: records.XcpCommand, counter: int) -> tuple[WordFrame, bool]:
    command, low, high = record
    word = command | low << 8 | signed(high, 32) << 32
    sendable = 0 <= command <= 255 and 0 <= low <= 16777215 and 0 <= high <= 4294967295
    return seal(kinds.XCP_COMMAND, word, counter, sendable)


def pack_firmware_heartbeat(record: records.FirmwareHeartbeat, counter: int) -> tuple[WordFrame, bool]:
    mode, acting_limit, fault, target_omega_rad_s, regime = record
    word = (
        mode
        | acting_limit << 4
        | fault << 8
        | (saturate(target_omega_rad_s / 0.002, -32767, 32767) & 0xFFFF) << 16
        | regime << 32
    )
    sendable = (
        0 <= mode <= 7
        and 0 <= acting_limit <= 6
        and 0 <= fault <= 24
        and isfinite(target_omega_rad_s)
        and 0 <= regime <= 6
    )
    return seal(kinds.FIRMWARE_HEARTBEAT, word, counter, sendable)


def pack_striker_estimate(record: records.StrikerEstimate, counter: int) -> tuple[WordFrame, bool]:
    position_m, velocity_m_s, crank_omega_rad_s = record
    word = (
        saturate(position_m / 1e-05, -32767, 32767) & 0xFFFF
        | (saturate(velocity_m_s / 0.0002, -32767, 32767) & 0xFFFF) << 16
        | (saturate(crank_omega_rad_s / 0.002, -32767, 32767) & 0xFFFF) << 32
    )
    sendable = isfinite(position_m) and isfinite(velocity_m_s) and isfinite(crank_omega_rad_s)
    return seal(kinds.STRIKER_ESTIMATE, word, counter, sendable)


def pack_regime_report(record: records.RegimeReport, counter: int) -> tuple[WordFrame, bool]:
    impacts, impact_phase_deg, peak_acceleration_m_s2, regime = record
    word = (
        saturate(float(impacts), 0, 255)
        | saturate(impact_phase_deg / 0.01, 0, 36000) << 8
        | saturate(peak_acceleration_m_s2 / 0.05, 0, 65535) << 24
        | regime << 40
    )
    sendable = (
        isfinite(impacts)
        and isfinite(impact_phase_deg)
        and isfinite(peak_acceleration_m_s2)
        and 0 <= regime <= 6
    )
    return seal(kinds.REGIME_REPORT, word, counter, sendable)


def pack_impact_event(record: records.ImpactEvent, counter: int) -> tuple[WordFrame, bool]:
    age_s, approach_speed_m_s, impulse_n_s = record
    word = (
        saturate(age_s / 1e-05, 0, 65535)
        | saturate(approach_speed_m_s / 0.0002, 0, 65535) << 16
        | saturate(impulse_n_s / 0.0002, 0, 65535) << 32
    )
    sendable = isfinite(age_s) and isfinite(approach_speed_m_s) and isfinite(impulse_n_s)
    return seal(kinds.IMPACT_EVENT, word, counter, sendable)


def pack_fault_event(record: records.FaultEvent, counter: int) -> tuple[WordFrame, bool]:
    disarm_reason, fault, refusal = record
    word = disarm_reason | fault << 32 | refusal << 40
    sendable = 0 <= disarm_reason <= 4294967295 and 0 <= fault <= 24 and 0 <= refusal <= 10
    return seal(kinds.FAULT_EVENT, word, counter, sendable)


def pack_gait_report(record: records.GaitReport, counter: int) -> tuple[WordFrame, bool]:
    gait_phase, stride_hz, harmonic, gait_state, pulses_in_window, pulses_outside, confidence = record
    word = (
        saturate(gait_phase / 1.52587890625e-05, 0, 65535)
        | saturate(stride_hz / 0.01, 0, 255) << 16
        | harmonic << 24
        | gait_state << 28
        | pulses_in_window << 32
        | pulses_outside << 40
        | saturate(confidence / 0.1, 0, 10) << 48
    )
    sendable = (
        isfinite(gait_phase)
        and isfinite(stride_hz)
        and 0 <= harmonic <= 15
        and 0 <= gait_state <= 3
        and 0 <= pulses_in_window <= 255
        and 0 <= pulses_outside <= 255
        and isfinite(confidence)
    )
    return seal(kinds.GAIT_REPORT, word, counter, sendable)


def pack_xcp_response(record: records.XcpResponse, counter: int) -> tuple[WordFrame, bool]:
    packet, low, high = record
    word = packet | low << 8 | signed(high, 32) << 32
    sendable = 0 <= packet <= 255 and 0 <= low <= 16777215 and 0 <= high <= 4294967295
    return seal(kinds.XCP_RESPONSE, word, counter, sendable)
