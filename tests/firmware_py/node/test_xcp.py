"""The XCP slave alone: its commands, its refusals, its DAQ lists, and any command in any order."""

import math
import os
import random
import struct
from itertools import pairwise

import pytest
from closed_loop import Bench
from xcp_session import TICKS, ask, command, commands_of, configure, is_sample, staged, write

from firmware_py.interface.enums import Mode, XcpError
from firmware_py.interface.enums import XcpCommandCode as Code
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated import kinds
from firmware_py.interface.parameter_table import INDEX, TABLE
from firmware_py.node import elements, xcp
from firmware_py.node.memory import file_name
from firmware_py.node.tick import NodeState
from firmware_py.shell.builds import Build
from firmware_py.shell.node import FirmwareNode
from firmware_py.shell.parameters import DEFAULTS, config_from, with_overrides

COMMANDS = int(os.environ.get("VIBROHIL_XCP_COMMANDS", "3000"))
WRITES = 300
FLOAT32_MAX = 3.4028235e38
RATE = 4 * INDEX["speed.gain_p_n_m_s"]


def node() -> FirmwareNode:
    return FirmwareNode(config_from({}))


def connected() -> FirmwareNode:
    one = node()
    assert ask(one, Code.CONNECT)[0] == xcp.RESPONSE
    return one


def set_mta(one: FirmwareNode, extension: int, address: int) -> None:
    assert ask(one, Code.SET_MTA, 0, 0, extension, *struct.pack("<I", address))[0] == xcp.RESPONSE


def error_of(answer: bytes) -> XcpError:
    assert answer[0] == xcp.ERROR, answer
    return XcpError(answer[1])


def samples(sent: list[Frame]) -> list[bytes]:
    return [frame.data for frame in sent if is_sample(frame)]


def test_without_a_session_only_connect_is_answered() -> None:
    one = node()
    for code in Code:
        if code != Code.CONNECT:
            assert all(frame.can_id != kinds.XCP_RESPONSE.can_id for frame in one.tick([command(code)], 1))
    assert ask(one, Code.CONNECT) == bytes((0xFF, 0x05, 0x80, 8, 8, 0, 1, 1))


def test_it_names_its_a2l_file() -> None:
    one = connected()
    length = int.from_bytes(ask(one, Code.GET_ID, 1)[4:8], "little")
    text = b"".join(ask(one, Code.UPLOAD, size)[1 : 1 + size] for size in (7, length - 7))
    assert text.decode() == file_name()


@pytest.mark.parametrize(
    ("code", "data", "error"),
    [
        (Code.UPLOAD, (8,), XcpError.OUT_OF_RANGE),
        (Code.UPLOAD, (0,), XcpError.OUT_OF_RANGE),
        (Code.SHORT_UPLOAD, (4, 0, 3, 0, 0, 0, 0), XcpError.OUT_OF_RANGE),
        (Code.SHORT_UPLOAD, (4, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF), XcpError.OUT_OF_RANGE),
        (Code.BUILD_CHECKSUM, (0, 0, 0, 255, 0, 0, 0), XcpError.OUT_OF_RANGE),
        (Code.DOWNLOAD, (4, 0, 0, 0, 0), XcpError.SEQUENCE),
        (Code.SYNCH, (), XcpError.CMD_SYNCH),
        (0xED, (), XcpError.CMD_UNKNOWN),
        (Code.ALLOC_ODT, (0, 0, 0, 1), XcpError.SEQUENCE),
        (Code.SET_DAQ_PTR, (0, 0, 0, 0, 0), XcpError.OUT_OF_RANGE),
        (Code.WRITE_DAQ, (0xFF, 4, 0, 0, 0, 0, 0), XcpError.SEQUENCE),
        (Code.START_STOP_DAQ_LIST, (1, 0, 0), XcpError.OUT_OF_RANGE),
        (Code.START_STOP_SYNCH, (3,), XcpError.MODE_NOT_VALID),
        (Code.GET_DAQ_LIST_INFO, (0, 0, 0), XcpError.OUT_OF_RANGE),
        (Code.GET_DAQ_EVENT_INFO, (0, 1, 0), XcpError.OUT_OF_RANGE),
    ],
)
def test_a_command_is_refused_and_changes_nothing(code: Code, data: tuple[int, ...], error: XcpError) -> None:
    one = connected()
    before = list(one.pool)
    assert error_of(ask(one, code, *data)) is error
    changed = {index for index, value in enumerate(one.pool) if value != before[index]}
    times = {xcp.ENDS, xcp.WAKES, xcp.TICK}
    assert changed <= times | {xcp.PACKET, xcp.LOW, xcp.HIGH}


