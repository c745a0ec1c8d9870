"""A frame's layout as plain numbers: what `vibro.dbc` says of a message, checked and ready for struct.

Rules that keep the codec simple, and that this module enforces: little-endian; a signal is either a whole
8-, 16- or 32-bit word on a byte boundary or lies within one byte; no offsets; a protected frame carries its
counter in the high half of the last byte but one and its CRC in the last byte.
"""

import math
from enum import Enum
from typing import NamedTuple

from cantools.database.can import Message
from cantools.database.can import Signal as DbcSignal

_WORDS = {8: "B", 16: "H", 32: "I"}


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
    """One signal. Its physical value is `counts`·`scale`; a float's counts are the value itself."""

    name: str
    kind: SignalKind
    unit: str
    is_float: bool
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


class Part(NamedTuple):
    """A signal's place within its word."""

    signal: Signal
    shift: int
    mask: int  # 0: the signal is the whole word


class Word(NamedTuple):
    """One item of the frame's struct format and the signals within it."""

    code: str
    low_counts: int
    high_counts: int
    parts: tuple[Part, ...]


class Layout(NamedTuple):
    """A message: identity, timing, and its words in order. `words` leaves the CRC byte out."""

    name: str
    can_id: int
    length: int
    sender: str | None
    period_s: float | None
    protected: bool
    words: tuple[Word, ...]

    @property
    def signals(self) -> dict[str, Signal]:
        """The record's signals by name: all but counter and CRC."""
        inner = (part.signal for word in self.words for part in word.parts)
        return {signal.name: signal for signal in inner if signal.kind is not SignalKind.COUNTER}

    @property
    def body_format(self) -> str:
        """Struct format of the data without the CRC byte."""
        return "<" + "".join(word.code for word in self.words)


def layout_of(message: Message) -> Layout:
    """Turn a DBC message into a layout; raise `LayoutError` where it breaks a rule of the codec."""
    placed = {signal.start: (signal, _signal(message, signal)) for signal in message.signals}
    protected = any(signal.kind is SignalKind.CRC for _, signal in placed.values())
    if protected:
        _check_protection(message, {signal.kind: dbc for dbc, signal in placed.values()})
    body_bytes = message.length - protected
    words: list[Word] = []
    byte = 0
    while byte < body_bytes:
        whole = placed.get(8 * byte)
        if whole is not None and whole[0].length in _WORDS:
            words.append(_whole_word(*whole))
            byte += whole[0].length // 8
        else:
            words.append(_shared_byte(byte, placed))
            byte += 1
    if sum(len(word.parts) for word in words) != len(placed) - protected:
        raise LayoutError(
            f"{message.name}: a signal crosses a byte boundary; give it whole bytes or one byte"
        )
    return Layout(
        name=message.name,
        can_id=message.frame_id,
        length=message.length,
        sender=message.senders[0] if message.senders else None,
        period_s=None if message.cycle_time is None else message.cycle_time / 1000,
        protected=protected,
        words=tuple(words),
    )


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
    values = frozenset(dbc.choices or ()) if kind is SignalKind.ENUMERATION else frozenset()
    if kind is SignalKind.ENUMERATION and not values:
        raise LayoutError(f"{where}: an enumeration without values; list them in VAL_")
    if dbc.is_float:
        return Signal(dbc.name, kind, dbc.unit or "", True, 1, 0, 0, values)
    if dbc.minimum is None or dbc.maximum is None:
        raise LayoutError(f"{where}: no range; give [minimum|maximum]")
    low_counts, high_counts = round(dbc.minimum / dbc.scale), round(dbc.maximum / dbc.scale)
    lowest, highest = _span(dbc)
    if low_counts < lowest or high_counts > highest:
        raise LayoutError(f"{where}: range [{dbc.minimum}|{dbc.maximum}] does not fit {dbc.length} bits")
    return Signal(dbc.name, kind, dbc.unit or "", False, dbc.scale, low_counts, high_counts, values)


def _span(dbc: DbcSignal) -> tuple[int, int]:
    """Counts that the signal's bits can hold."""
    if dbc.is_signed:
        return -(1 << dbc.length - 1), (1 << dbc.length - 1) - 1
    return 0, (1 << dbc.length) - 1


def _whole_word(dbc: DbcSignal, signal: Signal) -> Word:
    if dbc.is_float:
        if dbc.length != 32:
            raise LayoutError(f"{signal.name}: a float of {dbc.length} bits; wanted 32")
        return Word("f", 0, 0, (Part(signal, 0, 0),))
    code = _WORDS[dbc.length]
    return Word(code.lower() if dbc.is_signed else code, *_span(dbc), (Part(signal, 0, 0),))


def _shared_byte(byte: int, placed: dict[int, tuple[DbcSignal, Signal]]) -> Word:
    """Word of one byte with the small unsigned signals within it; a pad byte if there are none."""
    parts = []
    for start in range(8 * byte, 8 * byte + 8):
        if start not in placed:
            continue
        dbc, signal = placed[start]
        shift = start - 8 * byte
        if shift + dbc.length <= 8 and not dbc.is_signed:
            parts.append(Part(signal, shift, (1 << dbc.length) - 1))
    return Word("B", 0, 255, tuple(parts)) if parts else Word("x", 0, 0, ())


def _check_protection(message: Message, by_kind: dict[SignalKind, DbcSignal]) -> None:
    """Hold counter and CRC to their fixed place."""
    last_byte = 8 * (message.length - 1)
    wanted = {SignalKind.COUNTER: (last_byte - 4, 4), SignalKind.CRC: (last_byte, 8)}
    for kind, (start, length) in wanted.items():
        signal = by_kind.get(kind)
        got = None if signal is None else (signal.start, signal.length)
        if got != (start, length):
            raise LayoutError(f"{message.name}: {kind.value} at {got}; wanted bit {start}, {length} bits")
