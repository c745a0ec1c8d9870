"""Frame lengths on the wire, against published frames, an independent checksum and a slow transmitter."""

import pytest
from crccheck.crc import Crc15Can  # type: ignore[import-untyped]  # it carries no types
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.interface.frame import Frame, word_of, worst_case_bits
from hil.bus.model.bits import checksum, frame_bits

frames = st.builds(
    Frame,
    st.integers(0, 0x7FF),
    st.binary(max_size=8) | st.text("0\x1e\x87\xff\x0f", max_size=8).map(lambda text: text.encode("latin-1")),
)


def body_of(frame: Frame) -> str:
    """Start bit to data as the standard lists them: identifier, RTR, IDE, r0, length code, bytes."""
    data = "".join(f"{byte:08b}" for byte in frame.data)
    return f"0{frame.can_id:011b}000{len(frame.data):04b}{data}"


def checksum_of(frame: Frame) -> int:
    return checksum(frame.can_id, len(frame.data), word_of(frame.data))


@pytest.mark.parametrize(
    ("frame", "wanted"),
    [
        # as sigrok's CAN decoder reads them off a wire
        (Frame(0x123, bytes.fromhex("dead")), 0x0B6E),
        (Frame(0x555, bytes.fromhex("00ff55aa01807ffe")), 0x7480),
        (Frame(0x000, b""), 0x0000),
    ],
)
def test_checksums_of_published_frames(frame: Frame, wanted: int) -> None:
    assert checksum_of(frame) == wanted


def test_a_frame_by_hand() -> None:
    # identifier 0 without data: 34 dominant bits, checksum included, with a recessive one after every five
    assert frame_bits(Frame(0, b"")) == 34 + 6 + 13


@given(frame=frames)
def test_the_checksum_agrees_with_an_independent_implementation(frame: Frame) -> None:
    # leading zeros do not change a checksum whose register starts at zero
    assert checksum_of(frame) == Crc15Can.calc(int(body_of(frame), 2).to_bytes(16, "big"))


@given(frame=frames)
def test_the_length_is_that_of_a_transmitter_that_stuffs_bit_by_bit(frame: Frame) -> None:
    wire = ""
    for bit in body_of(frame) + f"{checksum_of(frame):015b}":
        wire += bit
        if wire[-5:] in ("00000", "11111"):
            wire += "1" if bit == "0" else "0"
    assert frame_bits(frame) == len(wire) + 13
    assert 47 + 8 * len(frame.data) <= frame_bits(frame) < worst_case_bits(len(frame.data))


@pytest.mark.parametrize("frame", [Frame(0x800, b""), Frame(-1, b""), Frame(0x100, bytes(9))])
def test_no_classic_frame(frame: Frame) -> None:
    with pytest.raises(ValueError, match="no classic CAN frame"):
        frame_bits(frame)
