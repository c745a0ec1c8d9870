"""The drive's interface to the bus, CANSimple 0.6, node 0: frames to commands, reports to frames.

Pure steps that run interpreted and compiled; `hil.drive.axis` executes the commands. CANSimple has no frame
that refuses a command: a command that is not modelled disarms the axis with BAD_CONFIG, and an axis state
that is not modelled ends with the result INVALID_STATE. The heartbeat reports both.
"""

import struct

from firmware_py.interface.addresses import NODE_IDS
from firmware_py.interface.frame import ACCEPTED, Frame, FrameErrorReason, WordFrame
from firmware_py.interface.generated import kinds, packing, unpacking
from hil.drive import axis, messages
from hil.drive.reports import CURRENT, ERRORS, HEARTBEAT, SUPPLY, TEMPERATURE
from plant_sim.kernels import subroutine

COMMAND_IDS = (
    kinds.DRIVE_ESTOP.can_id,
    kinds.SET_AXIS_STATE.can_id,
    kinds.SET_CONTROLLER_MODE.can_id,
    kinds.SET_INPUT_VELOCITY.can_id,
    kinds.SET_INPUT_TORQUE.can_id,
    kinds.SET_LIMITS.can_id,
    kinds.CLEAR_ERRORS.can_id,
    kinds.SET_ABSOLUTE_POSITION.can_id,
)
"""The identifiers of the drive's commands that are modelled."""
NOT_MODELLED_IDS = (0x004, 0x00C, 0x011, 0x012, 0x013, 0x016, 0x01A, 0x01B, 0x01F)
"""Identifiers of the other commands: RxSdo, position and trajectories, reboot, gains, Enter_DFU_Mode."""
NOT_MODELLED = sum(1 << can_id for can_id in NOT_MODELLED_IDS)
"""Bit mask with one bit per identifier."""
HALF, WHOLE = 4, 8

VERSION_ID, ADDRESS_ID, BROADCAST_ADDRESS_ID = 0x000, 0x006, 0x7E6
TORQUES_ID, POWERS_ID = 0x01C, 0x01D
REPORT_OF_REQUEST = {
    kinds.DRIVE_CURRENT.can_id: CURRENT,
    kinds.DRIVE_HEARTBEAT.can_id: HEARTBEAT,
    kinds.DRIVE_ERRORS.can_id: ERRORS,
    kinds.DRIVE_TEMPERATURE.can_id: TEMPERATURE,
    kinds.DRIVE_SUPPLY.can_id: SUPPLY,
}
REQUEST_IDS = (
    *REPORT_OF_REQUEST,
    *(kinds.ENCODER_ESTIMATES.can_id, VERSION_ID, ADDRESS_ID, BROADCAST_ADDRESS_ID, TORQUES_ID, POWERS_ID),
)
"""Identifiers that a client may request by a remote frame or an empty frame."""
VERSION = Frame(VERSION_ID, bytes((2, 4, 4, 58, 0, 6, 10, 0)))
"""Get_Version: CANSimple 2 (0.6), hardware 4.4-58 (ODrive Pro), firmware 0.6.10, released."""
SERIAL_NUMBER = 0x5649_4252_4F31
"""Serial number of the simulated drive: the letters VIBRO1."""


def address(node_id: int) -> Frame:
    """The frame Address: node number and serial number; with firmware 0.6.10 the connection number is 0."""
    return Frame(ADDRESS_ID, bytes((node_id,)) + SERIAL_NUMBER.to_bytes(6, "little") + b"\0")


@subroutine
def is_new_address(node_id: int, frame: WordFrame) -> bool:
    """Whether an Address frame gives this drive another node number than it has."""
    own = frame.length > 6 and frame.word >> 8 & 0xFFFF_FFFF_FFFF == SERIAL_NUMBER
    return frame.can_id in (ADDRESS_ID, BROADCAST_ADDRESS_ID) and own and frame.word & 0xFF != node_id


def torques(config: axis.DriveConfig, drive: axis.DriveState, telemetry: axis.Telemetry) -> Frame:
    """Get_Torques: the target torque and the estimate from the measured current, in N m."""
    target_n_m = axis.torque_n_m(config, drive, telemetry.omega_rad_s)
    estimate_n_m = config.torque_constant_n_m_a * telemetry.current_a
    return Frame(TORQUES_ID, struct.pack("<ff", target_n_m, estimate_n_m))


