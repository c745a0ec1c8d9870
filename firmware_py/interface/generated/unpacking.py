"""Frames to records: written by `generate.py` out of `vibro.dbc`; do not edit.

`unpack_x(length, word)` gives `(record, reason)`; the record may be used only if the reason is NONE.
"""

from math import isfinite

from firmware_py.interface.frame import FrameErrorReason
from firmware_py.interface.framing import check_frame, float32_at, signed
from firmware_py.interface.generated import kinds, records


def unpack_drive_heartbeat(length: int, word: int) -> tuple[records.DriveHeartbeat, FrameErrorReason]:
    record = records.DriveHeartbeat(
        axis_error=word & 0xFFFFFFFF,
        axis_state=word >> 32 & 0xFF,
        procedure_result=word >> 40 & 0xFF,
        trajectory_done=word >> 48 & 0x1,
    )
    listed = record.axis_state <= 14 and record.procedure_result <= 15
    return record, check_frame(kinds.DRIVE_HEARTBEAT, length, word, listed)


def unpack_drive_estop(length: int, word: int) -> tuple[records.DriveEstop, FrameErrorReason]:
    record = records.DriveEstop()
    return record, check_frame(kinds.DRIVE_ESTOP, length, word, True)


def unpack_drive_errors(length: int, word: int) -> tuple[records.DriveErrors, FrameErrorReason]:
    record = records.DriveErrors(active_errors=word & 0xFFFFFFFF, disarm_reason=word >> 32 & 0xFFFFFFFF)
    return record, check_frame(kinds.DRIVE_ERRORS, length, word, True)


def unpack_set_axis_state(length: int, word: int) -> tuple[records.SetAxisState, FrameErrorReason]:
    record = records.SetAxisState(requested_state=word & 0xFFFFFFFF)
    listed = record.requested_state <= 14
    return record, check_frame(kinds.SET_AXIS_STATE, length, word, listed)


def unpack_encoder_estimates(length: int, word: int) -> tuple[records.EncoderEstimates, FrameErrorReason]:
    record = records.EncoderEstimates(position_rev=float32_at(word), velocity_rev_s=float32_at(word >> 32))
    listed = isfinite(record.position_rev) and isfinite(record.velocity_rev_s)
    return record, check_frame(kinds.ENCODER_ESTIMATES, length, word, listed)


def unpack_set_controller_mode(length: int, word: int) -> tuple[records.SetControllerMode, FrameErrorReason]:
    record = records.SetControllerMode(control_mode=word & 0xFFFFFFFF, input_mode=word >> 32 & 0xFFFFFFFF)
    listed = record.control_mode <= 3 and record.input_mode <= 8
    return record, check_frame(kinds.SET_CONTROLLER_MODE, length, word, listed)


def unpack_set_input_velocity(length: int, word: int) -> tuple[records.SetInputVelocity, FrameErrorReason]:
    record = records.SetInputVelocity(
        velocity_rev_s=float32_at(word), torque_feedforward_n_m=float32_at(word >> 32)
    )
    listed = isfinite(record.velocity_rev_s) and isfinite(record.torque_feedforward_n_m)
    return record, check_frame(kinds.SET_INPUT_VELOCITY, length, word, listed)


def unpack_set_input_torque(length: int, word: int) -> tuple[records.SetInputTorque, FrameErrorReason]:
    record = records.SetInputTorque(torque_n_m=float32_at(word))
    listed = isfinite(record.torque_n_m)
    return record, check_frame(kinds.SET_INPUT_TORQUE, length, word, listed)


def unpack_set_limits(length: int, word: int) -> tuple[records.SetLimits, FrameErrorReason]:
    record = records.SetLimits(velocity_limit_rev_s=float32_at(word), current_limit_a=float32_at(word >> 32))
    listed = isfinite(record.velocity_limit_rev_s) and isfinite(record.current_limit_a)
    return record, check_frame(kinds.SET_LIMITS, length, word, listed)


