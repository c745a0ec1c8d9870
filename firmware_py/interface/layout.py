"""A frame's layout as plain numbers: positions, scales and ranges of its signals."""

import math
import tomllib
from enum import Enum
from importlib.resources import files
from typing import Any, NamedTuple


class SignalKind(Enum):
    """Treatment of a signal's value; the DBC's attribute `SignalKind`."""

    QUANTITY = "Quantity"  # scaled, and saturates at its range
    ENUMERATION = "Enumeration"  # one of the listed values
    FLAGS = "Flags"  # any combination of bits
    EXACT = "Exact"  # a whole number that must not be saturated
    COUNTER = "Counter"
    CRC = "Crc"


class Signal(NamedTuple):
    """One signal. Its physical value is `counts`·`scale`; the counts of a float are the value itself.

    `start` is the signal's lowest bit in the frame's 64-bit word, `bits` its width.
    """

    name: str
    kind: SignalKind
    unit: str
    is_float: bool
    is_signed: bool
    start: int
    bits: int
    scale: float
    low_counts: int
    high_counts: int
    values: frozenset[int]

    @property
    def is_real(self) -> bool:
        """Whether the physical value is a float; otherwise it is a whole number, sent unchanged."""
        return self.is_float or self.scale != 1

    @property
    def low(self) -> float:
        """Smallest value in the signal's unit, the decoded value of a reading clipped at the bottom."""
        return -math.inf if self.is_float else self.low_counts * self.scale

    @property
    def high(self) -> float:
        """Largest value in the signal's unit, the decoded value of a reading clipped at the top."""
        return math.inf if self.is_float else self.high_counts * self.scale


class Layout(NamedTuple):
    """A message: identity, timing, and its signals by name, without counter and CRC."""

    name: str
    can_id: int
    length: int
    sender: str | None
    receivers: tuple[str, ...]
    period_s: float | None
    counter_bits: int  # 0: neither counter nor CRC
    signals: dict[str, Signal]

    @property
    def protected(self) -> bool:
        """Whether the frame carries a rolling counter and a CRC-8."""
        return self.counter_bits > 0


def span(is_signed: bool, bits: int) -> tuple[int, int]:
    """Smallest and largest counts that this number of bits can hold."""
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if is_signed else (0, (1 << bits) - 1)


def snake(name: str) -> str:
    """`SetInputTorque` as `set_input_torque`."""
    return "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name).lstrip("_")


def read_layouts() -> dict[str, Layout]:
    """The layout of every frame by its name, generated from `vibro.dbc` by `sources.generate`."""
    text = files("firmware_py.interface.generated").joinpath("layouts.toml").read_text(encoding="utf-8")
    return {name: _layout(name, table) for name, table in tomllib.loads(text).items()}


def _layout(name: str, table: dict[str, Any]) -> Layout:
    signals = {signal: _signal(signal, fields) for signal, fields in table.get("signals", {}).items()}
    return Layout(
        **{
            "name": name,
            "sender": None,
            "period_s": None,
            **table,
            "receivers": tuple(table["receivers"]),
            "signals": signals,
        }
    )


def _signal(name: str, fields: dict[str, Any]) -> Signal:
    kind, values = SignalKind(fields["kind"]), frozenset(fields["values"])
    return Signal(**{**fields, "name": name, "kind": kind, "values": values})
