"""What a firmware in flat memory keeps: its state, the memory of XCP, and the inbox."""

import zlib
from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

from firmware_py.interface.float32 import float32_bits
from firmware_py.interface.parameter_table import TABLE
from firmware_py.node import inbox, xcp
from firmware_py.node.elements import ALL
from firmware_py.node.tick import INITIAL as INITIAL_NODE
from firmware_py.node.tick import NodeState

if TYPE_CHECKING:
    Pool = tuple[int, ...]
    Inbox = tuple[int, ...]
else:
    Pool = tuple.__class_getitem__((int,) * xcp.POOL)
    Inbox = tuple.__class_getitem__((int,) * inbox.SIZE)


class FirmwareState(NamedTuple):
    """The firmware's state, and behind it the memory of measurement and calibration (XCP), and the inbox."""

    node: NodeState
    pool: Pool
    inbox: Inbox


def file_name() -> str:
    """The name of the A2L file that fits this firmware: a checksum of the names of all elements."""
    measurements = (f"{one.name} {one.kind.__name__}" for one in ALL)
    content = "\n".join((*measurements, *(parameter.name for parameter in TABLE)))
    return f"vibro_{zlib.crc32(content.encode()):08x}"


def pool_of(values: Iterable[float]) -> list[int]:
    """A pool without a session whose staged characteristics are `values`, in the order of their indices."""
    pool = [0] * xcp.POOL
    text = f"tick{file_name()}".encode().ljust(xcp.TEXT_WORDS * xcp.ELEMENT_BYTES, b"\0")
    pool[xcp.ENDS] = pool[xcp.WAKES] = xcp.NEVER
    for index in range(xcp.TEXT_WORDS):
        pool[xcp.TEXT_AT + index] = int.from_bytes(text[4 * index : 4 * index + 4], "little")
    pool[xcp.PAGE_AT :] = map(float32_bits, values)
    return pool


INITIAL = FirmwareState(
    INITIAL_NODE, tuple(pool_of([parameter.default for parameter in TABLE])), (0,) * inbox.SIZE
)