def test_a_write_needs_a_fresh_address_and_a_whole_element() -> None:
    one, value = connected(), struct.pack("<f", 0.0625)
    set_mta(one, xcp.CHARACTERISTICS, RATE)
    assert error_of(ask(one, Code.DOWNLOAD, 2, *value)) is XcpError.OUT_OF_RANGE
    set_mta(one, xcp.CHARACTERISTICS, RATE + 2)
    assert error_of(ask(one, Code.DOWNLOAD, 4, *value)) is XcpError.OUT_OF_RANGE
    set_mta(one, xcp.CHARACTERISTICS, RATE)
    assert ask(one, Code.UPLOAD, 4)[0] == xcp.RESPONSE
    assert error_of(ask(one, Code.DOWNLOAD, 4, *value)) is XcpError.SEQUENCE
    set_mta(one, xcp.MEASUREMENTS, 0)
    assert error_of(ask(one, Code.DOWNLOAD, 4, *value)) is XcpError.WRITE_PROTECTED
    set_mta(one, xcp.CHARACTERISTICS, RATE)
    assert ask(one, Code.DOWNLOAD, 4, *value)[0] == xcp.RESPONSE
    assert error_of(ask(one, Code.DOWNLOAD, 4, *value)) is XcpError.SEQUENCE
    assert one.values == DEFAULTS


def test_a_coupled_pair_changes_together_or_not_at_all() -> None:
    """`start.lowest_ratio` may not exceed `start.highest_ratio`: both rise in one commit, in any order."""
    one = connected()
    wanted = {"hold.lowest_impulse_n_s": 2.0, "hold.highest_impulse_n_s": 3.0}
    for name, value in wanted.items():
        assert write(one, INDEX[name], struct.pack("<f", value)) is XcpError.NONE
        if name == "hold.lowest_impulse_n_s":
            assert write(one, xcp.COMMIT, struct.pack("<I", 1)) is XcpError.OUT_OF_RANGE
            assert one.values == DEFAULTS
    assert write(one, xcp.COMMIT, struct.pack("<I", 2)) is XcpError.OUT_OF_RANGE
    assert write(one, xcp.COMMIT, struct.pack("<I", 1)) is XcpError.NONE
    assert one.values == DEFAULTS | wanted


def test_any_writes_in_any_order_stay_within_the_bounds() -> None:
    """Values below, at, between and beyond the bounds, NaN among them, with commits in between."""
    dice, one = random.Random(11), connected()
    changed: set[str] = set()
    for _ in range(WRITES):
        parameter = dice.choice(TABLE)
        low, high = parameter.low, parameter.high
        beyond = (low - 1.0, high + 1.0, math.nan, math.inf, -math.inf)
        value = dice.choice((low, high, dice.uniform(low, high), dice.choice(beyond)))
        write(one, INDEX[parameter.name], struct.pack("<f", min(value, FLOAT32_MAX)))
        if dice.random() < 0.2:
            before = dict(one.values)
            error = write(one, xcp.COMMIT, struct.pack("<I", 1))
            assert error is XcpError.NONE or one.values == before
            ask(one, Code.CONNECT)
        changed |= {name for name, value in one.values.items() if value != DEFAULTS[name]}
    assert with_overrides(one.values) == one.values
    assert changed
    assert changed <= {parameter.name for parameter in TABLE if parameter.is_calibrated}


