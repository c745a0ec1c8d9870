"""Frames to records: written by `generate.py` out of `vibro.dbc`; do not edit.

`unpack_x(length, word)` gives `(record, reason)`; the record may be used only if the reason is NONE.
"""

from math import isfinite

from firmware_py.interface.frame import FrameErrorReason
from firmware_py.interface.framing import check_frame, float32_at, signed
from firmware_py.interface.generated import kinds, records


def unpack_drive_heartbeat(length: int, word: int) -> tuple[records.DriveHeartbeat, FrameErrorReason]:
    axis_error = word & 0xFFFFFFFF
    axis_state = word >> 32 & 0xFF
    procedure_result = word >> 40 & 0xFF
    trajectory_done = word >> 48 & 0x1
    reason = check_frame(
        kinds.DRIVE_HEARTBEAT, length, word, 0 <= axis_state <= 14 and 0 <= procedure_result <= 15
    )
    return records.DriveHeartbeat(
        axis_error=axis_error,
        axis_state=axis_state,
        procedure_result=procedure_result,
        trajectory_done=trajectory_done,
    ), reason


def unpack_drive_estop(length: int, word: int) -> tuple[records.DriveEstop, FrameErrorReason]:
    reason = check_frame(kinds.DRIVE_ESTOP, length, word, True)
    return records.DriveEstop(), reason


def unpack_drive_errors(length: int, word: int) -> tuple[records.DriveErrors, FrameErrorReason]:
    active_errors = word & 0xFFFFFFFF
    disarm_reason = word >> 32 & 0xFFFFFFFF
    reason = check_frame(kinds.DRIVE_ERRORS, length, word, True)
    return records.DriveErrors(active_errors=active_errors, disarm_reason=disarm_reason), reason


def unpack_set_axis_state(length: int, word: int) -> tuple[records.SetAxisState, FrameErrorReason]:
    requested_state = word & 0xFFFFFFFF
    reason = check_frame(kinds.SET_AXIS_STATE, length, word, 0 <= requested_state <= 14)
    return records.SetAxisState(requested_state=requested_state), reason


def unpack_encoder_estimates(length: int, word: int) -> tuple[records.EncoderEstimates, FrameErrorReason]:
    position_rev = float32_at(word)
    velocity_rev_s = float32_at(word >> 32)
    reason = check_frame(
        kinds.ENCODER_ESTIMATES, length, word, isfinite(position_rev) and isfinite(velocity_rev_s)
    )
    return records.EncoderEstimates(position_rev=position_rev, velocity_rev_s=velocity_rev_s), reason


def unpack_set_controller_mode(length: int, word: int) -> tuple[records.SetControllerMode, FrameErrorReason]:
    control_mode = word & 0xFFFFFFFF
    input_mode = word >> 32 & 0xFFFFFFFF
    reason = check_frame(
        kinds.SET_CONTROLLER_MODE, length, word, 0 <= control_mode <= 3 and 0 <= input_mode <= 8
    )
    return records.SetControllerMode(control_mode=control_mode, input_mode=input_mode), reason


def unpack_set_input_velocity(length: int, word: int) -> tuple[records.SetInputVelocity, FrameErrorReason]:
    velocity_rev_s = float32_at(word)
    torque_feedforward_n_m = float32_at(word >> 32)
    reason = check_frame(
        kinds.SET_INPUT_VELOCITY, length, word, isfinite(velocity_rev_s) and isfinite(torque_feedforward_n_m)
    )
    return records.SetInputVelocity(
        velocity_rev_s=velocity_rev_s, torque_feedforward_n_m=torque_feedforward_n_m
    ), reason


def unpack_set_input_torque(length: int, word: int) -> tuple[records.SetInputTorque, FrameErrorReason]:
    torque_n_m = float32_at(word)
    reason = check_frame(kinds.SET_INPUT_TORQUE, length, word, isfinite(torque_n_m))
    return records.SetInputTorque(torque_n_m=torque_n_m), reason


def unpack_set_limits(length: int, word: int) -> tuple[records.SetLimits, FrameErrorReason]:
    velocity_limit_rev_s = float32_at(word)
    current_limit_a = float32_at(word >> 32)
    reason = check_frame(
        kinds.SET_LIMITS, length, word, isfinite(velocity_limit_rev_s) and isfinite(current_limit_a)
    )
    return records.SetLimits(
        velocity_limit_rev_s=velocity_limit_rev_s, current_limit_a=current_limit_a
    ), reason


def unpack_drive_current(length: int, word: int) -> tuple[records.DriveCurrent, FrameErrorReason]:
    setpoint_a = float32_at(word)
    measured_a = float32_at(word >> 32)
    reason = check_frame(kinds.DRIVE_CURRENT, length, word, isfinite(setpoint_a) and isfinite(measured_a))
    return records.DriveCurrent(setpoint_a=setpoint_a, measured_a=measured_a), reason


