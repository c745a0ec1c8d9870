"""`vibro.dbc` against the records, the enumerations, ODrive's published layout and the bus's capacity."""

import inspect
import math
from enum import IntEnum
from importlib.resources import files
from typing import Any

import cantools.database
import pytest
from cantools.database.can import Message, Signal

from firmware_py.builds.a2l import unit_of
from firmware_py.interface import enums
from firmware_py.interface.codec import CODEC_BY_ID, CODECS, FrameCodec
from firmware_py.interface.dbc import database
from firmware_py.interface.frame import worst_case_bits
from firmware_py.interface.generated import records

RECORDS = [
    value
    for value in vars(records).values()
    if inspect.isclass(value) and issubclass(value, tuple) and hasattr(value, "_fields")
]
MESSAGES = database().messages
PROTECTION = {"counter", "crc"}

ENUM_OF_SIGNAL: dict[str, type[IntEnum]] = {
    "axis_error": enums.AxisError,
    "active_errors": enums.AxisError,
    "disarm_reason": enums.AxisError,
    "axis_state": enums.AxisState,
    "requested_state": enums.AxisState,
    "procedure_result": enums.ProcedureResult,
    "control_mode": enums.ControlMode,
    "input_mode": enums.InputMode,
    "request": enums.OperatorRequest,
    "mode": enums.Mode,
    "fault": enums.Fault,
    "refusal": enums.Refusal,
    "acting_limit": enums.ActingLimit,
    "regime": enums.Regime,
    "gait_state": enums.GaitState,
}

ODRIVE = cantools.database.load_file(
    str(files("odrive_can") / "dbc" / "odrive-cansimple-0.6.10.dbc"), strict=False
)
"""ODrive's own DBC, of the package odrive-can."""

# All numbers of CANSimple 0.6.10 that a drive acts on, and Start_Anticogging of 0.5.
ACTED_ON_BY_DRIVES = frozenset(
    {0x02, 0x04, 0x06, 0x07, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F, 0x10, 0x11, 0x12, 0x13, 0x16, 0x18, 0x19, 0x1A}
    | {0x1B, 0x1F}
)
FOUND_BY = frozenset({0x00, 0x01, 0x06})
"""Get_Version, Heartbeat and Address: ODrive's programs take their sender for a drive."""

BROADCAST_NODE = 63
"""Drives without a node number answer here."""

OWN_NODE = {"Drive": 0, "Sensors": 1, "Operator": 2, "Firmware": 3}


def attribute(message: Message, name: str) -> Any:
    assert message.dbc is not None
    found = message.dbc.attributes.get(name)
    return 0 if found is None else found.value


def inner_signals(message: Message) -> list[Signal]:
    return [signal for signal in message.signals if signal.name not in PROTECTION]


def message_of(record: type) -> Message:
    return database().get_message_by_name(record.__name__)


def by_name(record: type) -> str:
    return record.__name__


def test_every_record_has_a_message_and_every_message_a_record() -> None:
    assert {record.__name__ for record in RECORDS} == {message.name for message in MESSAGES}
    assert set(CODECS) == set(RECORDS)
    assert len(CODEC_BY_ID) == len(RECORDS)


@pytest.mark.parametrize("record", RECORDS, ids=by_name)
def test_suffixes_are_the_units(record: Any) -> None:
    """The units that the A2L file gives to the same suffixes; a share has the unit 1."""
    for signal in inner_signals(message_of(record)):
        assert ("" if signal.unit in (None, "1") else signal.unit) == unit_of(signal.name), signal.name


@pytest.mark.parametrize("record", RECORDS, ids=by_name)
def test_ranges_lie_on_whole_counts_that_fit(record: Any) -> None:
    for signal in message_of(record).signals:
        if signal.is_float:
            continue
        assert signal.minimum is not None
        assert signal.maximum is not None
        assert signal.minimum < signal.maximum
        lowest = -(2 ** (signal.length - 1)) if signal.is_signed else 0
        highest = 2 ** (signal.length - signal.is_signed) - 1
        for edge in (signal.minimum, signal.maximum):
            counts = edge / signal.scale
            assert math.isclose(counts, round(counts), abs_tol=1e-6), signal.name
            assert lowest <= round(counts) <= highest, signal.name
        if signal.is_signed:
            assert signal.minimum == -signal.maximum, f"{signal.name}: clipping must look alike on both sides"


@pytest.mark.parametrize("record", RECORDS, ids=by_name)
def test_codecs_know_what_the_dbc_says(record: Any) -> None:
    codec: FrameCodec[Any] = CODECS[record]
    message = message_of(record)
    assert (codec.can_id, codec.length) == (message.frame_id, message.length)
    assert codec.sender == (message.senders[0] if message.senders else None)
    cycle_ms = attribute(message, "GenMsgCycleTime")
    assert codec.period_s == (cycle_ms / 1000 if cycle_ms else None)
    for signal in inner_signals(message):
        if not signal.is_float:
            assert codec.signals[signal.name].low == pytest.approx(signal.minimum, rel=1e-12)
            assert codec.signals[signal.name].high == pytest.approx(signal.maximum, rel=1e-12)