def test_a_write_that_nothing_judges_is_refused_in_the_next_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a board that does not call `vibro_calibrate`, which can still be measured."""
    monkeypatch.setattr(FirmwareNode, "calibrate", lambda *_: None)
    one = connected()
    set_mta(one, xcp.CHARACTERISTICS, RATE)
    assert error_of(ask(one, Code.DOWNLOAD, 4, 0, 0, 0, 0)) is XcpError.ACCESS_DENIED
    assert ask(one, Code.SHORT_UPLOAD, 4)[0] == xcp.RESPONSE
    assert error_of(ask(one, Code.SHORT_UPLOAD, 4, 0, xcp.CHARACTERISTICS)) is XcpError.OUT_OF_RANGE


def test_lists_are_allocated_once() -> None:
    one = connected()
    assert ask(one, Code.FREE_DAQ)[0] == ask(one, Code.ALLOC_DAQ, 0, 1)[0] == xcp.RESPONSE
    assert error_of(ask(one, Code.ALLOC_DAQ, 0, 2)) is XcpError.SEQUENCE


def test_a_new_session_begins_with_the_values_in_use() -> None:
    one = connected()
    assert write(one, INDEX["start.rise_s"], struct.pack("<f", 5.0)) is XcpError.NONE
    assert staged(one, "start.rise_s") == 5.0
    ask(one, Code.CONNECT)
    assert staged(one, "start.rise_s") == DEFAULTS["start.rise_s"]


def test_more_than_one_frame_per_tick_is_not_started() -> None:
    one = connected()
    configure(one, [(list(range(40)), 39)])
    assert error_of(ask(one, Code.START_STOP_SYNCH, 1)) is XcpError.MEMORY_OVERFLOW
    configure(one, [([0], 1), ([1], 255)])
    assert error_of(ask(one, Code.START_STOP_SYNCH, 1)) is XcpError.MEMORY_OVERFLOW
    configure(one, [(list(range(40)), 40)])
    assert ask(one, Code.START_STOP_SYNCH, 1)[0] == xcp.RESPONSE
    assert error_of(ask(one, Code.FREE_DAQ)) is XcpError.DAQ_ACTIVE


@pytest.mark.parametrize("seed", range(20))
def test_lists_that_fill_the_bus_lose_no_sample(seed: int) -> None:
    """Any lists up to one frame per tick: each sample is complete, of its own tick, and on time."""
    dice = random.Random(seed)
    lists: list[tuple[list[int], int]] = []
    free = 1.0
    while len(lists) < xcp.MOST_LISTS and sum(len(found) for found, _ in lists) < xcp.MOST_ODTS:
        prescaler = dice.randrange(1, 60)
        room = xcp.MOST_ODTS - sum(len(found) for found, _ in lists)
        most = min(math.floor(free * prescaler + 1e-9), room)
        if most == 0:
            break
        count = dice.randrange(1, most + 1)
        lists.append(([dice.randrange(len(elements.ALL)) for _ in range(count)], prescaler))
        free -= count / prescaler
    one = connected()
    configure(one, lists)
    sent = [*one.tick([command(Code.START_STOP_SYNCH, 1)], 1)]
    states = {one._state.ticks: one._state}
    packets = samples(sent)
    for _ in range(500):
        sent = one.tick([], 1)
        states[one._state.ticks] = one._state
        assert len(samples(sent)) <= 1
        packets += samples(sent)
    firsts = [sum(len(found) for found, _ in lists[:k]) for k in range(len(lists))]
    for first, (found, prescaler) in zip(firsts, lists, strict=True):
        own = [packet for packet in packets if first <= packet[0] < first + len(found)]
        assert [packet[0] - first for packet in own] == [k % len(found) for k in range(len(own))]
        assert len(own) // len(found) >= 500 // prescaler - 1
        stamps = [int.from_bytes(packet[1:3], "little") for packet in own if packet[0] == first]
        assert all(after - before == prescaler for before, after in pairwise(stamps))
        for k, packet in enumerate(own):
            tick, start = stamps[k // len(found)], 3 if packet[0] == first else 1
            word = int.from_bytes(packet[start : start + 4], "little")
            assert word == elements.word_at(states[tick], found[packet[0] - first])


def test_latching_reads_nothing_beyond_the_state() -> None:
    """A compiled build copies eight bytes from each member's address on; the last member has as many."""
    assert elements.ALL[-1].name == "counters.unsent"
    assert elements.ALL[-1].kind is int
    assert NodeState._fields[-1] == "counters"


def test_a_lost_master_stops_its_lists() -> None:
    one = connected()
    configure(one, [([0], 10)])
    assert ask(one, Code.START_STOP_SYNCH, 1)[0] == xcp.RESPONSE
    ticks = 10_000
    sent = [len(samples(one.tick([], 1))) for _ in range(ticks - TICKS)]
    assert sum(sent[-100:]) == 10
    sent = [len(samples(one.tick([], 1))) for _ in range(TICKS + 100)]
    assert sum(sent[-100:]) == 0
    assert one.tick([command(Code.GET_STATUS)], 1) == one.tick([], 1)  # the session has ended, too


def test_any_commands_in_any_order_during_motion_change_no_control_frame() -> None:
    """The torque comes first in every tick, and equals that of a firmware without a master, tick by tick.

    VIBROHIL_XCP_COMMANDS=200000 in the environment sends as many commands, to the compiled build.
    """
    build: Build = "compiled" if COMMANDS > 10_000 else "python"
    commands = commands_of(random.Random(7), 1 << 30)
    quiet, asked = Bench(build=build), Bench(build=build)
    asked.change = lambda _, frames: [*frames, next(commands)]
    for bench in (quiet, asked):
        bench.started()
    for _ in range(COMMANDS):
        torques = []
        for bench in (quiet, asked):
            bench.run(0.001, keep=False)
            torques.append([frame for frame in bench.sent if frame.can_id != kinds.XCP_RESPONSE.can_id])
            assert len(bench.sent) <= 3
            assert len(samples(bench.sent)) <= 1
        assert torques[0] == torques[1]
    assert asked.mode in (Mode.SOFT_START, Mode.RUN)
    assert asked.node.values == quiet.node.values