def unpack_drive_current(length: int, word: int) -> tuple[records.DriveCurrent, FrameErrorReason]:
    record = records.DriveCurrent(setpoint_a=float32_at(word), measured_a=float32_at(word >> 32))
    listed = isfinite(record.setpoint_a) and isfinite(record.measured_a)
    return record, check_frame(kinds.DRIVE_CURRENT, length, word, listed)


def unpack_drive_temperature(length: int, word: int) -> tuple[records.DriveTemperature, FrameErrorReason]:
    record = records.DriveTemperature(inverter_degc=float32_at(word), motor_degc=float32_at(word >> 32))
    listed = isfinite(record.inverter_degc) and isfinite(record.motor_degc)
    return record, check_frame(kinds.DRIVE_TEMPERATURE, length, word, listed)


def unpack_drive_supply(length: int, word: int) -> tuple[records.DriveSupply, FrameErrorReason]:
    record = records.DriveSupply(voltage_v=float32_at(word), current_a=float32_at(word >> 32))
    listed = isfinite(record.voltage_v) and isfinite(record.current_a)
    return record, check_frame(kinds.DRIVE_SUPPLY, length, word, listed)


def unpack_clear_errors(length: int, word: int) -> tuple[records.ClearErrors, FrameErrorReason]:
    record = records.ClearErrors(identify=word & 0xFF)
    return record, check_frame(kinds.CLEAR_ERRORS, length, word, True)


def unpack_set_absolute_position(
    length: int, word: int
) -> tuple[records.SetAbsolutePosition, FrameErrorReason]:
    record = records.SetAbsolutePosition(position_rev=float32_at(word))
    listed = isfinite(record.position_rev)
    return record, check_frame(kinds.SET_ABSOLUTE_POSITION, length, word, listed)


def unpack_accelerometer(length: int, word: int) -> tuple[records.Accelerometer, FrameErrorReason]:
    record = records.Accelerometer(
        striker_low_m_s2=signed(word, 16) * 0.0047884033203125,
        striker_high_m_s2=signed(word >> 16, 16) * 0.48052585,
        housing_m_s2=signed(word >> 32, 16) * 0.0047884033203125,
    )
    listed = (
        signed(word, 16) >= -32767
        and -4095 <= signed(word >> 16, 16) <= 4095
        and signed(word >> 32, 16) >= -32767
    )
    return record, check_frame(kinds.ACCELEROMETER, length, word, listed)


def unpack_coarse_position(length: int, word: int) -> tuple[records.CoarsePosition, FrameErrorReason]:
    record = records.CoarsePosition(striker_position_m=signed(word, 16) * 1e-05)
    listed = signed(word, 16) >= -32767
    return record, check_frame(kinds.COARSE_POSITION, length, word, listed)


def unpack_gait_sensors(length: int, word: int) -> tuple[records.GaitSensors, FrameErrorReason]:
    record = records.GaitSensors(
        shank_rate_rad_s=signed(word, 16) * 0.001,
        along_m_s2=signed(word >> 16, 16) * 0.0047884033203125,
        heel_contact=word >> 32 & 0x1,
        toe_contact=word >> 33 & 0x1,
    )
    listed = signed(word, 16) >= -32767 and signed(word >> 16, 16) >= -32767
    return record, check_frame(kinds.GAIT_SENSORS, length, word, listed)


def unpack_operator_command(length: int, word: int) -> tuple[records.OperatorCommand, FrameErrorReason]:
    record = records.OperatorCommand(
        request=word & 0xFF,
        target_ratio=(word >> 8 & 0xFFFF) * 0.0001,
        target_impulse_n_s=(word >> 24 & 0xFFFF) * 0.0001,
    )
    listed = record.request <= 3 and (word >> 8 & 0xFFFF) <= 40000
    return record, check_frame(kinds.OPERATOR_COMMAND, length, word, listed)


def unpack_xcp_command(length: int, word: int) -> tuple[records.XcpCommand, FrameErrorReason]:
    record = records.XcpCommand(command=word & 0xFF, low=word >> 8 & 0xFFFFFF, high=word >> 32 & 0xFFFFFFFF)
    return record, check_frame(kinds.XCP_COMMAND, length, word, True)


