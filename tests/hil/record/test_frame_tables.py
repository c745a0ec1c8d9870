"""Frames in rows, and the quick look that finds those that cannot be decoded."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.interface.codec import CODECS, FrameCodec
from hil.record.candump import bus_log
from hil.record.frame_tables import FREQUENT, decoded, surely_valid

FREQUENT_CODECS = [codec for record, codec in CODECS.items() if record.__name__ in FREQUENT]


def error_of(codec: FrameCodec, data: bytes) -> str | None:
    try:
        codec.decode(data)
    except ValueError as error:
        return f"0x{codec.can_id:03X}: {error}"
    return None


@pytest.mark.parametrize("codec", FREQUENT_CODECS, ids=lambda codec: codec.record.__name__)
@given(content=st.binary(min_size=8, max_size=8), counter=st.integers(0, 255))
def test_what_is_surely_valid_can_be_decoded_and_what_was_sent_is(codec, content, counter):
    data = np.frombuffer(content, np.uint8)[None]
    assert bool(surely_valid(codec, data)[0]) == (error_of(codec, content) is None)
    numbers = np.frombuffer(content, np.int16)[: len(codec.record._fields)].tolist()
    sent = codec.encode(codec.record._make(map(float, numbers)), counter).data
    assert surely_valid(codec, np.frombuffer(sent, np.uint8)[None])[0]


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
