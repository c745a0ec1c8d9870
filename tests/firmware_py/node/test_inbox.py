"""Which frames survive a full inbox, and to which period they belong after missed periods, on every build."""

import random

import pytest
from compilers import require_compiler
from due_frames import due_frames
from emulated_board import require_board_programs
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py.interface import codec
from firmware_py.interface.arrivals import Arrival
from firmware_py.interface.enums import Mode, OperatorRequest
from firmware_py.interface.frame import Frame, WordFrame, word_of
from firmware_py.interface.generated.records import (
    Accelerometer,
    DriveEstop,
    EncoderEstimates,
    OperatorCommand,
)
from firmware_py.node import inbox
from firmware_py.node.inbox import CAPACITY, LONGEST_DATED_TICKS
from firmware_py.shell.builds import Build, node_of
from firmware_py.shell.node import Node
from firmware_py.shell.parameters import config_from

ESTOP = codec.DRIVE_ESTOP.encode(DriveEstop())
BUILDS: tuple[Build, ...] = ("python", "compiled", "host-single", "cortex-m7", "cortex-m4f")


@pytest.fixture(params=BUILDS)
def node(request: pytest.FixtureRequest) -> Node:
    if request.param.startswith("cortex"):
        require_board_programs()
    elif request.param == "host-single":
        require_compiler("gcc")
    return node_of(request.param)(config_from({}))


def sample(counter: int) -> Frame:
    return codec.ACCELEROMETER.encode(Accelerometer(0.0, 0.0, 0.0), counter)


def command(counter: int) -> Frame:
    return codec.OPERATOR_COMMAND.encode(OperatorCommand(OperatorRequest.IDLE, 0.0, 0.0), counter)


FLOODS = {
    "samples": [sample(number) for number in range(1000)],
    "commands": [command(number) for number in range(1000)],
    "E-stops of a wrong length": [Frame(ESTOP.can_id, b"\0")] * 1000,
    "frames of others": [Frame(0x7FF, b"")] * 1000,
}


@pytest.mark.requirement("S-07")
@pytest.mark.parametrize("flood", FLOODS)
@pytest.mark.parametrize("elapsed_ticks", [1, 2, 100, 1001])
def test_an_e_stop_before_a_flood_is_obeyed_in_the_next_tick(
    flood: str, elapsed_ticks: int, node: Node
) -> None:
    node.tick([], 1)
    node.tick([ESTOP, *FLOODS[flood]], elapsed_ticks)
    assert node.outputs.mode == Mode.E_STOP
    node.tick([], 1)
    assert node.inputs.estop is False


def test_a_full_inbox_keeps_the_newest_frames(node: Node) -> None:
    node.tick([sample(255), command(0)], 1)
    node.tick([*(sample(number) for number in range(1, 600)), command(1)], 1)
    assert node.counters.frames + node.counters.rejected_sequence == 2 + CAPACITY
    assert node.inputs.operator.age_ticks == 0


def divided(
    frames: list[Frame], newest: Arrival, ticks: int, elapsed_ticks: int, most_ticks: int = 500
) -> list[list[int]]:
    """The indices of the frames of each period."""
    waiting = [0] * inbox.SIZE
    for can_id, data in frames:
        inbox.receive(waiting, WordFrame(can_id, len(data), word_of(data)))
    periods = inbox.advance(waiting, newest, ticks, elapsed_ticks, most_ticks)
    found = []
    for _ in range(periods):
        found.append([frames.index(frame) for frame in due_frames(waiting)])
        inbox.end_period(waiting)
    assert waiting[inbox.PERIODS] == 0
    assert waiting[inbox.TAKEN] == waiting[inbox.RECEIVED]
    return found


def encoder(number: int) -> Frame:
    return codec.ENCODER_ESTIMATES.encode(EncoderEstimates(1e-3 * number, 0.0))


SAMPLES = [frame for number in (11, 12, 13) for frame in (encoder(number), sample(number))]
SWAPPED = [SAMPLES[index] for index in (1, 0, 3, 2, 5, 4)]
NEWEST = Arrival(100, 10)
DAMAGED = Frame(sample(11).can_id, bytes(8))


@pytest.mark.parametrize(
    ("frames", "elapsed_ticks", "periods"),
    [
        (SAMPLES, 3, [[0, 1], [2, 3], [4, 5]]),
        # In any order within a sample; the other frames join the sample that they follow.
        ([SAMPLES[1], SAMPLES[0], *SAMPLES[2:4], command(1), SAMPLES[5]], 3, [[0, 1], [2, 3, 4], [5]]),
        # The last period is due; what was to come meanwhile is missing.
        (SAMPLES, 4, [[0, 1], [2, 3], [4, 5], []]),
        (SAMPLES[2:], 3, [[], [0, 1], [2, 3]]),
        # From before the first period, and of periods that are still to come.
        ([sample(9), sample(10), *SWAPPED], 3, [[0, 1, 2, 3], [4, 5], [6, 7]]),
        (SAMPLES, 2, [[0, 1], [2, 3, 4, 5]]),
        # An encoder frame alone, or with a damaged accelerometer frame, lies before its successor.
        ([encoder(11), DAMAGED, encoder(12), *SAMPLES[4:]], 3, [[0, 1], [2], [3, 4]]),
        ([command(1)], 3, [[], [], [0]]),
        ([], 3, [[], [], []]),
    ],
)
def test_each_sample_belongs_to_the_period_of_its_counter(
    frames: list[Frame], elapsed_ticks: int, periods: list[list[int]]
) -> None:
    assert divided(frames, NEWEST, 100, elapsed_ticks) == periods


def test_if_the_last_sample_is_too_old_the_newest_one_is_of_the_present_period() -> None:
    newest = Arrival(100 - LONGEST_DATED_TICKS, 200)
    assert divided(SAMPLES, newest, 100, 3) == [[0, 1], [2, 3], [4, 5]]


def test_beyond_the_longest_catch_up_all_frames_are_of_the_present_period() -> None:
    assert divided(SAMPLES, NEWEST, 100, 6, most_ticks=5) == [[], [], [], [], [0, 1, 2, 3, 4, 5]]
    assert divided(SAMPLES, NEWEST, 100, 3, most_ticks=3) == [[0, 1], [2, 3], [4, 5]]


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1 << 30), st.integers(1, 6))
def test_no_frame_is_lost_or_taken_twice(number: int, elapsed_ticks: int) -> None:
    """Of any frames in any order, with a second pause before the periods of the first have been run."""
    dice = random.Random(number)
    waiting, sent, taken = [0] * inbox.SIZE, [], []
    for _ in range(3):
        for _ in range(dice.randrange(CAPACITY // 4)):
            sent.append(WordFrame(dice.choice((0x009, 0x028, 0x048, 0x001)), 8, len(sent)))
            inbox.receive(waiting, sent[-1])
        periods = inbox.advance(waiting, NEWEST, 100, elapsed_ticks, 500)
        for _ in range(dice.randint(1, periods)):
            taken += due_frames(waiting)
            inbox.end_period(waiting)
    while waiting[inbox.PERIODS]:
        taken += due_frames(waiting)
        inbox.end_period(waiting)
    assert sorted(word_of(frame.data) for frame in taken) == list(range(len(sent)))
