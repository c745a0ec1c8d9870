"""The drive's axis: the state requested, the frames sent, and the confirmation by a fresh heartbeat.

    step(own, state, mode, stage, drive, encoder, asks_clear) -> (state, frame)

The row of the mode gives the request (`interface.modes`); in PROOF the stage of the watchdog's test decides.
A new request drops the frames of the previous request, so no arming frame is sent after SOFT_START. The
frames of a request are repeated until a heartbeat that was received at least `REPEAT_S` after the request
agrees with it, and again as soon as that heartbeat is stale. An earlier heartbeat may have been sent before
the drive received the request.

No frame of a drive reports its controller mode and its limits. They are therefore sent in `SETTING_ROUNDS`
rounds up to the first request for closed loop, and before each further one; once a heartbeat has reported the
closed axis, they are not sent any more, so that they cannot feed a watchdog that counts every frame.

A tick sends the torque and at most one other frame; the frame chosen here precedes all waiting frames.
"""

from enum import IntEnum
from typing import NamedTuple

from firmware_py.core.inputs import DriveInput, EncoderInput
from firmware_py.core.numbers import in_ticks
from firmware_py.core.safety import watchdog_proof
from firmware_py.core.safety.gate_limits import GateLimits
from firmware_py.core.safety.watchdog_proof import ProofStage
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import AxisState, Mode
from firmware_py.interface.modes import CLOSE, DISARM, KEEP, MODES, OPEN, STOP, AxisRequest
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


NO_DRIVE_FRAME = DriveFrame.NOTHING


class Constants(NamedTuple):
    """Periods of the frames, and how long the drive may be silent."""

    repeat_ticks: int
    arm_ticks: int
    re_zero_ticks: int
    silent_ticks: int


def derive(limits: GateLimits) -> Constants:
    """The constants of a build with these limits."""
    repeat_ticks, arm_ticks, re_zero_ticks = (
        in_ticks(period_s, limits.tick_s, 1) for period_s in (REPEAT_S, ARM_S, RE_ZERO_S)
    )
    return Constants(repeat_ticks, arm_ticks, re_zero_ticks, limits.drive_ticks)


class DriveLinkState(NamedTuple):
    """The axis request and its progress.

    `sent` counts the frames of this round that have been sent, `rounds` the rounds with settings, up to
    `SETTING_ROUNDS`.
    `request_ticks`, `round_ticks`, `service_ticks`: time since the request began, since its first frame was
    last sent, and since the last Clear_Errors or Set_Absolute_Position.
    """

    request: AxisRequest
    request_ticks: int
    round_ticks: int
    sent: int
    rounds: int
    confirmed: bool
    service_ticks: int


INITIAL = zeroed(DriveLinkState, request=OPEN, service_ticks=NEVER_TICKS)


def find_request(mode: Mode, stage: ProofStage) -> AxisRequest:
    """The axis request of the mode, in PROOF of the stage of the test."""
    if mode == Mode.PROOF and stage == watchdog_proof.CLOSE:
        return CLOSE
    if mode == Mode.PROOF and stage == watchdog_proof.WITHHOLD:
        return KEEP
    return MODES[mode.value].axis


def choose_frame(request: AxisRequest, sent: int, is_set: bool) -> DriveFrame:
    """The next frame of a round of `request` after `sent` frames; NOTHING after the last frame.

    `is_set`: controller mode and limits have been sent often enough to request closed loop.
    """
    if request in (OPEN, DISARM) and sent == 0:
        return DriveFrame.IDLE
    if request == STOP and sent <= 1:
        return DriveFrame.ESTOP if sent == 0 else DriveFrame.IDLE
    if request == CLOSE and sent <= 1:
        return DriveFrame.CONTROLLER_MODE if sent == 0 else DriveFrame.LIMITS
    if request == CLOSE and sent == 2 and is_set:
        return DriveFrame.CLOSED_LOOP
    return NO_DRIVE_FRAME


def is_idle(state: DriveLinkState) -> bool:
    """Whether a fresh heartbeat has confirmed that the axis carries no torque."""
    return state.confirmed and state.request not in (CLOSE, KEEP)


def is_closed(state: DriveLinkState) -> bool:
    """Whether a fresh heartbeat has confirmed the axis that the present request has closed."""
    return state.confirmed and state.request == CLOSE


def step(
    own: Constants,
    state: DriveLinkState,
    mode: Mode,
    stage: ProofStage,
    drive: DriveInput,
    encoder: EncoderInput,
    asks_clear: bool,
) -> tuple[DriveLinkState, DriveFrame]:
    """One tick. `mode`, `stage`: of this tick. `asks_clear`: CLEAR_FAULTS is requested."""
    request = find_request(mode, stage)
    begins = request != state.request
    request_ticks = 0 if begins else min(state.request_ticks + 1, NEVER_TICKS)
    round_ticks = min(state.round_ticks + 1, NEVER_TICKS)
    service_ticks = min(state.service_ticks + 1, NEVER_TICKS)

    rounds = 0 if begins else state.rounds
    is_set = rounds >= SETTING_ROUNDS
    confirmed = state.confirmed and not begins and drive.age_ticks <= own.silent_ticks
    if drive.age_ticks == 0 and request_ticks >= own.repeat_ticks and (is_set or request != CLOSE):
        closes = request in (CLOSE, KEEP)
        confirmed = drive.axis_state == (AxisState.CLOSED_LOOP_CONTROL if closes else AxisState.IDLE)

    period_ticks = own.arm_ticks if request == CLOSE and is_set else own.repeat_ticks
    sent = state.sent
    is_sent = choose_frame(request, sent, is_set) == NO_DRIVE_FRAME
    if begins or confirmed or (is_sent and round_ticks >= period_ticks):
        sent = 0
    frame = NO_DRIVE_FRAME if confirmed else choose_frame(request, sent, is_set)
    if frame != NO_DRIVE_FRAME:
        round_ticks = 0 if sent == 0 else round_ticks
        rounds = min(rounds + 1, SETTING_ROUNDS) if frame == DriveFrame.LIMITS else rounds
        sent += 1

    if frame == NO_DRIVE_FRAME:
        ends_proof = mode == Mode.PROOF and stage == watchdog_proof.CLEAR
        clears = (ends_proof or (mode == Mode.INIT and asks_clear)) and drive.axis_error != 0
        rests = mode == Mode.READY and confirmed and abs(encoder.velocity_rev_s) < STILL_REV_S
        if clears and service_ticks >= own.arm_ticks:
            frame = DriveFrame.CLEAR_ERRORS
            service_ticks = 0
        elif rests and abs(encoder.position_rev) >= RE_ZERO_REV and service_ticks >= own.re_zero_ticks:
            frame = DriveFrame.RE_ZERO
            service_ticks = 0
    return (
        DriveLinkState(
            request=request,
            request_ticks=request_ticks,
            round_ticks=round_ticks,
            sent=sent,
            rounds=rounds,
            confirmed=confirmed,
            service_ticks=service_ticks,
        ),
        frame,
    )
