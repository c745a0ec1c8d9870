"""The codec against cantools, at its edges, and against damaged frames."""

import ast
import math
from collections.abc import Callable
from typing import Any, get_type_hints

import pytest
from crccheck.crc import Crc8SaeJ1850  # type: ignore[import-untyped]  # it carries no types
from hypothesis import assume, given
from hypothesis import strategies as st

from firmware_py.interface import generate
from firmware_py.interface.codec import (
    ACCELEROMETER,
    CODECS,
    DRIVE_HEARTBEAT,
    ENCODER_ESTIMATES,
    SET_INPUT_TORQUE,
    FrameCodec,
    FrameError,
    FrameErrorReason,
    decode,
    encode,
)
from firmware_py.interface.dbc import Signal, SignalKind, database
from firmware_py.interface.enums import AxisError, AxisState, Mode
from firmware_py.interface.frame import Frame, bytes_of
from firmware_py.interface.generated.records import (
    Accelerometer,
    DriveEstop,
    DriveHeartbeat,
    EncoderEstimates,
    FirmwareHeartbeat,
    SetInputTorque,
)

ALL = list(CODECS.values())
PROTECTED = [codec for codec in ALL if codec.protected]
FLOAT32_MAX = 3.4028234663852886e38
EXTREMES = [0.0, -0.0, 1e-300, -1e-300, 1e300, -1e300]


def by_name(codec: FrameCodec[Any]) -> str:
    return codec.record.__name__


def values(signal: Signal) -> st.SearchStrategy[Any]:
    """Every value that a signal accepts, far beyond full scale included."""
    if signal.is_float:
        return st.floats(width=32, allow_nan=False, allow_infinity=False)
    if signal.kind is SignalKind.ENUMERATION:
        return st.sampled_from(sorted(signal.values))
    if signal.kind is not SignalKind.QUANTITY:
        return st.integers(signal.low_counts, signal.high_counts)
    if signal.scale == 1:
        return st.integers(-1000, 2**40)
    edges = [signal.low, signal.high, math.nextafter(signal.low, -math.inf), signal.high + signal.scale / 2]
    return st.floats(2 * signal.low - 1, 2 * signal.high + 1) | st.sampled_from(EXTREMES + edges)


@st.composite
def coded_records(draw: st.DrawFn) -> tuple[FrameCodec[Any], Any, int]:
    codec = draw(st.sampled_from(ALL))
    record = codec.record(*(draw(values(codec.signals[field])) for field in codec.record._fields))
    return codec, record, draw(st.integers(0, 40))


def modulus(codec: FrameCodec[Any]) -> int:
    """How many values the rolling counter has."""
    return 1 << codec.kind.counter_bits


def by_cantools(codec: FrameCodec[Any], record: Any, counter: int) -> bytes:
    """Data as cantools packs it, clamped to the DBC's ranges, with a checksum of crccheck's."""
    message = database().get_message_by_name(codec.record.__name__)
    clamped: dict[str, Any] = record._asdict()
    for signal in message.signals:
        if signal.name in clamped and signal.minimum is not None and signal.maximum is not None:
            clamped[signal.name] = min(max(clamped[signal.name], signal.minimum), signal.maximum)
    if not codec.protected:
        return bytes(message.encode(clamped))
    data = message.encode(clamped | {"counter": counter % modulus(codec), "crc": 0})
    return data[:-1] + bytes([Crc8SaeJ1850.calc(bytes([codec.can_id & 0xFF]) + data[:-1])])


def reason(action: Callable[[Any], object], argument: object) -> FrameErrorReason:
    with pytest.raises(FrameError) as refusal:
        action(argument)
    return refusal.value.reason


def smallest(codec: FrameCodec[Any]) -> dict[str, Any]:
    """The smallest value that each field may have."""
    return {name: min(signal.values) if signal.values else 0 for name, signal in codec.signals.items()}


# --- against cantools -----------------------------------------------------------------------------------


@given(coded=coded_records())
def test_encodes_what_cantools_encodes(coded: tuple[FrameCodec[Any], Any, int]) -> None:
    codec, record, counter = coded
    assert codec.encode(record, counter) == Frame(codec.can_id, by_cantools(codec, record, counter))


