"""The drive's axis: the state requested, the frames sent, and the confirmation by a fresh heartbeat.

    step(config, state, mode, drive, encoder, asks_clear, elapsed_ticks) -> (state, frame)

The mode alone decides the request: only SOFT_START closes the axis, E_STOP stops the drive, RUN and STOPPING
leave the axis as it is, every other mode opens it. A new request drops the frames of the previous request, so
no arming frame is sent after SOFT_START. The frames of a request are repeated until a heartbeat that was
received at least `answer_ticks` after the request agrees with it, and again as soon as that heartbeat is
stale. An earlier heartbeat may have been sent before the drive received the request.

A tick sends the torque and at most one other frame; the frame chosen here precedes all waiting frames.
"""

from enum import IntEnum
from typing import NamedTuple

from firmware_py.core.inputs import DriveInput, EncoderInput
from firmware_py.core.records import zeroed
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import (
    AXIS_IDLE,
    CLOSED_LOOP,
    E_STOP,
    FAULT,
    INIT,
    READY,
    RUN,
    SOFT_START,
    STOPPING,
    Mode,
)

REPEAT_S = 0.020
"""Period of IDLE and E-stop until they are confirmed; also the shortest time to a confirming heartbeat."""

ARM_S = 0.050
"""Period of the arming frames, and of Clear_Errors."""

RE_ZERO_S = 1.0
RE_ZERO_REV = 64.0
"""At rest, a position beyond this is reset: a float32 resolves 0.003° here, 0.36° after an hour at 4 Hz."""

STILL_REV_S = 0.02


class DriveFrame(IntEnum):
    """The frame that is sent to the drive in addition to the torque."""

    NOTHING = 0
    ESTOP = 1
    IDLE = 2
    CONTROLLER_MODE = 3
    LIMITS = 4
    CLOSED_LOOP = 5
    CLEAR_ERRORS = 6
    RE_ZERO = 7


class AxisRequest(IntEnum):
    """The state requested of the axis. KEEP: no frame, the axis stays as it is.

    OPEN at rest and DISARM on a fault both send IDLE; each needs its own confirmation.
    """

    OPEN = 0
    DISARM = 1
    STOP = 2
    CLOSE = 3
    KEEP = 4


NO_DRIVE_FRAME = DriveFrame.NOTHING
OPEN, DISARM, STOP, CLOSE, KEEP = AxisRequest


class DriveLinkConfig(NamedTuple):
    """Limits sent to the drive before it closes its loop, and times in ticks.

    A heartbeat older than `fresh_ticks` confirms nothing.
    """

    speed_limit_rad_s: float
    current_limit_a: float
    repeat_ticks: int
    answer_ticks: int
    arm_ticks: int
    re_zero_ticks: int
    fresh_ticks: int


class DriveLinkState(NamedTuple):
    """The axis request and its progress. `place` counts the frames of this round that have been sent.

    `request_ticks`, `round_ticks`, `service_ticks`: time since the request began, since its first frame was
    last sent, and since the last Clear_Errors or Set_Absolute_Position.
    """

    request: AxisRequest
    request_ticks: int
    round_ticks: int
    place: int
    confirmed: bool
    service_ticks: int


INITIAL = zeroed(DriveLinkState, request=OPEN, service_ticks=NEVER_TICKS)


def requested(mode: Mode) -> AxisRequest:
    """The axis request of `mode`."""
    if mode == E_STOP:
        return STOP
    if mode == SOFT_START:
        return CLOSE
    if mode in (RUN, STOPPING):
        return KEEP
    if mode == FAULT:
        return DISARM
    return OPEN


def frame_at(request: AxisRequest, place: int) -> DriveFrame:
    """The frame at position `place` in a round of `request`; NOTHING after the last frame."""
    if request in (OPEN, DISARM) and place == 0:
        return DriveFrame.IDLE
    if request == STOP and place <= 1:
        return DriveFrame.ESTOP if place == 0 else DriveFrame.IDLE
    if request == CLOSE and place <= 1:
        return DriveFrame.CONTROLLER_MODE if place == 0 else DriveFrame.LIMITS
    if request == CLOSE and place == 2:
        return DriveFrame.CLOSED_LOOP
    return NO_DRIVE_FRAME


def is_idle(state: DriveLinkState) -> bool:
    """Whether a fresh heartbeat has confirmed that the axis carries no torque."""
    return state.confirmed and state.request not in (CLOSE, KEEP)


def step(
    config: DriveLinkConfig,
    state: DriveLinkState,
    mode: Mode,
    drive: DriveInput,
    encoder: EncoderInput,
    asks_clear: bool,
    elapsed_ticks: int,
) -> tuple[DriveLinkState, DriveFrame]:
    """One tick. `mode`: after this tick's transition. `asks_clear`: the operator requests CLEAR_FAULTS."""
    request = requested(mode)
    begins = request != state.request
    request_ticks = 0 if begins else min(state.request_ticks + elapsed_ticks, NEVER_TICKS)
    round_ticks = min(state.round_ticks + elapsed_ticks, NEVER_TICKS)
    service_ticks = min(state.service_ticks + elapsed_ticks, NEVER_TICKS)

    confirmed = state.confirmed and not begins and drive.age_ticks <= config.fresh_ticks
    if drive.age_ticks == 0 and request_ticks >= config.answer_ticks:
        closes = request in (CLOSE, KEEP)
        confirmed = drive.axis_state == (CLOSED_LOOP if closes else AXIS_IDLE)

    period_ticks = config.arm_ticks if request == CLOSE else config.repeat_ticks
    place = state.place
    if begins or confirmed or (round_ticks >= period_ticks and frame_at(request, place) == NO_DRIVE_FRAME):
        place = 0
    frame = NO_DRIVE_FRAME if confirmed else frame_at(request, place)
    if frame != NO_DRIVE_FRAME:
        round_ticks = 0 if place == 0 else round_ticks
        place += 1

    if frame == NO_DRIVE_FRAME:
        clears = mode == INIT and asks_clear and drive.axis_error != 0
        rests = mode == READY and confirmed and abs(encoder.velocity_rev_s) < STILL_REV_S
        if clears and service_ticks >= config.arm_ticks:
            frame = DriveFrame.CLEAR_ERRORS
            service_ticks = 0
        elif rests and abs(encoder.position_rev) >= RE_ZERO_REV and service_ticks >= config.re_zero_ticks:
            frame = DriveFrame.RE_ZERO
            service_ticks = 0
    return DriveLinkState(request, request_ticks, round_ticks, place, confirmed, service_ticks), frame
