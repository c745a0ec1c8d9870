"""CRC-8 SAE J1850: polynomial 0x1D, initial value and final XOR 0xFF, not reflected.

The polynomial is primitive, of period 255. The CRC of a frame covers at most 64 bits (the identifier's low
byte and seven of data), so it detects every one- and two-bit error and every burst of up to eight bits
(Peterson and Brown, "Cyclic Codes for Error Detection", 1961). Published check value: 0x4B for the ASCII
digits 1 to 9.
"""

POLYNOMIAL = 0x1D
INITIAL = 0xFF
FINAL_XOR = 0xFF


def _shifted_out(byte: int) -> int:
    """Remainder of `byte`·x⁸ divided by the polynomial."""
    remainder = byte
    for _ in range(8):
        carry = remainder & 0x80
        remainder = (remainder << 1) & 0xFF
        if carry:
            remainder ^= POLYNOMIAL
    return remainder


TABLE = bytes(_shifted_out(byte) for byte in range(256))


def crc8(data: bytes, register: int = INITIAL) -> int:
    """Return the checksum of `data`; `register` continues the checksum of earlier bytes.

    >>> hex(crc8(b"123456789"))
    '0x4b'
    """
    for byte in data:
        register = TABLE[register ^ byte]
    return register ^ FINAL_XOR


def frame_crc8(can_id: int, body: bytes) -> int:
    """Return the checksum of a frame: the low byte of its identifier, then its data without the CRC byte.

    The identifier is included so that a frame received under a wrong identifier is detected.
    """
    return crc8(body, TABLE[INITIAL ^ (can_id & 0xFF)])