@given(coded=coded_records())
def test_decodes_what_cantools_decodes(coded: tuple[FrameCodec[Any], Any, int]) -> None:
    codec, record, counter = coded
    data = by_cantools(codec, record, counter)
    message = database().get_message_by_name(codec.record.__name__)
    reference = dict(message.decode(data, decode_choices=False))
    decoded = codec.decode(data)
    assert type(decoded) is codec.record
    assert decoded._asdict() == {field: reference[field] for field in codec.record._fields}
    if codec.protected:
        assert codec.counter(data) == reference["counter"] == counter % modulus(codec)


@given(coded=coded_records())
def test_a_round_trip_costs_half_a_count_and_happens_once(coded: tuple[FrameCodec[Any], Any, int]) -> None:
    codec, record, counter = coded
    frame = encode(record, counter)
    decoded = decode(frame)
    for field, sent, received in zip(record._fields, record, decoded, strict=True):
        signal = codec.signals[field]
        if signal.is_float or signal.scale == 1:
            assert received == min(max(sent, signal.low), signal.high)
        else:
            wanted = min(max(sent, signal.low), signal.high)
            assert abs(received - wanted) <= signal.scale / 2 * (1 + 1e-9)
    assert encode(decoded, counter) == frame


# --- saturation -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("codec", ALL, ids=by_name)
def test_a_clipped_quantity_is_exactly_full_scale(codec: FrameCodec[Any]) -> None:
    for field, signal in codec.signals.items():
        if signal.is_float or signal.kind is not SignalKind.QUANTITY:
            continue
        for clipped, sign in ((signal.high, 1.0), (signal.low, -1.0)):
            # Just beyond full scale, clipping in the signal's unit may round to a count too far.
            for excess in (0.0, 1e-12, 1e-9, 0.5 * signal.scale, 1e12):
                record = codec.record(**smallest(codec) | {field: clipped + sign * excess})
                assert getattr(codec.decode(codec.encode(record).data), field) == clipped
        within = signal.high - signal.scale
        record = codec.record(**smallest(codec) | {field: within})
        assert getattr(codec.decode(codec.encode(record).data), field) < signal.high


# --- refused records ------------------------------------------------------------------------------------


def unlisted(signal: Signal) -> list[int]:
    """Numbers beside an enumeration's values, as far as eight bits hold them."""
    return sorted(set(range(1 << min(signal.bits, 8))) - signal.values)


def unsendable(signal: Signal) -> list[tuple[Any, FrameErrorReason]]:
    """Values that no frame carries in a field, and the reason that is given."""
    refused: list[tuple[Any, FrameErrorReason]] = [
        *((value, FrameErrorReason.NOT_FINITE) for value in (math.nan, math.inf, -math.inf)),
        *((value, FrameErrorReason.NOT_A_NUMBER) for value in ("1", None)),
    ]
    if signal.is_float:
        return refused + [(value, FrameErrorReason.RANGE) for value in (4e38, -1e300)]
    if signal.kind is SignalKind.QUANTITY:
        return refused
    refused.append((1.0, FrameErrorReason.NOT_A_NUMBER))
    if signal.kind is SignalKind.ENUMERATION:
        outside = [-1, 1 << signal.bits, *unlisted(signal)]
        return refused + [(value, FrameErrorReason.ENUMERATION) for value in outside]
    outside = [signal.low_counts - 1, signal.high_counts + 1]
    return refused + [(value, FrameErrorReason.RANGE) for value in outside]


@pytest.mark.parametrize("codec", ALL, ids=by_name)
def test_no_field_sends_what_it_cannot_carry(codec: FrameCodec[Any]) -> None:
    for field, signal in codec.signals.items():
        for value, wanted in unsendable(signal):
            record = codec.record(**smallest(codec) | {field: value})
            assert reason(codec.encode, record) is wanted, (field, value)


def test_a_refusal_names_field_value_and_what_was_wanted() -> None:
    with pytest.raises(
        FrameError, match=r"FirmwareHeartbeat\.mode: value 9, wanted one of 0, 1, 2, 3, 4, 5, 6, 7"
    ):
        encode(FirmwareHeartbeat(9, 0, 0, 0.0, 0))
    with pytest.raises(FrameError, match=r"Accelerometer\.housing_m_s2: nan, wanted a finite number"):
        encode(Accelerometer(0.0, 0.0, math.nan))
    with pytest.raises(FrameError, match=r"SetInputTorque \(0x00E\): 4 data bytes, wanted 8"):
        SET_INPUT_TORQUE.decode(bytes(4))


def test_a_record_with_too_few_fields() -> None:
    with pytest.raises(FrameError, match="cannot send"):
        ACCELEROMETER.encode((1.0, 2.0))  # type: ignore[arg-type]


