"""The drive as its bus sees it, CANSimple 0.6, node 0: frames to commands, reports to frames.

Pure steps that run interpreted and compiled; what the commands do is in `hil.drive`.
"""

from firmware_py.interface import packing
from firmware_py.interface.errors import FrameErrorReason
from firmware_py.interface.frame import Frame, WordFrame
from hil import drive as axis
from hil.drive import ESTOP_REQUESTED, DriveConfig, DriveState, Telemetry
from hil.reports import CURRENT, ERRORS, HEARTBEAT, SUPPLY, TEMPERATURE
from plant_sim.kernels import shared

COMMAND_IDS = (
    packing.DRIVE_ESTOP_ID,
    packing.SET_AXIS_STATE_ID,
    packing.SET_CONTROLLER_MODE_ID,
    packing.SET_INPUT_VELOCITY_ID,
    packing.SET_INPUT_TORQUE_ID,
    packing.SET_LIMITS_ID,
    packing.CLEAR_ERRORS_ID,
    packing.SET_ABSOLUTE_POSITION_ID,
)
"""The identifiers of the drive's commands."""
HALF, WHOLE = 4, 8

VERSION_ID, ADDRESS_ID, BROADCAST_ADDRESS_ID = 0x000, 0x006, 0x7E6
REPORT_OF_REQUEST = {
    packing.DRIVE_CURRENT_ID: CURRENT,
    packing.DRIVE_HEARTBEAT_ID: HEARTBEAT,
    packing.DRIVE_ERRORS_ID: ERRORS,
    packing.DRIVE_TEMPERATURE_ID: TEMPERATURE,
    packing.DRIVE_SUPPLY_ID: SUPPLY,
}
REQUEST_IDS = (
    *REPORT_OF_REQUEST,
    *(packing.ENCODER_ESTIMATES_ID, VERSION_ID, ADDRESS_ID, BROADCAST_ADDRESS_ID),
)
"""What a client may ask for, by a remote frame or an empty one."""
VERSION = Frame(VERSION_ID, bytes((2, 4, 4, 58, 0, 6, 10, 0)))
"""Get_Version: CANSimple 2 (0.6), hardware 4.4-58 (ODrive Pro), firmware 0.6.10, released."""
SERIAL_NUMBER = 0x5649_4252_4F31
"""Of the simulated drive: the letters VIBRO1."""


def address(node_id: int) -> Frame:
    """Address: which node has which serial number; a drive of 0.6.10 has no connections."""
    return Frame(ADDRESS_ID, bytes((node_id,)) + SERIAL_NUMBER.to_bytes(6, "little") + b"\0")


@shared
def meant_length(length: int) -> int:
    """The length of a command whose second half means nothing: CANSimple's clients may leave it out."""
    return WHOLE if length == HALF else length


@shared
def obey(  # noqa: PLR0912 - one command after the other
    config: DriveConfig, drive: DriveState, frame: WordFrame, encoder_position_rev: float
) -> tuple[DriveState, bool]:
    """The drive after a frame, and whether a command could be read; other frames change nothing.

    Data of E-stop and of clear-errors mean nothing to this drive: clients send none, or any.
    """
    can_id, length, word = frame
    reason = FrameErrorReason.NONE
    if can_id == packing.SET_INPUT_TORQUE_ID:
        torque, reason = packing.unpack_set_input_torque(meant_length(length), word)
        if reason == FrameErrorReason.NONE:
            drive = axis.set_torque(drive, torque.torque_n_m)
    elif can_id == packing.SET_AXIS_STATE_ID:
        state, reason = packing.unpack_set_axis_state(WHOLE if length >= HALF else length, word)
        if reason == FrameErrorReason.NONE:
            drive = axis.request_state(drive, state.requested_state)
    elif can_id == packing.SET_CONTROLLER_MODE_ID:
        mode, reason = packing.unpack_set_controller_mode(length, word)
        if reason == FrameErrorReason.NONE:
            drive = axis.set_mode(drive, mode.control_mode, mode.input_mode)
    elif can_id == packing.SET_LIMITS_ID:
        limits, reason = packing.unpack_set_limits(length, word)
        if reason == FrameErrorReason.NONE:
            drive = axis.set_limits(config, drive, limits.velocity_limit_rev_s, limits.current_limit_a)
    elif can_id == packing.CLEAR_ERRORS_ID:
        drive = axis.clear_errors(drive)
    elif can_id == packing.DRIVE_ESTOP_ID:
        drive = axis.disarm(drive, ESTOP_REQUESTED)
    elif can_id == packing.SET_INPUT_VELOCITY_ID:
        # In torque mode an ODrive takes the feed-forward alone; velocity mode is not modelled.
        velocity, reason = packing.unpack_set_input_velocity(length, word)
        if reason == FrameErrorReason.NONE:
            drive = axis.set_torque(drive, velocity.torque_feedforward_n_m)
    elif can_id == packing.SET_ABSOLUTE_POSITION_ID:
        position, reason = packing.unpack_set_absolute_position(meant_length(length), word)
        if reason == FrameErrorReason.NONE:
            drive = axis.set_position(drive, position.position_rev, encoder_position_rev)
    return drive, reason == FrameErrorReason.NONE


@shared
def report_frame(config: DriveConfig, drive: DriveState, telemetry: Telemetry, report: int) -> WordFrame:
    """The frame of one of the reports of `hil.reports`."""
    if report == CURRENT:
        word, _ = packing.pack_drive_current(axis.current(config, drive, telemetry), 0)
        return WordFrame(packing.DRIVE_CURRENT_ID, packing.DRIVE_CURRENT_LENGTH, word)
    if report == HEARTBEAT:
        word, _ = packing.pack_drive_heartbeat(axis.heartbeat(drive), 0)
        return WordFrame(packing.DRIVE_HEARTBEAT_ID, packing.DRIVE_HEARTBEAT_LENGTH, word)
    if report == ERRORS:
        word, _ = packing.pack_drive_errors(axis.errors(drive), 0)
        return WordFrame(packing.DRIVE_ERRORS_ID, packing.DRIVE_ERRORS_LENGTH, word)
    if report == TEMPERATURE:
        word, _ = packing.pack_drive_temperature(axis.temperature(config, drive), 0)
        return WordFrame(packing.DRIVE_TEMPERATURE_ID, packing.DRIVE_TEMPERATURE_LENGTH, word)
    word, _ = packing.pack_drive_supply(axis.supply(config, telemetry), 0)
    return WordFrame(packing.DRIVE_SUPPLY_ID, packing.DRIVE_SUPPLY_LENGTH, word)
