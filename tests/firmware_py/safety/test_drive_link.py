"""The link to the drive's axis: every request against every event, held to rules written independently."""

import itertools
import random

import pytest
from records import HEALTHY

from firmware_py.core.inputs import DriveInput
from firmware_py.core.safety import drive_link, watchdog_proof
from firmware_py.core.safety.drive_link import DriveFrame, DriveLinkState
from firmware_py.core.safety.watchdog_proof import ProofStage
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import AxisState, Mode
from firmware_py.interface.modes import AxisRequest
from firmware_py.shell.parameters import config_from

CONFIG = config_from({})
ENCODER = HEALTHY.encoder
STALE = DriveInput(AxisState.IDLE, 0, 0, 50)
"""A heartbeat that was received long ago, but is no reason for alarm yet."""
OPENED = DriveInput(AxisState.IDLE, 0, 0, 0)
CLOSED = DriveInput(AxisState.CLOSED_LOOP_CONTROL, 0, 0, 0)
SILENT = DriveInput(AxisState.IDLE, 0, 0, CONFIG.gate.drive_ticks + 1)
ARMING = (DriveFrame.CONTROLLER_MODE, DriveFrame.LIMITS, DriveFrame.CLOSED_LOOP)
DISARMING = (DriveFrame.IDLE, DriveFrame.ESTOP)
ROUNDS = {
    AxisRequest.OPEN: (DriveFrame.IDLE,),
    AxisRequest.DISARM: (DriveFrame.IDLE,),
    AxisRequest.STOP: (DriveFrame.ESTOP, DriveFrame.IDLE),
    AxisRequest.CLOSE: ARMING,
    AxisRequest.KEEP: (),
}
REQUESTS = {
    Mode.INIT: AxisRequest.OPEN,
    Mode.READY: AxisRequest.OPEN,
    Mode.SOFT_START: AxisRequest.CLOSE,
    Mode.RUN: AxisRequest.KEEP,
    Mode.STOPPING: AxisRequest.KEEP,
    Mode.FAULT: AxisRequest.DISARM,
    Mode.E_STOP: AxisRequest.STOP,
    Mode.PROOF: AxisRequest.OPEN,
}
"""The stage of the watchdog's test decides in PROOF; at rest, the axis stays open."""


def step(
    state: DriveLinkState,
    mode: Mode,
    drive: DriveInput = STALE,
    position_rev: float = 0.0,
    velocity_rev_s: float = 0.0,
    asks_clear: bool = False,
    stage: ProofStage = watchdog_proof.REST,
) -> tuple[DriveLinkState, DriveFrame]:
    encoder = ENCODER._replace(position_rev=position_rev, velocity_rev_s=velocity_rev_s)
    return drive_link.step(CONFIG.drive_link, state, mode, stage, drive, encoder, asks_clear)


def frames(
    state: DriveLinkState, mode: Mode, ticks: int, drive: DriveInput = STALE
) -> tuple[DriveLinkState, dict[int, DriveFrame]]:
    """The state after this number of ticks, and what was sent in which of them."""
    sent = {}
    for tick in range(ticks):
        state, frame = step(state, mode, drive)
        if frame != DriveFrame.NOTHING:
            sent[tick] = frame
    return state, sent


def states() -> list[DriveLinkState]:
    """Every request, unconfirmed and confirmed, at every place of a round and at the edges of its times."""
    return [
        DriveLinkState(request, request_ticks, round_ticks, place, rounds, confirmed, 0)
        for request in AxisRequest
        for request_ticks in (18, 19)
        for round_ticks in (18, 19, 48, 49)
        for place in range(4)
        for rounds in ((2, 3) if request == AxisRequest.CLOSE else (0,))
        for confirmed in (False, True)
    ]


HEARTBEATS = [
    DriveInput(axis_state, 0, 0, age_ticks)
    for axis_state in (AxisState.IDLE, AxisState.CLOSED_LOOP_CONTROL, AxisState.UNDEFINED)
    for age_ticks in (0, 1, CONFIG.gate.drive_ticks, CONFIG.gate.drive_ticks + 1)
]
SERVICES = [
    (service_ticks, error, position_rev, velocity_rev_s, asks_clear)
    for service_ticks in (48, 49, 998, 999)
    for error in (0, 0x200)
    for position_rev, velocity_rev_s in ((0.0, 0.0), (64.0, 0.019), (-64.0, 0.02))
    for asks_clear in (False, True)
]
"""What decides on the service frames and on nothing else: each heartbeat meets a sample of these."""


def test_frames_and_requests_have_numbers_of_their_own() -> None:
    """Traces hold the numbers."""
    assert list(map(int, DriveFrame)) == list(range(8))
    assert list(map(int, AxisRequest)) == list(range(5))


def test_nothing_is_remembered_at_power_up() -> None:
    nothing = DriveLinkState(AxisRequest.OPEN, 0, 0, 0, 0, confirmed=False, service_ticks=NEVER_TICKS)
    assert nothing == drive_link.INITIAL


