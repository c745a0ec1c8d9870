"""The checksum against published vectors and an independent implementation."""

import pytest
from crccheck.crc import Crc8SaeJ1850  # type: ignore[import-untyped]  # it carries no types
from hypothesis import given
from hypothesis import strategies as st

from firmware_py.interface.framing import CRC_FINAL_XOR, CRC_INITIAL, FrameKind, checksum


def crc8(data: bytes) -> int:
    """The checksum of any number of bytes, by that of frames with up to seven bytes before their CRC."""
    register = CRC_INITIAL
    for start in range(0, len(data), 7):
        part = data[start : start + 7]
        kind = FrameKind(0, len(part) + 1, 0.0, 4, register)
        register = checksum(kind, int.from_bytes(part, "little")) ^ CRC_FINAL_XOR
    return register ^ CRC_FINAL_XOR


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