def unpack_drive_temperature(length: int, word: int) -> tuple[records.DriveTemperature, FrameErrorReason]:
    inverter_degc = float32_at(word)
    motor_degc = float32_at(word >> 32)
    reason = check_frame(
        kinds.DRIVE_TEMPERATURE, length, word, isfinite(inverter_degc) and isfinite(motor_degc)
    )
    return records.DriveTemperature(inverter_degc=inverter_degc, motor_degc=motor_degc), reason


def unpack_drive_supply(length: int, word: int) -> tuple[records.DriveSupply, FrameErrorReason]:
    voltage_v = float32_at(word)
    current_a = float32_at(word >> 32)
    reason = check_frame(kinds.DRIVE_SUPPLY, length, word, isfinite(voltage_v) and isfinite(current_a))
    return records.DriveSupply(voltage_v=voltage_v, current_a=current_a), reason


def unpack_clear_errors(length: int, word: int) -> tuple[records.ClearErrors, FrameErrorReason]:
    identify = word & 0xFF
    reason = check_frame(kinds.CLEAR_ERRORS, length, word, True)
    return records.ClearErrors(identify=identify), reason


def unpack_set_absolute_position(
    length: int, word: int
) -> tuple[records.SetAbsolutePosition, FrameErrorReason]:
    position_rev = float32_at(word)
    reason = check_frame(kinds.SET_ABSOLUTE_POSITION, length, word, isfinite(position_rev))
    return records.SetAbsolutePosition(position_rev=position_rev), reason


def unpack_accelerometer(length: int, word: int) -> tuple[records.Accelerometer, FrameErrorReason]:
    striker_low_m_s2 = signed(word, 16)
    striker_high_m_s2 = signed(word >> 16, 16)
    housing_m_s2 = signed(word >> 32, 16)
    reason = check_frame(
        kinds.ACCELEROMETER,
        length,
        word,
        -32767 <= striker_low_m_s2 <= 32767
        and -4095 <= striker_high_m_s2 <= 4095
        and -32767 <= housing_m_s2 <= 32767,
    )
    return records.Accelerometer(
        striker_low_m_s2=striker_low_m_s2 * 0.0047884033203125,
        striker_high_m_s2=striker_high_m_s2 * 0.48052585,
        housing_m_s2=housing_m_s2 * 0.0047884033203125,
    ), reason


def unpack_coarse_position(length: int, word: int) -> tuple[records.CoarsePosition, FrameErrorReason]:
    striker_position_m = signed(word, 16)
    reason = check_frame(kinds.COARSE_POSITION, length, word, -32767 <= striker_position_m <= 32767)
    return records.CoarsePosition(striker_position_m=striker_position_m * 1e-05), reason


def unpack_gait_sensors(length: int, word: int) -> tuple[records.GaitSensors, FrameErrorReason]:
    shank_rate_rad_s = signed(word, 16)
    along_m_s2 = signed(word >> 16, 16)
    heel_contact = word >> 32 & 0x1
    toe_contact = word >> 33 & 0x1
    reason = check_frame(
        kinds.GAIT_SENSORS,
        length,
        word,
        -32767 <= shank_rate_rad_s <= 32767 and -32767 <= along_m_s2 <= 32767,
    )
    return records.GaitSensors(
        shank_rate_rad_s=shank_rate_rad_s * 0.001,
        along_m_s2=along_m_s2 * 0.0047884033203125,
        heel_contact=heel_contact,
        toe_contact=toe_contact,
    ), reason


def unpack_operator_command(length: int, word: int) -> tuple[records.OperatorCommand, FrameErrorReason]:
    request = word & 0xFF
    target_ratio = word >> 8 & 0xFFFF
    target_impulse_n_s = word >> 24 & 0xFFFF
    reason = check_frame(
        kinds.OPERATOR_COMMAND, length, word, 0 <= request <= 3 and 0 <= target_ratio <= 40000
    )
    return records.OperatorCommand(
        request=request, target_ratio=target_ratio * 0.0001, target_impulse_n_s=target_impulse_n_s * 0.0001
    ), reason


def unpack_xcp_command(length: int, word: int) -> tuple[records.XcpCommand, FrameErrorReason]:
    command = word & 0xFF
    low = word >> 8 & 0xFFFFFF
    high = word >> 32 & 0xFFFFFFFF
    reason = check_frame(kinds.XCP_COMMAND, length, word, True)
    return records.XcpCommand(command=command, low=low, high=high), reason