def powers(config: axis.DriveConfig, drive: axis.DriveState, telemetry: axis.Telemetry) -> Frame:
    """Get_Powers: the electrical and the mechanical power in W."""
    electrical_w = messages.supply(config, telemetry).current_a * config.supply_v
    mechanical_w = telemetry.torque_n_m * telemetry.omega_rad_s
    return Frame(POWERS_ID, struct.pack("<ff", electrical_w, mechanical_w))


@subroutine
def meant_length(length: int) -> int:
    """Length of a command with an unused second half, which CANSimple's clients may omit."""
    return WHOLE if length == HALF else length


@subroutine
def obey(  # noqa: PLR0912 - one command after the other
    config: axis.DriveConfig, drive: axis.DriveState, frame: WordFrame, encoder_position_rev: float
) -> tuple[axis.DriveState, bool]:
    """Return the drive after a frame, and whether its command could be read; other frames change nothing.

    The data of E-stop and clear-errors are ignored, so clients may send any length. An axis state may also
    have any length; missing bytes are 0.
    """
    can_id, length, word = frame
    reason = ACCEPTED
    if config.is_fed_by_every_frame and can_id < NODE_IDS:
        drive = axis.feed_watchdog(drive)
    if can_id == kinds.SET_INPUT_TORQUE.can_id:
        torque, reason = unpacking.unpack_set_input_torque(meant_length(length), word)
        if reason == ACCEPTED:
            drive = axis.set_torque(drive, torque.torque_n_m)
    elif can_id == kinds.SET_AXIS_STATE.can_id:
        state, reason = unpacking.unpack_set_axis_state(WHOLE, word)
        if reason == ACCEPTED:
            drive = axis.request_state(drive, state.requested_state)
        elif reason == FrameErrorReason.VALUE:
            drive, reason = axis.request_state(drive, axis.UNDEFINED), ACCEPTED
    elif can_id == kinds.SET_CONTROLLER_MODE.can_id:
        mode, reason = unpacking.unpack_set_controller_mode(length, word)
        if reason == ACCEPTED:
            drive = axis.set_mode(drive, mode.control_mode, mode.input_mode)
        elif reason == FrameErrorReason.VALUE:
            drive, reason = axis.set_mode(drive, axis.VOLTAGE_CONTROL, axis.INACTIVE), ACCEPTED
    elif can_id == kinds.SET_LIMITS.can_id:
        limits, reason = unpacking.unpack_set_limits(length, word)
        if reason == ACCEPTED:
            drive = axis.set_limits(config, drive, limits.velocity_limit_rev_s, limits.current_limit_a)
    elif can_id == kinds.CLEAR_ERRORS.can_id:
        drive = axis.clear_errors(drive)
    elif can_id == kinds.DRIVE_ESTOP.can_id:
        drive = axis.disarm(drive, axis.ESTOP_REQUESTED)
    elif can_id == kinds.SET_INPUT_VELOCITY.can_id:
        velocity, reason = unpacking.unpack_set_input_velocity(length, word)
        if reason == ACCEPTED:
            drive = axis.set_velocity(drive, velocity.velocity_rev_s, velocity.torque_feedforward_n_m)
    elif can_id == kinds.SET_ABSOLUTE_POSITION.can_id:
        position, reason = unpacking.unpack_set_absolute_position(meant_length(length), word)
        if reason == ACCEPTED:
            drive = axis.set_position(drive, position.position_rev, encoder_position_rev)
    elif (can_id < NODE_IDS and NOT_MODELLED >> can_id & 1) or is_new_address(config.node_id, frame):
        drive = axis.disarm(drive, axis.BAD_CONFIG)  # the node number is a parameter of the run
    return drive, reason == ACCEPTED


@subroutine
def report_frame(
    config: axis.DriveConfig, drive: axis.DriveState, telemetry: axis.Telemetry, report: int
) -> WordFrame:
    """The frame of a report (a digit of `hil.drive.reports`)."""
    if report == CURRENT:
        return packing.pack_drive_current(messages.current(config, drive, telemetry), 0)[0]
    if report == HEARTBEAT:
        return packing.pack_drive_heartbeat(messages.heartbeat(drive), 0)[0]
    if report == ERRORS:
        return packing.pack_drive_errors(messages.errors(drive), 0)[0]
    if report == TEMPERATURE:
        return packing.pack_drive_temperature(messages.temperature(config, drive), 0)[0]
    return packing.pack_drive_supply(messages.supply(config, telemetry), 0)[0]
