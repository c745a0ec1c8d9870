"""The drive's axis: the state requested, the frames sent, and the confirmation by a fresh heartbeat.

    step(config, state, mode, stage, drive, encoder, asks_clear) -> (state, frame)

The mode alone decides the request: only SOFT_START closes the axis, E_STOP stops the drive, RUN and STOPPING
leave the axis as it is, every other mode opens it. In PROOF the stage of the watchdog's test decides. A new
request drops the frames of the previous request, so no arming frame is sent after SOFT_START. The frames of a
request are repeated until a heartbeat that was received at least `REPEAT_S` after the request agrees with
it, and again as soon as that heartbeat is stale. An earlier heartbeat may have been sent before the drive
received the request.

No frame of a drive reports its controller mode and its limits. They are therefore sent in `SETTING_ROUNDS`
rounds up to the first request for closed loop, and before each further one; once a heartbeat has reported the
closed axis, they are not sent any more, so that they cannot feed a watchdog that counts every frame.

A tick sends the torque and at most one other frame; the frame chosen here precedes all waiting frames.
"""

from enum import IntEnum
from typing import NamedTuple

from firmware_py.core.config import Config
from firmware_py.core.inputs import DriveInput, EncoderInput
from firmware_py.core.safety import watchdog_proof
from firmware_py.core.safety.watchdog_proof import ProofStage
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import AxisState, Mode
from firmware_py.interface.zeroed import zeroed

REPEAT_S = 0.020
"""Period of IDLE and E-stop until they are confirmed; also the shortest time to a confirming heartbeat."""

ARM_S = 0.050
"""Period of the requests for closed loop, and of Clear_Errors."""

SETTING_ROUNDS = 3
"""Rounds of controller mode and limits up to the first request for closed loop, `REPEAT_S` apart.

The settings reach the drive even if its frames are lost for 20 ms.
"""

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


class DriveLinkState(NamedTuple):
    """The axis request and its progress.

    `place` counts the frames of this round that have been sent, `rounds` the rounds with settings, up to
    `SETTING_ROUNDS`.
    `request_ticks`, `round_ticks`, `service_ticks`: time since the request began, since its first frame was
    last sent, and since the last Clear_Errors or Set_Absolute_Position.
    """

    request: AxisRequest
    request_ticks: int
    round_ticks: int
    place: int
    rounds: int
    confirmed: bool
    service_ticks: int


INITIAL = zeroed(DriveLinkState, request=OPEN, service_ticks=NEVER_TICKS)


def find_request(mode: Mode, stage: ProofStage) -> AxisRequest:  # noqa: PLR0911 - a table
    """The axis request of `mode`, and in PROOF of the stage of the test."""
    if mode == Mode.PROOF and stage == watchdog_proof.CLOSE:
        return CLOSE
    if mode == Mode.PROOF and stage == watchdog_proof.WITHHOLD:
        return KEEP
    if mode == Mode.E_STOP:
        return STOP
    if mode == Mode.SOFT_START:
        return CLOSE
    if mode in (Mode.RUN, Mode.STOPPING):
        return KEEP
    if mode == Mode.FAULT:
        return DISARM
    return OPEN


def choose_frame(request: AxisRequest, place: int, is_set: bool) -> DriveFrame:
    """The frame at position `place` in a round of `request`; NOTHING after the last frame.

    `is_set`: controller mode and limits have been sent often enough to request closed loop.
    """
    if request in (OPEN, DISARM) and place == 0:
        return DriveFrame.IDLE
    if request == STOP and place <= 1:
        return DriveFrame.ESTOP if place == 0 else DriveFrame.IDLE
    if request == CLOSE and place <= 1:
        return DriveFrame.CONTROLLER_MODE if place == 0 else DriveFrame.LIMITS
    if request == CLOSE and place == 2 and is_set:
        return DriveFrame.CLOSED_LOOP
    return NO_DRIVE_FRAME


def is_idle(state: DriveLinkState) -> bool:
    """Whether a fresh heartbeat has confirmed that the axis carries no torque."""
    return state.confirmed and state.request not in (CLOSE, KEEP)


def is_closed(state: DriveLinkState) -> bool:
    """Whether a fresh heartbeat has confirmed the axis that the present request has closed."""
    return state.confirmed and state.request == CLOSE


def step(
    config: Config,
    state: DriveLinkState,
    mode: Mode,
    stage: ProofStage,
    drive: DriveInput,
    encoder: EncoderInput,
    asks_clear: bool,
) -> tuple[DriveLinkState, DriveFrame]:
    """One tick. `mode`, `stage`: after this tick's transition. `asks_clear`: CLEAR_FAULTS is requested."""
    request = find_request(mode, stage)
    begins = request != state.request
    request_ticks = 0 if begins else min(state.request_ticks + 1, NEVER_TICKS)
    round_ticks = min(state.round_ticks + 1, NEVER_TICKS)
    service_ticks = min(state.service_ticks + 1, NEVER_TICKS)

    rounds = 0 if begins else state.rounds
    is_set = rounds >= SETTING_ROUNDS
    confirmed = state.confirmed and not begins and drive.age_ticks <= config.d.ticks.drive
    if drive.age_ticks == 0 and request_ticks >= config.d.ticks.repeat and (is_set or request != CLOSE):
        closes = request in (CLOSE, KEEP)
        confirmed = drive.axis_state == (AxisState.CLOSED_LOOP_CONTROL if closes else AxisState.IDLE)

    period_ticks = config.d.ticks.arm if request == CLOSE and is_set else config.d.ticks.repeat
    place = state.place
    is_sent = choose_frame(request, place, is_set) == NO_DRIVE_FRAME
    if begins or confirmed or (is_sent and round_ticks >= period_ticks):
        place = 0
    frame = NO_DRIVE_FRAME if confirmed else choose_frame(request, place, is_set)
    if frame != NO_DRIVE_FRAME:
        round_ticks = 0 if place == 0 else round_ticks
        rounds = min(rounds + 1, SETTING_ROUNDS) if frame == DriveFrame.LIMITS else rounds
        place += 1

    if frame == NO_DRIVE_FRAME:
        ends_proof = mode == Mode.PROOF and stage == watchdog_proof.CLEAR
        clears = (ends_proof or (mode == Mode.INIT and asks_clear)) and drive.axis_error != 0
        rests = mode == Mode.READY and confirmed and abs(encoder.velocity_rev_s) < STILL_REV_S
        if clears and service_ticks >= config.d.ticks.arm:
            frame = DriveFrame.CLEAR_ERRORS
            service_ticks = 0
        elif rests and abs(encoder.position_rev) >= RE_ZERO_REV and service_ticks >= config.d.ticks.re_zero:
            frame = DriveFrame.RE_ZERO
            service_ticks = 0
    return (
        DriveLinkState(
            request=request,
            request_ticks=request_ticks,
            round_ticks=round_ticks,
            place=place,
            rounds=rounds,
            confirmed=confirmed,
            service_ticks=service_ticks,
        ),
        frame,
    )