def test_no_record_of_the_bus() -> None:
    with pytest.raises(TypeError, match="Frame is no record"):
        encode(Frame(1, b""))


# --- refused frames -------------------------------------------------------------------------------------


def sample(codec: FrameCodec[Any], counter: int = 5) -> bytes:
    """Data of a record with distinct, unremarkable values."""
    fields = {
        name: sorted(signal.values)[-1] if signal.values else (1 if signal.scale == 1 else 3.5 * signal.scale)
        for name, signal in codec.signals.items()
    }
    return codec.encode(codec.record(**fields), counter).data


def sealed(codec: FrameCodec[Any], body: bytes) -> bytes:
    return body + bytes([Crc8SaeJ1850.calc(bytes([codec.can_id & 0xFF]) + body)])


def flipped(data: bytes, *bits: int) -> bytes:
    number = int.from_bytes(data, "little")
    for bit in bits:
        number ^= 1 << bit
    return number.to_bytes(len(data), "little")


@pytest.mark.parametrize("codec", PROTECTED, ids=by_name)
def test_every_flip_of_one_or_two_bits_is_found(codec: FrameCodec[Any]) -> None:
    data = sample(codec)
    bits = range(8 * codec.length)
    for first in bits:
        for second in bits[first:]:
            damaged = flipped(data, first) if first == second else flipped(data, first, second)
            assert reason(codec.decode, damaged) is FrameErrorReason.CRC


@pytest.mark.parametrize("codec", PROTECTED, ids=by_name)
def test_data_under_another_identifier_is_found(codec: FrameCodec[Any]) -> None:
    for other in PROTECTED:
        if other is not codec and other.length == codec.length:
            assert reason(other.decode, sample(codec)) is FrameErrorReason.CRC


@pytest.mark.parametrize("codec", ALL, ids=by_name)
def test_every_other_length_is_refused(codec: FrameCodec[Any]) -> None:
    data = sample(codec) + bytes(8)
    for length in set(range(9)) - {codec.length}:
        assert reason(codec.decode, data[:length]) is FrameErrorReason.LENGTH


def with_counts(codec: FrameCodec[Any], signal: Signal, counts: int) -> bytes:
    """Data of an unremarkable record, but for the counts of one signal."""
    mask = (1 << signal.bits) - 1 << signal.start
    word = int.from_bytes(sample(codec), "little") & ~mask | counts << signal.start & mask
    data = word.to_bytes(codec.length, "little")
    return sealed(codec, data[:-1]) if codec.protected else data


def unreadable(signal: Signal) -> list[tuple[int, FrameErrorReason]]:
    """Counts that a receiver refuses in a signal, and the reason that is given."""
    if signal.is_float:
        return [(bits, FrameErrorReason.NOT_FINITE) for bits in (0x7FC00000, 0x7F800000, 0xFF800000)]
    if signal.kind is SignalKind.ENUMERATION:
        return [(counts, FrameErrorReason.ENUMERATION) for counts in unlisted(signal)]
    lowest = -(1 << signal.bits - 1) if signal.is_signed else 0
    below, above = (
        range(lowest, signal.low_counts),
        range(signal.high_counts + 1, lowest + (1 << signal.bits)),
    )
    edges = [*below[:1], *below[-1:], *above[:1], *above[-1:]]
    return [(counts, FrameErrorReason.RANGE) for counts in edges]


@pytest.mark.parametrize("codec", ALL, ids=by_name)
def test_no_count_that_means_nothing_is_read(codec: FrameCodec[Any]) -> None:
    for field, signal in codec.signals.items():
        for counts, wanted in unreadable(signal):
            assert reason(codec.decode, with_counts(codec, signal, counts)) is wanted, (field, counts)


@given(codec=st.sampled_from(ALL), noise=st.binary(min_size=8, max_size=8))
def test_whatever_decodes_can_be_sent_again(codec: FrameCodec[Any], noise: bytes) -> None:
    """Random data are refused, or are a record that survives the way back."""
    data = sealed(codec, noise[: codec.length - 1]) if codec.protected else noise[: codec.length]
    try:
        record = codec.decode(data)
    except FrameError as refusal:
        assume(refusal.reason is not FrameErrorReason.CRC)
        return
    assert codec.decode(codec.encode(record).data) == record


def test_an_unknown_identifier() -> None:
    assert reason(decode, Frame(0x7FF, bytes(8))) is FrameErrorReason.UNKNOWN_ID


# --- the generated file ----------------------------------------------------------------------------------