def test_value_tables_are_the_enumerations() -> None:
    seen = set()
    for message in MESSAGES:
        for signal in message.signals:
            if signal.choices is None:
                continue
            table = {value: str(name) for value, name in signal.choices.items()}
            enum = ENUM_OF_SIGNAL[signal.name]
            assert table == {member.value: member.name for member in enum}, signal.name
            seen.add(signal.name)
    assert seen == set(ENUM_OF_SIGNAL)


def test_accelerometer_scales() -> None:
    signals = CODECS[records.Accelerometer].signals
    g_m_s2 = 9.80665
    assert signals["striker_low_m_s2"].scale * 2048 == g_m_s2
    assert signals["housing_m_s2"].scale * 2048 == g_m_s2
    assert signals["striker_high_m_s2"].scale == pytest.approx(0.049 * g_m_s2, rel=1e-15)
    assert signals["striker_low_m_s2"].high == pytest.approx(16 * g_m_s2, rel=1e-4)
    assert signals["striker_high_m_s2"].high >= 200 * g_m_s2


def test_drive_frames_are_odrives() -> None:
    theirs = {message.frame_id: message for message in ODRIVE.messages}
    for message in MESSAGES:
        if message.frame_id >= 0x20:
            continue
        signals, same = (
            {signal.start: (signal.length, signal.is_float, signal.byte_order) for signal in one.signals}
            for one in (message, theirs[message.frame_id])
        )
        assert message.length == theirs[message.frame_id].length, message.name
        assert signals == same, message.name
        assert all(signal.scale == 1 and signal.offset == 0 for signal in message.signals), message.name
        assert message.comment is not None
        assert message.comment.startswith("ODrive CANSimple 0.6")


def own_messages() -> list[Message]:
    return [message for message in MESSAGES if message.frame_id >= 0x20]


def test_every_sender_has_its_node_number() -> None:
    for message in own_messages():
        assert [message.frame_id >> 5] == [OWN_NODE[sender] for sender in message.senders], message.name


def test_no_frame_of_ours_belongs_to_another_drive() -> None:
    """Every node number that the documents leave to other drives, and the one of drives without a number."""
    others = set(range(BROADCAST_NODE + 1)) - set(OWN_NODE.values())
    assert [message.name for message in MESSAGES if message.frame_id >> 5 in others] == []


def test_no_frame_of_ours_is_a_command_to_any_drive_or_looks_like_one() -> None:
    """Not even a drive left on one of our own node numbers stops, reboots or is found because of us."""
    for message in own_messages():
        assert message.frame_id & 0x1F not in ACTED_ON_BY_DRIVES | FOUND_BY, message.name


def test_documents_name_the_node_numbers_that_must_stay_free() -> None:
    for node in ("Sensors", "Operator", "Firmware"):
        comment = database().get_node_by_name(node).comment
        assert comment is not None
        assert comment.startswith(f"Node number {OWN_NODE[node]}.")


def test_identifiers_are_distinct_and_of_11_bits() -> None:
    identifiers = [message.frame_id for message in MESSAGES]
    assert len(set(identifiers)) == len(identifiers)
    assert all(0 <= identifier <= 0x7FF for identifier in identifiers)
    assert not any(message.is_extended_frame for message in MESSAGES)


def test_only_the_protocols_of_drive_and_xcp_go_without_counter_and_crc() -> None:
    for message in MESSAGES:
        names = [signal.name for signal in message.signals]
        unprotected = message.frame_id < 0x20 or message.name in ("XcpCommand", "XcpResponse")
        assert ("counter" in names, "crc" in names) == ((False, False) if unprotected else (True, True)), (
            message.name
        )


def test_send_types_go_with_cycle_times() -> None:
    for message in MESSAGES:
        cyclic = message.send_type == "Cyclic"
        assert message.send_type in ("Cyclic", "Event")
        assert bool(attribute(message, "GenMsgCycleTime")) is cyclic, message.name
        if not cyclic and message.senders:
            assert attribute(message, "GenMsgDelayTime") > 0, f"{message.name}: no bound on its rate"


def test_everything_is_explained() -> None:
    for message in MESSAGES:
        assert message.comment, message.name
        for signal in inner_signals(message):
            assert signal.comment, f"{message.name}.{signal.name}"


@pytest.mark.parametrize("length", range(9))
def test_worst_case_bits(length: int) -> None:
    stuffable = 34 + 8 * length
    assert worst_case_bits(length) == 8 * length + 47 + (stuffable - 1) // 4
