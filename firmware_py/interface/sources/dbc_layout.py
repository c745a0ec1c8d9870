"""The layout of a frame from its message in `vibro.dbc`, checked against the rules of the codec.

The rules keep the codec simple: little-endian; no offsets; a protected frame ends in its rolling counter and,
as its last byte, its CRC.
"""

from cantools.database.can import Message
from cantools.database.can import Signal as DbcSignal

from firmware_py.interface.layout import Layout, Signal, SignalKind, span


class LayoutError(ValueError):
    """`vibro.dbc` breaks a rule of the codec."""


def layout_of(message: Message) -> Layout:
    """Convert a DBC message into a layout; raise `LayoutError` if it breaks a rule of the codec."""
    signals = [_signal(message, dbc) for dbc in sorted(message.signals, key=lambda dbc: dbc.start)]
    protection = {signal.kind: signal for signal in signals if signal.kind in _PROTECTING}
    return Layout(
        name=message.name,
        can_id=message.frame_id,
        length=message.length,
        sender=message.senders[0] if message.senders else None,
        receivers=tuple(sorted(message.receivers)) or ALL_NODES,
        period_s=None if message.cycle_time is None else message.cycle_time / 1000,
        counter_bits=_counter_bits(message, protection) if protection else 0,
        signals={signal.name: signal for signal in signals if signal.kind not in _PROTECTING},
    )


ALL_NODES = ("Drive", "Firmware", "Operator", "Recorder")
"""Receivers of a frame without signals; a DBC names receivers only for signals."""

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
    """Smallest and largest counts of the DBC's range."""
    if dbc.minimum is None or dbc.maximum is None:
        raise LayoutError(f"{where}: no range; give [minimum|maximum]")
    low_counts, high_counts = round(dbc.minimum / dbc.scale), round(dbc.maximum / dbc.scale)
    lowest, highest = span(dbc.is_signed, dbc.length)
    if low_counts < lowest or high_counts > highest:
        raise LayoutError(f"{where}: range [{dbc.minimum}|{dbc.maximum}] does not fit {dbc.length} bits")
    return low_counts, high_counts


def _counter_bits(message: Message, protection: dict[SignalKind, Signal]) -> int:
    """Width of the counter, which must end directly below the CRC, the last byte."""
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
