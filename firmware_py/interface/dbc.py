"""`vibro.dbc`, read by cantools: the only source of identifiers, scaling, units, ranges and periods.

For the bench and for `generate.py`; the firmware runs what is generated. A frame keeps these rules, so that
its codec is simple: little-endian; no offsets; a protected frame ends in its rolling counter and, as its last
byte, its CRC.
"""

import math
from enum import Enum
from functools import cache
from importlib.resources import files
from typing import NamedTuple, cast

import cantools.database
from cantools.database.can import Database, Message
from cantools.database.can import Signal as DbcSignal

ALL_NODES = ("Drive", "Firmware", "Operator", "Recorder")
"""Receivers of a frame without signals; a DBC names receivers only for signals."""


class LayoutError(ValueError):
    """`vibro.dbc` breaks a rule of the codec."""


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
    comment: str
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
    """A message: identity, timing, and its signals by name, without counter and CRC.

    `sender` is None for any client of the drive, `period_s` for a frame sent on an event. `counter_bits` is 0
    for a frame with neither counter nor CRC.
    """

    name: str
    comment: str
    can_id: int
    length: int
    sender: str | None
    receivers: tuple[str, ...]
    period_s: float | None
    counter_bits: int
    signals: dict[str, Signal]

    @property
    def protected(self) -> bool:
        """Whether the frame carries a rolling counter and a CRC-8."""
        return self.counter_bits > 0


@cache
def database() -> Database:
    """Read the bus description; once per process."""
    text = files("firmware_py.interface").joinpath("vibro.dbc").read_text(encoding="ascii")
    return cast(Database, cantools.database.load_string(text, database_format="dbc"))


@cache
def layouts() -> dict[str, Layout]:
    """The layout of every frame by its name, in the order of the identifiers."""
    return {
        one.name: layout_of(one) for one in sorted(database().messages, key=lambda message: message.frame_id)
    }


def layout_of(message: Message) -> Layout:
    """Convert a DBC message into a layout; raise `LayoutError` if it breaks a rule of the codec."""
    signals = [signal_of(message, dbc) for dbc in sorted(message.signals, key=lambda dbc: dbc.start)]
    protection = {signal.kind: signal for signal in signals if signal.kind in PROTECTING}
    return Layout(
        name=message.name,
        comment=message.comment or "",
        can_id=message.frame_id,
        length=message.length,
        sender=message.senders[0] if message.senders else None,
        receivers=tuple(sorted(message.receivers)) or ALL_NODES,
        period_s=None if message.cycle_time is None else message.cycle_time / 1000,
        counter_bits=counter_bits_of(message, protection) if protection else 0,
        signals={signal.name: signal for signal in signals if signal.kind not in PROTECTING},
    )


PROTECTING = (SignalKind.COUNTER, SignalKind.CRC)


def span(is_signed: bool, bits: int) -> tuple[int, int]:
    """Smallest and largest counts that this number of bits can hold."""
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if is_signed else (0, (1 << bits) - 1)


def signal_of(message: Message, dbc: DbcSignal) -> Signal:
    """One signal of a message."""
    where = f"{message.name}.{dbc.name}"
    if dbc.byte_order != "little_endian":
        raise LayoutError(f"{where}: byte order {dbc.byte_order}; wanted little_endian (@1)")
    if dbc.offset != 0:
        raise LayoutError(f"{where}: offset {dbc.offset}; wanted 0")
    attribute = None if dbc.dbc is None else dbc.dbc.attributes.get("SignalKind")
    kind = SignalKind.QUANTITY
    if attribute is not None:
        kind = SignalKind(attribute.definition.choices[int(attribute.value)])
    values = frozenset(int(value) for value in dbc.choices or ()) if kind is SignalKind.ENUMERATION else None
    if values is not None and not values:
        raise LayoutError(f"{where}: an enumeration without values; list them in VAL_")
    low_counts = high_counts = 0
    if dbc.is_float:
        if dbc.length != 32:
            raise LayoutError(f"{where}: a float of {dbc.length} bits; wanted 32")
    else:
        low_counts, high_counts = range_of(where, dbc)
    return Signal(
        name=dbc.name,
        kind=kind,
        unit=dbc.unit or "",
        comment=dbc.comment or "",
        is_float=dbc.is_float,
        is_signed=dbc.is_signed,
        start=dbc.start,
        bits=dbc.length,
        scale=1 if dbc.is_float else dbc.scale,
        low_counts=low_counts,
        high_counts=high_counts,
        values=values or frozenset(),
    )


def value_table(signal: str) -> dict[int, str]:
    """The values that the first signal of this name lists, and their names."""
    found = (one for message in database().messages for one in message.signals if one.name == signal)
    choices = next(one.choices for one in found if one.choices)
    return {value: str(name) for value, name in sorted(choices.items())}


def range_of(where: str, dbc: DbcSignal) -> tuple[int, int]:
    """Smallest and largest counts of the DBC's range."""
    if dbc.minimum is None or dbc.maximum is None:
        raise LayoutError(f"{where}: no range; give [minimum|maximum]")
    low_counts, high_counts = round(dbc.minimum / dbc.scale), round(dbc.maximum / dbc.scale)
    lowest, highest = span(dbc.is_signed, dbc.length)
    if low_counts < lowest or high_counts > highest:
        raise LayoutError(f"{where}: range [{dbc.minimum}|{dbc.maximum}] does not fit {dbc.length} bits")
    return low_counts, high_counts


def counter_bits_of(message: Message, protection: dict[SignalKind, Signal]) -> int:
    """Width of the counter, which must end directly below the CRC, the last byte."""
    last_byte = 8 * (message.length - 1)
    bits = {kind: (one.start, one.start + one.bits) for kind, one in protection.items()}
    if bits.get(SignalKind.CRC) != (last_byte, last_byte + 8):
        raise LayoutError(f"{message.name}: Crc at bits {bits.get(SignalKind.CRC)}; wanted the last byte")
    start, end = bits.get(SignalKind.COUNTER, (0, 0))
    if end != last_byte:
        raise LayoutError(
            f"{message.name}: Counter at bits {start} to {end}; wanted it to end at {last_byte}"
        )
    return end - start
