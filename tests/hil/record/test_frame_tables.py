"""The tables of frames, and the quick look that finds those that cannot be decoded."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.interface import codec
from firmware_py.interface.codec import CODEC_BY_ID, CODECS, FrameCodec
from firmware_py.interface.dbc import SignalKind
from firmware_py.interface.frame import bytes_of
from firmware_py.interface.framing import seal
from firmware_py.interface.generated.records import DriveEstop, SetInputTorque
from hil.record.bus_reconstruction import frames_of
from hil.record.candump import NO_BUS, bus_log
from hil.record.frame_tables import find_refused, is_surely_valid, names_of, table_of

QUANTITIES = {SignalKind.QUANTITY, SignalKind.EXACT}
NUMBERS = [
    codec for codec in CODECS.values() if {signal.kind for signal in codec.signals.values()} <= QUANTITIES
]
"""The codecs of frames with numbers alone."""
KNOWN = [codec for codec in CODECS.values() if codec.record._fields]


def error_of(codec: FrameCodec, data: bytes) -> str | None:
    try:
        codec.decode(data)
    except ValueError as error:
        return f"0x{codec.can_id:03X}: {error}"
    return None


def is_valid_frame(codec: FrameCodec, data: bytes) -> bool:
    return bool(is_surely_valid(codec, np.frombuffer(data.ljust(8, b"\0"), np.uint8)[None])[0])


@pytest.mark.parametrize("codec", NUMBERS, ids=lambda codec: codec.record.__name__)
@given(content=st.binary(min_size=8, max_size=8), counter=st.integers(0, 255))
def test_what_is_surely_valid_can_be_decoded_and_what_was_sent_is(codec, content, counter):
    received = content[: codec.length]
    assert is_valid_frame(codec, received) == (error_of(codec, received) is None)
    kinds = codec.record.__annotations__.values()
    numbers = np.frombuffer(content, np.int16)[: len(kinds)].tolist()
    values = [
        abs(number) % 2 if kind is int else float(number) for kind, number in zip(kinds, numbers, strict=True)
    ]
    assert is_valid_frame(codec, codec.encode(codec.record._make(values), counter).data)


def sealed(codec: FrameCodec, content: bytes) -> bytes:
    """Any content with the checksum that belongs to it."""
    if not codec.protected:
        return content[: codec.length]
    below = 8 * (codec.length - 1) - codec.kind.counter_bits
    word = int.from_bytes(content, "little") & (1 << below) - 1
    return bytes_of(seal(codec.kind, word, content[0], True)[0].word, codec.length)


@pytest.mark.parametrize("codec", KNOWN, ids=lambda codec: codec.record.__name__)
@given(contents=st.lists(st.binary(min_size=8, max_size=8), max_size=4))
def test_tables_and_columns_have_what_the_codec_decodes_and_nothing_else(codec, contents):
    payloads = [one for content in contents for one in (content[: codec.length], sealed(codec, content))]
    bus = bus_log(np.arange(len(payloads)) / 4, np.full(len(payloads), codec.can_id), payloads)
    decoded = [tuple(codec.decode(one)) for one in payloads if error_of(codec, one) is None]
    table = table_of(bus, f"can/{codec.record.__name__}", 0.0)
    found = [table[name].to_pylist() for name in codec.record._fields]
    assert list(zip(*found, strict=True)) == decoded
    kinds = [float if codec.signals[name].is_real else int for name in codec.record._fields]
    assert all(
        type(value) is kind
        for row in zip(*found, strict=True)
        for value, kind in zip(row, kinds, strict=True)
    )
    columns = frames_of(bus, codec.record).signals
    assert (columns.shape, columns.tolist()) == ((len(decoded), len(kinds)), list(map(list, decoded)))


def test_frames_without_signals_have_their_times():
    bus = bus_log(np.array([0.5, 1.0]), np.full(2, codec.DRIVE_ESTOP.can_id), [b"", b""])
    found = frames_of(bus, DriveEstop)
    assert (found.t_s.tolist(), found.signals.shape) == ([0.5, 1.0], (2, 0))


@given(
    frames=st.lists(
        st.tuples(st.sampled_from([*CODEC_BY_ID, 0x7AB]), st.binary(max_size=8)), min_size=1, max_size=30
    )
)
def test_frames_are_refused_for_the_reason_of_their_codec(frames):
    bus = bus_log(
        1e-3 * np.arange(len(frames)),
        np.array([can_id for can_id, _ in frames]),
        [data for _, data in frames],
    )
    reasons = [
        error_of(CODEC_BY_ID[can_id], data) if can_id in CODEC_BY_ID else "0x7AB: not in the DBC"
        for can_id, data in frames
    ]
    assert find_refused(bus) == [(row, reason) for row, reason in enumerate(reasons) if reason is not None]


def test_a_frame_that_cannot_be_decoded_is_in_the_raw_table_alone():
    sent = codec.SET_INPUT_TORQUE.encode(SetInputTorque(0.25))
    bus = bus_log(np.array([0.5, 0.6]), np.full(2, sent.can_id), [sent.data, b"\xff"])
    assert names_of(bus) == ["can/raw", "can/SetInputTorque"]
    raw, decoded = (table_of(bus, name, 1000.0) for name in names_of(bus))
    assert raw["data"].to_pylist() == [sent.data, b"\xff"]
    assert decoded["t_s"].to_pylist() == [0.5]
    assert decoded["wall_time"][0].value == 1_000_500_000_000
    assert decoded["torque_n_m"].to_pylist() == [0.25]
    assert names_of(NO_BUS) == []


def test_a_table_of_frames_that_are_all_refused_is_empty():
    bus = bus_log(np.array([0.5]), np.array([codec.ACCELEROMETER.can_id]), [b"\xff"])
    table = table_of(bus, "can/Accelerometer", 0.0)
    assert (table.num_rows, "housing_m_s2" in table.column_names) == (0, True)
