"""IEEE 754 binary32, the number format of the drive's frames; compiled builds use machine instructions."""

import struct

FLOAT32_MAX = 3.4028234663852886e38
"""The largest finite value."""

FLOAT32_OVERFLOW = 3.4028235677973366e38
"""Smallest value that rounds to infinity."""

_FLOAT = struct.Struct("<f")
_WORD = struct.Struct("<I")


def float32_bits(value: float) -> int:
    """The 32 bits, 0 ≤ bits < 2³², of the float32 nearest to `value`; |value| < `FLOAT32_OVERFLOW`.

    >>> hex(float32_bits(0.5))
    '0x3f000000'
    """
    bits: int = _WORD.unpack(_FLOAT.pack(value))[0]
    return bits


def float32_of(bits: int) -> float:
    """The value of 32 bits, 0 ≤ bits < 2³²; NaN and the infinities included.

    >>> float32_of(0x3F000000)
    0.5
    """
    value: float = _FLOAT.unpack(_WORD.pack(bits))[0]
    return value
