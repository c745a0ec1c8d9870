"""The drive as its bus sees it, CANSimple 0.6, node 0: frames to the commands of `hil.drive`."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError
from firmware_py.interface.frame import Frame
from firmware_py.interface.records import (
    ClearErrors,
    DriveEstop,
    SetAbsolutePosition,
    SetAxisState,
    SetControllerMode,
    SetInputTorque,
    SetInputVelocity,
    SetLimits,
)
from hil import drive as axis
from hil.drive import ESTOP_REQUESTED, DriveConfig, DriveState

COMMAND_TYPES = (
    DriveEstop,
    SetAxisState,
    SetControllerMode,
    SetInputVelocity,
    SetInputTorque,
    SetLimits,
    ClearErrors,
    SetAbsolutePosition,
)
COMMANDS = {codec.CODECS[kind].can_id: codec.CODECS[kind] for kind in COMMAND_TYPES}
"""The commands of the drive, by identifier."""

HALF_MEANT = {codec.SET_AXIS_STATE.can_id, codec.SET_INPUT_TORQUE.can_id, codec.SET_ABSOLUTE_POSITION.can_id}
"""Commands whose second half means nothing: CANSimple's clients leave it out."""
NOTHING_MEANT = {codec.CLEAR_ERRORS.can_id, codec.DRIVE_ESTOP.can_id}
"""Commands whose data mean nothing to this drive: clients send none, or as much as they like."""


def at_full_length(frame: Frame, length: int) -> bytes:
    """A command's data, filled up or cut to `length` where that changes nothing that is meant."""
    can_id, data = frame
    if can_id in NOTHING_MEANT or (can_id in HALF_MEANT and len(data) == 4):
        return data[:length].ljust(length, b"\0")
    return data


class Handled(NamedTuple):
    """The drive after some frames, and how many with its identifiers could not be read."""

    drive: DriveState
    rejected: int


def handle(
    config: DriveConfig, drive: DriveState, frames: Sequence[Frame], encoder_position_rev: float
) -> Handled:
    """Obey the commands among `frames`, in order."""
    rejected = 0
    for frame in frames:
        command_codec = COMMANDS.get(frame.can_id)
        if command_codec is None:
            continue
        try:
            command = command_codec.decode(at_full_length(frame, command_codec.length))
        except FrameError:
            rejected += 1
            continue
        drive = _obey(config, drive, command, encoder_position_rev)
    return Handled(drive, rejected)


def _obey(config: DriveConfig, drive: DriveState, command: Any, encoder_position_rev: float) -> DriveState:
    match command:
        case SetInputTorque(torque_n_m):
            drive = axis.set_torque(drive, torque_n_m)
        case SetInputVelocity(_, torque_feedforward_n_m):
            # In torque mode an ODrive takes the feed-forward alone; velocity mode is not modelled.
            drive = axis.set_torque(drive, torque_feedforward_n_m)
        case SetAxisState(requested_state):
            drive = axis.request_state(drive, requested_state)
        case SetControllerMode(control_mode, input_mode):
            drive = axis.set_mode(drive, control_mode, input_mode)
        case SetLimits(velocity_limit_rev_s, current_limit_a):
            drive = axis.set_limits(config, drive, velocity_limit_rev_s, current_limit_a)
        case ClearErrors():
            drive = axis.clear_errors(drive)
        case SetAbsolutePosition(position_rev):
            drive = axis.set_position(drive, position_rev, encoder_position_rev)
        case _:
            assert isinstance(command, DriveEstop)
            drive = axis.disarm(drive, ESTOP_REQUESTED)
    return drive