@pytest.mark.parametrize("mode", list(Mode))
def test_every_state_under_every_event(mode: Mode) -> None:
    request, dice = REQUESTS[mode], random.Random(mode)
    cases = (
        (state._replace(service_ticks=service_ticks), heartbeat._replace(axis_error=error), *service)
        for state, heartbeat in itertools.product(states(), HEARTBEATS)
        for service_ticks, error, *service in dice.sample(SERVICES, 6)
    )
    for state, drive, position_rev, velocity_rev_s, asks_clear in cases:
        after, frame = step(state, mode, drive, position_rev, velocity_rev_s, asks_clear)
        begins = request != state.request
        assert after.request == request
        assert after.request_ticks == (0 if begins else state.request_ticks + 1)
        # Closed loop is requested only after three rounds of settings.
        is_set = request != AxisRequest.CLOSE or state.rounds == 3
        round_of = ROUNDS[request] if is_set else ROUNDS[request][:2]
        assert is_set or frame != DriveFrame.CLOSED_LOOP
        assert after.rounds == min((0 if begins else state.rounds) + (frame == DriveFrame.LIMITS), 3)
        # Only SOFT_START arms, whatever was waiting.
        assert mode == Mode.SOFT_START or frame not in ARMING
        assert mode not in (Mode.RUN, Mode.STOPPING) or frame == DriveFrame.NOTHING
        # A new request is sent at once.
        if begins:
            assert frame == (*ROUNDS[request], DriveFrame.NOTHING)[0]
        # Confirmed: by a heartbeat of this tick that answers, or by one before that is still fresh.
        wanted = (
            AxisState.IDLE
            if request in (AxisRequest.OPEN, AxisRequest.DISARM, AxisRequest.STOP)
            else AxisState.CLOSED_LOOP_CONTROL
        )
        answered = not begins and drive.age_ticks == 0 and state.request_ticks + 1 >= 20 and is_set
        if answered:
            assert after.confirmed == (drive.axis_state == wanted)
        else:
            assert after.confirmed == (not begins and state.confirmed and drive.age_ticks <= 350)
        # Unconfirmed, a round goes on tick by tick; once it and its period are over, it begins again.
        if not after.confirmed and not begins:
            if state.sent < len(round_of):
                assert frame == round_of[state.sent]
            elif (
                state.round_ticks + 1 >= (50 if request == AxisRequest.CLOSE and is_set else 20) and round_of
            ):
                assert frame == round_of[0]
            else:
                assert frame not in (*ARMING, *DISARMING)
        assert (after.round_ticks == 0) == (frame in ROUNDS[request][:1])
        if after.confirmed:
            assert frame not in (*ARMING, *DISARMING)
        # Errors are cleared in INIT alone, the position is brought back in READY alone; neither displaces a
        # frame of the request.
        free = frame not in (*ARMING, *DISARMING)
        wrong, far = drive.axis_error != 0, abs(position_rev) >= 64.0
        clears = mode == Mode.INIT and asks_clear and wrong and state.service_ticks + 1 >= 50
        assert (frame == DriveFrame.CLEAR_ERRORS) == (free and clears)
        rests = mode == Mode.READY and drive_link.is_idle(after) and abs(velocity_rev_s) < 0.02
        assert (frame == DriveFrame.RE_ZERO) == (free and rests and far and state.service_ticks + 1 >= 1000)
        assert (after.service_ticks == 0) == (frame in (DriveFrame.CLEAR_ERRORS, DriveFrame.RE_ZERO))


def test_settings_come_before_every_request_for_closed_loop_until_the_axis_is_closed() -> None:
    state, sent = frames(drive_link.INITIAL, Mode.SOFT_START, 140)
    settings = {at + place: frame for at in (0, 20) for place, frame in enumerate(ARMING[:2])}
    rounds = {at + place: frame for at in (40, 90) for place, frame in enumerate(ARMING)}
    assert sent == settings | rounds
    assert not drive_link.is_closed(state)
    state, sent = frames(state, Mode.SOFT_START, 100, CLOSED)
    assert sent == {}
    assert drive_link.is_closed(state)
    assert not drive_link.is_idle(state)


def test_in_the_test_of_the_watchdog_its_stage_decides() -> None:
    """In any other mode the stage decides nothing."""
    wanted = dict(
        zip(
            ProofStage, (AxisRequest.OPEN, AxisRequest.CLOSE, AxisRequest.KEEP, AxisRequest.OPEN), strict=True
        )
    )
    for mode, stage in itertools.product(Mode, ProofStage):
        expected = wanted[stage] if mode == Mode.PROOF else REQUESTS[mode]
        assert drive_link.find_request(mode, stage) == expected
    state, frame = drive_link.INITIAL, DriveFrame.NOTHING
    wrong = DriveInput(AxisState.IDLE, 0x01000000, 0, 50)
    sent = []
    for _ in range(60):
        state, frame = step(state, Mode.PROOF, wrong, stage=watchdog_proof.CLEAR)
        sent.append(frame)
    assert sent[:2] == [DriveFrame.IDLE, DriveFrame.CLEAR_ERRORS]
    assert sent.count(DriveFrame.CLEAR_ERRORS) == 2
    for stage in (watchdog_proof.REST, watchdog_proof.CLOSE, watchdog_proof.WITHHOLD):
        for _ in range(60):
            state, frame = step(state, Mode.PROOF, wrong, stage=stage, asks_clear=True)
            assert frame != DriveFrame.CLEAR_ERRORS
