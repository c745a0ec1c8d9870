"""The checksum against published vectors, and what it must find in a frame."""

import pytest
from crccheck.crc import Crc8SaeJ1850  # type: ignore[import-untyped]  # it carries no types
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.interface.crc import crc8, frame_crc8


@pytest.mark.parametrize(
    ("data", "checksum"),
    [
        # the catalogue's check value, then AUTOSAR's examples (Specification of CRC Routines, CRC8 profile)
        (b"123456789", 0x4B),
        (bytes.fromhex("00000000"), 0x59),
        (bytes.fromhex("F20183"), 0x37),
        (bytes.fromhex("0FAA0055"), 0x79),
        (bytes.fromhex("00FF5511"), 0xB8),
        (bytes.fromhex("332255AABBCCDDEEFF"), 0xCB),
        (bytes.fromhex("926B55"), 0x8C),
        (bytes.fromhex("FFFFFFFF"), 0x74),
    ],
)
def test_published_vectors(data: bytes, checksum: int) -> None:
    assert crc8(data) == checksum


@given(data=st.binary(max_size=64))
def test_agrees_with_an_independent_implementation(data: bytes) -> None:
    assert crc8(data) == Crc8SaeJ1850.calc(data)


@given(can_id=st.integers(0, 0x7FF), body=st.binary(max_size=7))
def test_a_frames_checksum_covers_the_identifiers_low_byte(can_id: int, body: bytes) -> None:
    assert frame_crc8(can_id, body) == Crc8SaeJ1850.calc(bytes([can_id & 0xFF]) + body)
