"""Frame lengths on the wire, against published frames, an independent checksum and complete searches."""

from functools import cache

import pytest
from crccheck.crc import Crc15Can  # type: ignore[import-untyped]  # it carries no types
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.interface.frame import Frame, worst_case_bits
from hil.can_model.bits import CRC_BITS, CRC_POLYNOMIAL, crc15, frame_bits, stuff_bits, unstuffed_bits

frames = st.builds(
    Frame,
    st.integers(0, 0x7FF),
    st.binary(max_size=8) | st.text("0\x1e\x87\xff\x0f", max_size=8).map(lambda text: text.encode("latin-1")),
)

LONGEST = {0: 53, 1: 62, 2: 72, 3: 83, 4: 93, 5: 102, 6: 113, 7: 124, 8: 133}


@pytest.mark.parametrize(
    ("bits", "checksum"),
    [
        # the CRC catalogue's check value of CRC-15/CAN, then the test vectors of CanOverhead
        ("".join(f"{byte:08b}" for byte in b"123456789"), 0x059E),
        ("0", 0),
        ("11110001", 0b110001011110110),
        ("100000110011", 0b000010001110100),
        ("11010011101100", 0b010001010101010),
    ],
)
def test_published_checksums(bits: str, checksum: int) -> None:
    assert crc15(bits) == checksum


@pytest.mark.parametrize(
    ("frame", "checksum"),
    [
        # as sigrok's CAN decoder reads them off a wire
        (Frame(0x123, bytes.fromhex("dead")), 0x0B6E),
        (Frame(0x555, bytes.fromhex("00ff55aa01807ffe")), 0x7480),
        (Frame(0x000, b""), 0x0000),
    ],
)
def test_checksums_of_published_frames(frame: Frame, checksum: int) -> None:
    assert int(unstuffed_bits(frame)[-CRC_BITS:], 2) == checksum


@pytest.mark.parametrize(
    ("bits", "wire"),
    [
        # the test vectors of CanOverhead
        ("", ""),
        ("1", "1"),
        ("1110101010", "1110101010"),
        ("11111", "111110"),
        ("111110000", "11111000001"),
        # the worst case for stuffing as Davis et al. 2007 show it: five bits, then four and four
        ("1111100001111000011110000", "1111100000111110000011111000001"),
    ],
)
def test_published_stuffing(bits: str, wire: str) -> None:
    assert stuff_bits(bits) == len(wire) - len(bits)


def test_a_frame_by_hand() -> None:
    # identifier 0 without data: 34 dominant bits, checksum included, with a recessive one after every five
    assert frame_bits(Frame(0, b"")) == 34 + 6 + 13


@given(frame=frames)
def test_the_checksum_agrees_with_an_independent_implementation(frame: Frame) -> None:
    body, checksum = unstuffed_bits(frame)[:-CRC_BITS], unstuffed_bits(frame)[-CRC_BITS:]
    # leading zeros do not change a checksum whose register starts at zero
    assert int(checksum, 2) == Crc15Can.calc(int(body, 2).to_bytes(16, "big"))


@given(frame=frames)
def test_the_bits_before_stuffing_read_back(frame: Frame) -> None:
    bits = unstuffed_bits(frame)
    assert int(bits[1:12], 2) == frame.can_id
    assert int(bits[15:19], 2) == len(frame.data)
    assert int("0" + bits[19:-CRC_BITS], 2) == int.from_bytes(frame.data, "big")


@given(frame=frames)
def test_the_length_is_that_of_a_transmitter_that_stuffs_bit_by_bit(frame: Frame) -> None:
    wire = ""
    for bit in unstuffed_bits(frame):
        wire += bit
        if wire[-5:] in ("00000", "11111"):
            wire += "1" if bit == "0" else "0"
    assert frame_bits(frame) == len(wire) + 13
    assert 47 + 8 * len(frame.data) <= frame_bits(frame) <= LONGEST[len(frame.data)]
    assert frame_bits(frame) < worst_case_bits(len(frame.data))


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x000, b""),
        Frame(0x010, bytes.fromhex("ee")),
        Frame(0x000, bytes.fromhex("7c3c")),
        Frame(0x03F, bytes.fromhex("fe1078")),
        Frame(0x03E, bytes.fromhex("107803fe")),
        Frame(0x000, bytes.fromhex("7fef87c1e1")),
        Frame(0x03E, bytes.fromhex("0f0078787c1e")),
        Frame(0x01F, bytes.fromhex("8787c1e1e1e1e1")),
        Frame(0x000, bytes.fromhex("01e1e1e1e1e1e1e1")),
    ],
)
def test_the_longest_frames(frame: Frame) -> None:
    assert frame_bits(frame) == LONGEST[len(frame.data)]


@pytest.mark.parametrize("length", range(9))
def test_no_frame_is_longer(length: int) -> None:
    """Complete: every identifier and data that could still beat the longest frame is followed to its end."""
    wanted = LONGEST[length] - 47 - 8 * length + 1
    body, total = 19 + 8 * length, 34 + 8 * length
    fixed = {0: 0, 12: 0, 13: 0, 14: 0} | {15 + bit: length >> 3 - bit & 1 for bit in range(4)}

    def after(run_bit: int, run: int, bit: int) -> tuple[int, int, int]:
        run = run + 1 if bit == run_bit else 1
        return (1 - bit, 1, 1) if run == 5 else (bit, run, 0)

    def crc_after(register: int, bit: int) -> int:
        return (register << 1 ^ (CRC_POLYNOMIAL if register >> 14 ^ bit else 0)) & 0x7FFF

    def choices(position: int) -> tuple[int, ...]:
        return (fixed[position],) if position in fixed else (0, 1)

    @cache
    def most(position: int, run_bit: int, run: int) -> int:
        """Stuff bits still to come at most, whatever the checksum."""
        if position == total:
            return 0
        steps = (after(run_bit, run, bit) for bit in choices(position))
        return max(
            inserted + most(position + 1, next_bit, next_run) for next_bit, next_run, inserted in steps
        )

    def longer_exists(position: int, run_bit: int, run: int, inserted: int, register: int) -> bool:
        if inserted + most(position, run_bit, run) < wanted:
            return False
        if position == total:
            return True
        if position >= body:
            steps: tuple[int, ...] = (register >> total - 1 - position & 1,)
        else:
            steps = choices(position)
        for bit in steps:
            next_bit, next_run, more = after(run_bit, run, bit)
            next_register = crc_after(register, bit) if position < body else register
            if longer_exists(position + 1, next_bit, next_run, inserted + more, next_register):
                return True
        return False

    assert not longer_exists(0, -1, 0, 0, 0)


@pytest.mark.parametrize("frame", [Frame(0x800, b""), Frame(-1, b""), Frame(0x100, bytes(9))])
def test_no_classic_frame(frame: Frame) -> None:
    with pytest.raises(ValueError, match="no classic CAN frame"):
        frame_bits(frame)
