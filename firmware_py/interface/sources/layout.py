"""A frame's layout as plain numbers: what `vibro.dbc` says of a message, checked for the codec.

Rules that keep the codec simple, and that this module enforces: little-endian; no offsets; a protected frame
ends in its rolling counter and, as its last byte, its CRC.
"""

import math
from enum import Enum
from typing import NamedTuple

from cantools.database.can import Message
from cantools.database.can import Signal as DbcSignal


class LayoutError(ValueError):
    """`vibro.dbc` breaks a rule of the codec."""


class SignalKind(Enum):
    """How a signal's value is treated; the DBC's attribute `SignalKind`."""

    QUANTITY = "Quantity"  # scaled, and saturates at its range
    ENUMERATION = "Enumeration"  # one of the listed values
    FLAGS = "Flags"  # any combination of bits
    EXACT = "Exact"  # a whole number that saturating would falsify
    COUNTER = "Counter"
    CRC = "Crc"


class Signal(NamedTuple):
    """One signal. Its physical value is `counts`·`scale`; a float's counts are the value itself.

    `start` is its lowest bit in the frame's 64-bit word, `bits` its width.
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
    def low(self) -> float:
        """Smallest value in the signal's unit; what a reading clipped at the bottom decodes to."""
        return -math.inf if self.is_float else self.low_counts * self.scale

    @property
    def high(self) -> float:
        """Largest value in the signal's unit; what a reading clipped at the top decodes to."""
        return math.inf if self.is_float else self.high_counts * self.scale


class Layout(NamedTuple):
    """A message: identity, timing, and its signals by name, counter and CRC left out."""

    name: str
    can_id: int
    length: int
    sender: str | None
    period_s: float | None
    counter_bits: int  # 0: carries neither counter nor CRC
    signals: dict[str, Signal]

    @property
    def protected(self) -> bool:
        """Whether the frame carries a rolling counter and a CRC-8."""
        return self.counter_bits > 0


def layout_of(message: Message) -> Layout:
    """Turn a DBC message into a layout; raise `LayoutError` where it breaks a rule of the codec."""
    signals = [_signal(message, dbc) for dbc in sorted(message.signals, key=lambda dbc: dbc.start)]
    protection = {signal.kind: signal for signal in signals if signal.kind in _PROTECTING}
    return Layout(
        name=message.name,
        can_id=message.frame_id,
        length=message.length,
        sender=message.senders[0] if message.senders else None,
        period_s=None if message.cycle_time is None else message.cycle_time / 1000,
        counter_bits=_counter_bits(message, protection) if protection else 0,
        signals={signal.name: signal for signal in signals if signal.kind not in _PROTECTING},
    )


_PROTECTING = (SignalKind.COUNTER, SignalKind.CRC)


def _signal(message: Message, dbc: DbcSignal) -> Signal:
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
        low_counts, high_counts = _range(where, dbc)
    return Signal(
        name=dbc.name,
        kind=kind,
        unit=dbc.unit or "",
        is_float=dbc.is_float,
        is_signed=dbc.is_signed,
        start=dbc.start,
        bits=dbc.length,
        scale=1 if dbc.is_float else dbc.scale,
        low_counts=low_counts,
        high_counts=high_counts,
        values=values or frozenset(),
    )


def _range(where: str, dbc: DbcSignal) -> tuple[int, int]:
    """The DBC's range in counts."""
    if dbc.minimum is None or dbc.maximum is None:
        raise LayoutError(f"{where}: no range; give [minimum|maximum]")
    low_counts, high_counts = round(dbc.minimum / dbc.scale), round(dbc.maximum / dbc.scale)
    lowest, highest = span(dbc.is_signed, dbc.length)
    if low_counts < lowest or high_counts > highest:
        raise LayoutError(f"{where}: range [{dbc.minimum}|{dbc.maximum}] does not fit {dbc.length} bits")
    return low_counts, high_counts


def span(is_signed: bool, bits: int) -> tuple[int, int]:
    """Counts that this number of bits can hold."""
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if is_signed else (0, (1 << bits) - 1)


def _counter_bits(message: Message, protection: dict[SignalKind, Signal]) -> int:
    """Width of the counter; it ends where the CRC, the last byte, begins."""
    last_byte = 8 * (message.length - 1)
    places = {kind: (one.start, one.start + one.bits) for kind, one in protection.items()}
    if places.get(SignalKind.CRC) != (last_byte, last_byte + 8):
        raise LayoutError(f"{message.name}: Crc at bits {places.get(SignalKind.CRC)}; wanted the last byte")
    start, end = places.get(SignalKind.COUNTER, (0, 0))
    if end != last_byte:
        raise LayoutError(
            f"{message.name}: Counter at bits {start} to {end}; wanted it to end at {last_byte}"
        )
    return end - start