def unpack_firmware_heartbeat(length: int, word: int) -> tuple[records.FirmwareHeartbeat, FrameErrorReason]:
    record = records.FirmwareHeartbeat(
        mode=word & 0xF,
        acting_limit=word >> 4 & 0xF,
        fault=word >> 8 & 0xFF,
        target_omega_rad_s=signed(word >> 16, 16) * 0.002,
        regime=word >> 32 & 0xF,
    )
    listed = (
        record.mode <= 7
        and record.acting_limit <= 6
        and record.fault <= 24
        and signed(word >> 16, 16) >= -32767
        and record.regime <= 6
    )
    return record, check_frame(kinds.FIRMWARE_HEARTBEAT, length, word, listed)


def unpack_striker_estimate(length: int, word: int) -> tuple[records.StrikerEstimate, FrameErrorReason]:
    record = records.StrikerEstimate(
        position_m=signed(word, 16) * 1e-05,
        velocity_m_s=signed(word >> 16, 16) * 0.0002,
        crank_omega_rad_s=signed(word >> 32, 16) * 0.002,
    )
    listed = (
        signed(word, 16) >= -32767 and signed(word >> 16, 16) >= -32767 and signed(word >> 32, 16) >= -32767
    )
    return record, check_frame(kinds.STRIKER_ESTIMATE, length, word, listed)


def unpack_regime_report(length: int, word: int) -> tuple[records.RegimeReport, FrameErrorReason]:
    record = records.RegimeReport(
        impacts=word & 0xFF,
        impact_phase_deg=(word >> 8 & 0xFFFF) * 0.01,
        peak_acceleration_m_s2=(word >> 24 & 0xFFFF) * 0.05,
        regime=word >> 40 & 0xF,
    )
    listed = (word >> 8 & 0xFFFF) <= 36000 and record.regime <= 6
    return record, check_frame(kinds.REGIME_REPORT, length, word, listed)


def unpack_impact_event(length: int, word: int) -> tuple[records.ImpactEvent, FrameErrorReason]:
    record = records.ImpactEvent(
        age_s=(word & 0xFFFF) * 1e-05,
        approach_speed_m_s=(word >> 16 & 0xFFFF) * 0.0002,
        impulse_n_s=(word >> 32 & 0xFFFF) * 0.0002,
    )
    return record, check_frame(kinds.IMPACT_EVENT, length, word, True)


def unpack_fault_event(length: int, word: int) -> tuple[records.FaultEvent, FrameErrorReason]:
    record = records.FaultEvent(
        disarm_reason=word & 0xFFFFFFFF, fault=word >> 32 & 0xFF, refusal=word >> 40 & 0xF
    )
    listed = record.fault <= 24 and record.refusal <= 10
    return record, check_frame(kinds.FAULT_EVENT, length, word, listed)


def unpack_gait_report(length: int, word: int) -> tuple[records.GaitReport, FrameErrorReason]:
    record = records.GaitReport(
        gait_phase=(word & 0xFFFF) * 1.52587890625e-05,
        stride_hz=(word >> 16 & 0xFF) * 0.01,
        harmonic=word >> 24 & 0xF,
        gait_state=word >> 28 & 0xF,
        pulses_in_window=word >> 32 & 0xFF,
        pulses_outside=word >> 40 & 0xFF,
        confidence=(word >> 48 & 0xF) * 0.1,
    )
    listed = record.gait_state <= 3 and (word >> 48 & 0xF) <= 10
    return record, check_frame(kinds.GAIT_REPORT, length, word, listed)


def unpack_xcp_response(length: int, word: int) -> tuple[records.XcpResponse, FrameErrorReason]:
    record = records.XcpResponse(packet=word & 0xFF, low=word >> 8 & 0xFFFFFF, high=word >> 32 & 0xFFFFFFFF)
    return record, check_frame(kinds.XCP_RESPONSE, length, word, True)
