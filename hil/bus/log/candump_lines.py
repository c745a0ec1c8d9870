"""Lines of candump, `(seconds.micros) can0 ID#DATA`, of frames in rows: the text of can.log."""

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels import jit, subroutine

LINE_BYTES = 48
"""Upper bound on the length of a line."""
Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]


@subroutine
def hexadecimal(value: int) -> int:
    """The character code of a hexadecimal digit."""
    return 48 + value if value < 10 else 55 + value


@subroutine
def write_line(buffer: Bytes, start: int, t_us: int, can_id: int, length: int, word: int) -> int:
    """Write a line of can.log, `(seconds.micros) can0 ID#DATA`; returns the index after it."""
    seconds, micros = t_us // 1_000_000, t_us % 1_000_000
    buffer[start] = 40
    digits, rest = 1, seconds
    while rest >= 10:
        digits, rest = digits + 1, rest // 10
    for place in range(digits):
        buffer[start + digits - place] = 48 + seconds % 10
        seconds //= 10
    start += digits + 1
    buffer[start] = 46
    for place in range(6):
        buffer[start + 6 - place] = 48 + micros % 10
        micros //= 10
    start += 7
    for character in (41, 32, 99, 97, 110, 48, 32):  # ") can0 "
        buffer[start] = character
        start += 1
    for place in range(3):
        buffer[start + place] = hexadecimal(can_id >> (8 - 4 * place) & 15)
    buffer[start + 3] = 35
    start += 4
    for place in range(length):
        byte = word >> 8 * place & 255
        buffer[start] = hexadecimal(byte >> 4)
        buffer[start + 1] = hexadecimal(byte & 15)
        start += 2
    buffer[start] = 10
    return start + 1


@jit
def write_lines(rows: Integers, buffer: Bytes) -> int:
    """Write the line of each row; returns the length of the text."""
    end = 0
    for row in range(rows.shape[0]):
        end = write_line(buffer, end, rows[row, 0], rows[row, 1], rows[row, 2], rows[row, 3])
    return end


def lines_of(rows: Integers) -> bytes:
    """The lines of frames in rows of time in µs, identifier, length and word."""
    buffer = np.empty(len(rows) * LINE_BYTES, np.uint8)
    return buffer[: write_lines(rows, buffer)].tobytes()
