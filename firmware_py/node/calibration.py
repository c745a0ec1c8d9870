"""Calibration between two ticks: judges the writes that the XCP slave has received.

    calibrate(pool, config, mode) -> config

A write of one characteristic is staged if the parameter may be written now and its value is within bounds. A
write of 1 to `COMMIT` applies all staged values together, if they fit together.
"""

import math
import struct
from typing import Any

from firmware_py.core.config import Config, commit
from firmware_py.core.conflicts import Conflict, conflict_of
from firmware_py.interface.enums import Mode, XcpError
from firmware_py.interface.float32 import float32_bits, float32_of
from firmware_py.interface.generated.parameters import Parameters
from firmware_py.interface.modes import MODES
from firmware_py.interface.parameter_table import INDEX, TABLE
from firmware_py.node.xcp import (
    ADDRESS,
    COMMIT,
    COUNT,
    ELEMENT_BYTES,
    NO_REQUEST,
    PAGE_AT,
    REQUEST,
    REVERT,
    VALUE,
    refuse,
)

NEVER, AT_REST, ALWAYS = range(3)
"""When a parameter may be written."""

# Bytes take the least flash.
RIGHTS = bytes(NEVER if not one.is_calibrated else ALWAYS if one.while_running else AT_REST for one in TABLE)
LOWS = struct.pack(f"<{COUNT}f", *(one.low for one in TABLE))
HIGHS = struct.pack(f"<{COUNT}f", *(one.high for one in TABLE))
WHOLES = bytes(one.whole for one in TABLE)
"""Whether a parameter is a count."""
CEILINGS = bytes(INDEX[one.at_most or one.name] for one in TABLE)
"""The parameter that each may not exceed; itself if there is none."""
PATHS = tuple(
    (k, j) for k, table in enumerate(Parameters.__annotations__.values()) for j in range(len(table._fields))
)
"""Indices of each parameter's table and of its member."""


def float32_in(table: bytes, index: int) -> float:
    """The float32 at this index of a table."""
    at = ELEMENT_BYTES * index
    return float32_of(table[at] | table[at + 1] << 8 | table[at + 2] << 16 | table[at + 3] << 24)


def bits_in_use(config: Config, index: int) -> int:
    """The bits of a parameter as float32; in C it is read at its address."""
    table, member = PATHS[index]
    return float32_bits(config.p[table][member])


def with_page(config: Config, pool: list[int]) -> Parameters:
    """The parameters in use with those staged values that differ."""
    rows = [list(table) for table in config.p]
    for index, (table, member) in enumerate(PATHS):
        if pool[PAGE_AT + index] != bits_in_use(config, index):
            value = float32_of(pool[PAGE_AT + index])
            rows[table][member] = int(value) if WHOLES[index] else value
    kinds: Any = Parameters.__annotations__.values()
    return Parameters._make(kind._make(row) for kind, row in zip(kinds, rows, strict=True))


def is_writable(index: int, mode: Mode) -> bool:
    """Whether a parameter may be written in this mode."""
    return RIGHTS[index] == ALWAYS or (RIGHTS[index] == AT_REST and MODES[mode.value].calibrates)


def stage(pool: list[int], index: int, bits: int, mode: Mode) -> XcpError:
    """Stage one value; NONE, or the reason for which it is refused."""
    if not is_writable(index, mode):
        return XcpError.WRITE_PROTECTED
    value = float32_of(bits)
    is_within = float32_in(LOWS, index) <= value <= float32_in(HIGHS, index)
    if not is_within or (WHOLES[index] and value != math.floor(value)):
        return XcpError.OUT_OF_RANGE
    pool[PAGE_AT + index] = bits
    return XcpError.NONE


def find_commit_error(pool: list[int], config: Config, mode: Mode) -> XcpError:
    """Why the staged values cannot be applied together now."""
    for index in range(COUNT):
        bits = pool[PAGE_AT + index]
        if bits != bits_in_use(config, index) and not is_writable(index, mode):
            return XcpError.WRITE_PROTECTED
        if float32_of(bits) > float32_of(pool[PAGE_AT + CEILINGS[index]]):
            return XcpError.OUT_OF_RANGE
    has_conflict = pool[VALUE] != 1 or conflict_of(with_page(config, pool)) != Conflict.NONE
    return XcpError.OUT_OF_RANGE if has_conflict else XcpError.NONE


def calibrate(pool: list[int], config: Config, mode: Mode) -> Config:
    """Process the request that waits in `pool`, and complete its response; returns the config in use."""
    request, index = pool[REQUEST], pool[ADDRESS] // ELEMENT_BYTES
    pool[REQUEST] = NO_REQUEST
    if request == NO_REQUEST:
        return config
    if request == REVERT:
        for one in range(COUNT):
            pool[PAGE_AT + one] = bits_in_use(config, one)
        return config
    is_commit = index == COMMIT
    error = find_commit_error(pool, config, mode) if is_commit else stage(pool, index, pool[VALUE], mode)
    if error != XcpError.NONE:
        refuse(pool, error)
        return config
    pool[ADDRESS] += ELEMENT_BYTES
    return commit(config, with_page(config, pool)) if is_commit else config
