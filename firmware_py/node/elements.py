"""The measurements of XCP: the members of the firmware's state, numbered in the order of the C struct."""

from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

from firmware_py.interface.float32 import FLOAT32_OVERFLOW, float32_bits
from firmware_py.node.tick import NodeState

FLOAT32_INFINITY = 0x7F800000


class Element(NamedTuple):
    """One measurement: its name with dots and indices, its type, and the path of indices to it."""

    name: str
    kind: type
    path: tuple[int, ...]


def members_of(kind: Any) -> dict[str, Any]:
    """The types within a record by their names, or within a tuple by their indices; else none."""
    if get_origin(kind) is tuple:
        return {str(index): item for index, item in enumerate(get_args(kind))}
    return get_type_hints(kind) if hasattr(kind, "_fields") else {}


def elements_of(kind: Any, name: str, path: tuple[int, ...]) -> list[Element]:
    """The numbers, enums and truth values within a record or one of its members, in the order of memory."""
    found: list[Element] = []
    for index, (member, item) in enumerate(members_of(kind).items()):
        found += elements_of(item, f"{name}.{member}" if name else member, (*path, index))
    return found or [Element(name, kind, path)]


ALL = tuple(
    element._replace(name=element.name.replace("core.", "state.", 1))
    if element.name.startswith("core.")
    else element
    for element in elements_of(NodeState, "", ())
)
"""All measurements, named as in a run's log; a measurement's address is four times its index."""

INDEX = {element.name: index for index, element in enumerate(ALL)}


def word_at(memory: Any, index: int) -> int:
    """The 32 bits of a measurement: float32, rounded once, or the lowest bits of an integer.

    `memory` is a `NodeState`; a compiled build reads the same member at the state's address.
    """
    element = ALL[index]
    for member in element.path:
        memory = memory[member]
    if element.kind is not float:
        return int(memory) & 0xFFFFFFFF
    if not abs(memory) >= FLOAT32_OVERFLOW:  # NaN is no overflow
        return float32_bits(memory)
    return FLOAT32_INFINITY if memory > 0.0 else FLOAT32_INFINITY | 1 << 31


def latch(memory: Any, pool: list[int], source: int, target: int, count: int) -> None:
    """Copy measurements: `pool[target + k]` becomes number `pool[source + k]`, for k < `count`."""
    for index in range(count):
        pool[target + index] = word_at(memory, pool[source + index])