def unpack_firmware_heartbeat(length: int, word: int) -> tuple[records.FirmwareHeartbeat, FrameErrorReason]:
    mode = word & 0xF
    acting_limit = word >> 4 & 0xF
    fault = word >> 8 & 0xFF
    target_omega_rad_s = signed(word >> 16, 16)
    regime = word >> 32 & 0xF
    reason = check_frame(
        kinds.FIRMWARE_HEARTBEAT,
        length,
        word,
        0 <= mode <= 7
        and 0 <= acting_limit <= 6
        and 0 <= fault <= 24
        and -32767 <= target_omega_rad_s <= 32767
        and 0 <= regime <= 6,
    )
    return records.FirmwareHeartbeat(
        mode=mode,
        acting_limit=acting_limit,
        fault=fault,
        target_omega_rad_s=target_omega_rad_s * 0.002,
        regime=regime,
    ), reason


def unpack_striker_estimate(length: int, word: int) -> tuple[records.StrikerEstimate, FrameErrorReason]:
    position_m = signed(word, 16)
    velocity_m_s = signed(word >> 16, 16)
    crank_omega_rad_s = signed(word >> 32, 16)
    reason = check_frame(
        kinds.STRIKER_ESTIMATE,
        length,
        word,
        -32767 <= position_m <= 32767
        and -32767 <= velocity_m_s <= 32767
        and -32767 <= crank_omega_rad_s <= 32767,
    )
    return records.StrikerEstimate(
        position_m=position_m * 1e-05,
        velocity_m_s=velocity_m_s * 0.0002,
        crank_omega_rad_s=crank_omega_rad_s * 0.002,
    ), reason


def unpack_regime_report(length: int, word: int) -> tuple[records.RegimeReport, FrameErrorReason]:
    impacts = word & 0xFF
    impact_phase_deg = word >> 8 & 0xFFFF
    peak_acceleration_m_s2 = word >> 24 & 0xFFFF
    regime = word >> 40 & 0xF
    reason = check_frame(
        kinds.REGIME_REPORT, length, word, 0 <= impact_phase_deg <= 36000 and 0 <= regime <= 6
    )
    return records.RegimeReport(
        impacts=impacts,
        impact_phase_deg=impact_phase_deg * 0.01,
        peak_acceleration_m_s2=peak_acceleration_m_s2 * 0.05,
        regime=regime,
    ), reason


def unpack_impact_event(length: int, word: int) -> tuple[records.ImpactEvent, FrameErrorReason]:
    age_s = word & 0xFFFF
    approach_speed_m_s = word >> 16 & 0xFFFF
    impulse_n_s = word >> 32 & 0xFFFF
    reason = check_frame(kinds.IMPACT_EVENT, length, word, True)
    return records.ImpactEvent(
        age_s=age_s * 1e-05, approach_speed_m_s=approach_speed_m_s * 0.0002, impulse_n_s=impulse_n_s * 0.0002
    ), reason


def unpack_fault_event(length: int, word: int) -> tuple[records.FaultEvent, FrameErrorReason]:
    disarm_reason = word & 0xFFFFFFFF
    fault = word >> 32 & 0xFF
    refusal = word >> 40 & 0xF
    reason = check_frame(kinds.FAULT_EVENT, length, word, 0 <= fault <= 24 and 0 <= refusal <= 9)
    return records.FaultEvent(disarm_reason=disarm_reason, fault=fault, refusal=refusal), reason


def unpack_gait_report(length: int, word: int) -> tuple[records.GaitReport, FrameErrorReason]:
    gait_phase = word & 0xFFFF
    stride_hz = word >> 16 & 0xFF
    harmonic = word >> 24 & 0xF
    gait_state = word >> 28 & 0xF
    pulses_in_window = word >> 32 & 0xFF
    pulses_outside = word >> 40 & 0xFF
    confidence = word >> 48 & 0xF
    reason = check_frame(kinds.GAIT_REPORT, length, word, 0 <= gait_state <= 3 and 0 <= confidence <= 10)
    return records.GaitReport(
        gait_phase=gait_phase * 1.52587890625e-05,
        stride_hz=stride_hz * 0.01,
        harmonic=harmonic,
        gait_state=gait_state,
        pulses_in_window=pulses_in_window,
        pulses_outside=pulses_outside,
        confidence=confidence * 0.1,
    ), reason


def unpack_xcp_response(length: int, word: int) -> tuple[records.XcpResponse, FrameErrorReason]:
    packet = word & 0xFF
    low = word >> 8 & 0xFFFFFF
    high = word >> 32 & 0xFFFFFFFF
    reason = check_frame(kinds.XCP_RESPONSE, length, word, True)
    return records.XcpResponse(packet=packet, low=low, high=high), reason
