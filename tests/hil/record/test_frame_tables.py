"""Frames in rows, and the quick look that finds those that cannot be decoded."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.interface.codec import CODECS, FrameCodec
from hil.record.candump import bus_log
from hil.record.frame_tables import FREQUENT, decoded, refuse_other_lengths, surely_valid

FREQUENT_CODECS = [codec for record, codec in CODECS.items() if record.__name__ in FREQUENT]


def error_of(codec: FrameCodec, data: bytes) -> str | None:
    try:
        codec.decode(data)
    except ValueError as error:
        return f"0x{codec.can_id:03X}: {error}"
    return None


def is_surely_valid(codec: FrameCodec, data: bytes) -> bool:
    return bool(surely_valid(codec, np.frombuffer(data.ljust(8, b"\0"), np.uint8)[None])[0])


@pytest.mark.parametrize("codec", FREQUENT_CODECS, ids=lambda codec: codec.record.__name__)
@given(content=st.binary(min_size=8, max_size=8), counter=st.integers(0, 255))
def test_what_is_surely_valid_can_be_decoded_and_what_was_sent_is(codec, content, counter):
    received = content[: codec.length]
    assert is_surely_valid(codec, received) == (error_of(codec, received) is None)
    kinds = codec.record.__annotations__.values()
    numbers = np.frombuffer(content, np.int16)[: len(kinds)].tolist()
    values = [
        abs(number) % 2 if kind is int else float(number) for kind, number in zip(kinds, numbers, strict=True)
    ]
    assert is_surely_valid(codec, codec.encode(codec.record._make(values), counter).data)


@given(
    frames=st.lists(
        st.tuples(st.sampled_from([codec.can_id for codec in FREQUENT_CODECS]), st.binary(max_size=8)),
        min_size=1,
        max_size=30,
    )
)
def test_frames_that_are_not_decoded_are_refused_as_others_are(frames):
    bus = bus_log(
        1e-3 * np.arange(len(frames)),
        np.array([can_id for can_id, _ in frames]),
        [data for _, data in frames],
    )
    assert decoded(bus, FREQUENT).refused == decoded(bus).refused
    assert not decoded(bus, FREQUENT).by_name


@pytest.mark.parametrize("lengths", [[2**30] * 100, [8, -(2**40), 2**40, -5], [3, 1], [2], [-1, 4]])
def test_lengths_that_are_not_those_of_the_bytes_are_refused_before_arrow_reads_by_them(lengths):
    refuse_other_lengths(np.array([1, 2]), 3)
    with pytest.raises(ValueError, match="not those of their 3 bytes"):
        refuse_other_lengths(np.array(lengths, np.int64), 3)
