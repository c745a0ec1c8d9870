"""Random damage: to bytes of any file, to values of tables; and implausible values."""

import math
from typing import Any

import numpy as np

Random = np.random.Generator

NASTY: tuple[Any, ...] = (
    *(1e308, -1e308, 1e-308, 5e-324, math.nan, math.inf, -math.inf, 0, -1, 0.0, -0.0, 1e16, 1e-16, 3.5),
    *(10**18, -(2**63), True, "", "x" * 5000, "\u0000", "nan", [], [[]], {}, {"a": {"b": 1}}, [1, "x"]),
)
RAW_VALUES = (
    "9" * 400,
    "9" * 5000,
    "0x" + "f" * 4000,
    "[" * 5000,
    "{a=" * 2000,
    "1e400",
    "'",
    "2026-01-01",
    "",
)
"""Values for --set, valid TOML or not."""
SCALED_SHARE = 0.75
"""Share of changed numbers that remain plausible numbers, so that more inputs pass the first checks."""
LARGEST_SCALING = 2.5
"""Largest factor on a changed number, as a power of ten."""


def damaged_bytes(random: Random, content: bytes) -> bytes:
    """Return the content with damage.

    Bits are inverted, a piece is removed, repeated or replaced, the end is cut off, or all content is random.
    """
    size = len(content)
    first, last = sorted(int(place) for place in random.integers(0, size + 1, 2))
    before, within, after = content[:first], content[first:last], content[last:]
    damaged = (
        before,
        before + after,
        before + 2 * within + after,
        before + random.bytes(last - first) + after,
    )
    choice = int(random.integers(0, 8))
    if choice < len(damaged):
        return damaged[choice]
    if choice == len(damaged) or not content:
        return random.bytes(int(random.integers(0, 1000)))
    turned = bytearray(content)
    head = min(size, 300) if random.random() < 0.5 else size
    for place in random.integers(0, head, int(random.integers(1, 20))).tolist():
        turned[place] ^= 1 << int(random.integers(0, 8))
    return bytes(turned)


def damaged_tables(random: Random, tables: dict[str, Any]) -> dict[str, Any]:
    """Replace, rename or remove one to three values of the tables, mostly one, at any depth."""
    for _ in range(int(random.choice((1, 1, 1, 2, 3)))):
        table, path = tables, []
        while True:
            key = str(random.choice(sorted(table)))
            path.append(key)
            inner = table[key]
            if not isinstance(inner, dict) or not inner or random.random() < 0.1:
                break
            table = inner
        match int(random.integers(0, 10)):
            case 0 if not isinstance(table[key], dict):
                del table[key]
            case 1:
                table[key + "x"] = table.pop(key)
            case _:
                table[key] = other_value(random, table[key])
        if not table:
            break
    return tables


def other_value(random: Random, value: Any) -> Any:
    """Return a number of another magnitude, or a value of NASTY."""
    if type(value) in (int, float) and random.random() < SCALED_SHARE:
        scaled = value * 10.0 ** random.uniform(-LARGEST_SCALING, LARGEST_SCALING)
        return type(value)(-scaled if random.random() < 0.1 else scaled)
    return NASTY[int(random.integers(0, len(NASTY)))]