def test_the_checked_in_codec_is_what_the_dbc_gives() -> None:
    """Up to its layout, which is ruff's; `firmware_py.interface.generate` writes it again."""
    for file, text in generate.sources().items():
        written = (generate.GENERATED / file).read_text(encoding="utf-8")
        assert ast.dump(ast.parse(written)) == ast.dump(ast.parse(text)), file


@given(coded=coded_records())
def test_a_word_is_the_frames_data(coded: tuple[FrameCodec[Any], Any, int]) -> None:
    codec, record, counter = coded
    (can_id, length, word), sendable = codec.pack(record, counter)
    assert sendable
    assert (can_id, length) == (codec.can_id, codec.length)
    data = codec.encode(record, counter).data
    assert word.to_bytes(8, "little", signed=True) == data.ljust(8, b"\0")
    assert codec.unpack(codec.length, word) == (codec.decode(data), FrameErrorReason.NONE)


@given(codec=st.sampled_from(ALL), word=st.integers(-(2**63), 2**63 - 1), length=st.integers(0, 8))
def test_no_word_raises_and_each_is_judged(codec: FrameCodec[Any], word: int, length: int) -> None:
    record, reason = codec.unpack(length, word)
    assert type(record) is codec.record
    data = bytes_of(word, length)
    if reason is FrameErrorReason.NONE:
        assert codec.decode(data) == record
    else:
        with pytest.raises(FrameError) as refused:
            codec.decode(data)
        assert (refused.value.reason is FrameErrorReason.LENGTH) == (length != codec.length)


@given(values=st.lists(st.floats() | st.integers(-(2**40), 2**40), min_size=7, max_size=7))
def test_packing_never_raises_and_what_is_not_sendable_is_an_empty_word(values: list[float]) -> None:
    for codec in ALL:
        hints = get_type_hints(codec.record)
        taken = [
            value if hint is float else (int(value) if math.isfinite(value) else 7)
            for value, hint in zip(values, hints.values(), strict=False)
        ]
        (_, _, word), sendable = codec.pack(codec.record(*taken), 3)
        assert -(2**63) <= word < 2**63
        if sendable:
            assert codec.unpack(codec.length, word)[1] is FrameErrorReason.NONE
        else:
            assert word == 0


# --- particulars ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("codec", PROTECTED, ids=by_name)
def test_the_counter_wraps(codec: FrameCodec[Any]) -> None:
    turn = modulus(codec)
    counted = [codec.counter(sample(codec, counter)) for counter in range(2 * turn + 3)]
    assert counted == [counter % turn for counter in range(2 * turn + 3)]
    assert len({sample(codec, counter) for counter in range(turn)}) == turn


def test_the_accelerometers_counter_is_wider_than_any_pause_that_is_ridden_through() -> None:
    assert modulus(CODECS[Accelerometer]) == 256
    assert {modulus(codec) for codec in PROTECTED if codec.record is not Accelerometer} == {16}


def test_the_drives_frames_carry_no_counter() -> None:
    assert ENCODER_ESTIMATES.encode(EncoderEstimates(0.5, 1.0), 1) == ENCODER_ESTIMATES.encode(
        EncoderEstimates(0.5, 1.0), 2
    )
    with pytest.raises(TypeError, match="no counter"):
        ENCODER_ESTIMATES.counter(bytes(8))


def test_drive_frames_byte_for_byte() -> None:
    """Bytes worked out by hand from ODrive's CANSimple 0.6 table."""
    heartbeat = DriveHeartbeat(
        AxisError.WATCHDOG_TIMER_EXPIRED | AxisError.ESTOP_REQUESTED, AxisState.IDLE, 3, 1
    )
    assert encode(heartbeat) == Frame(0x01, bytes.fromhex("00000003 01 03 01 00"))
    assert encode(DriveEstop()) == Frame(0x02, b"")
    assert encode(SetInputTorque(0.5)) == Frame(0x0E, bytes.fromhex("0000003f 00000000"))
    assert encode(EncoderEstimates(0.25, -2.0)) == Frame(0x09, bytes.fromhex("0000803e 000000c0"))
    # what ODrive does not use, it need not clear
    assert DRIVE_HEARTBEAT.decode(bytes.fromhex("00000003 01 03 ff ff")) == heartbeat


def test_enumeration_members_are_sent_as_their_values() -> None:
    assert encode(FirmwareHeartbeat(Mode.RUN, 0, 0, 0.0, 0)) == encode(FirmwareHeartbeat(3, 0, 0, 0.0, 0))
