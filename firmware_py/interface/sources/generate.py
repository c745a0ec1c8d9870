"""Writes the codec out of `vibro.dbc`: `packing.py`, in the firmware's subset, and `layouts.toml`.

    python -m firmware_py.interface.sources.generate

A codec that loops over a description of its signals costs several times what the packing does, and a
microcontroller has no description; so each frame gets the few lines that someone would write by hand. The
bench needs the description too, for messages and tables, but not a parser of DBC files in every process. A
test holds the checked-in files against what this module writes; `ruff format` lays their lines out.
"""

import json
from pathlib import Path
from typing import Any, get_type_hints

from firmware_py.interface import records
from firmware_py.interface.crc import INITIAL, TABLE
from firmware_py.interface.layout import Layout, Signal, SignalKind, snake, span
from firmware_py.interface.sources.dbc import database
from firmware_py.interface.sources.layout import LayoutError, layout_of

PACKING = Path(__file__).parents[1] / "packing.py"
LAYOUTS = Path(__file__).parents[1] / "layouts.toml"

HEADER = '''"""Records to 64-bit words and back: written by `generate.py` out of `vibro.dbc`; do not edit.

A frame's data is a signed 64-bit word: byte 0 in the lowest bits, unused high bytes 0. All of it is the
firmware's subset, so that one source runs interpreted, compiled and on a microcontroller.

`pack_x(record, counter)` gives `(word, sendable)`. Quantities saturate at full scale, in counts; a record
with NaN, an infinity or a value outside its list is not sendable, and its word is 0. Frames without a
rolling counter ignore `counter`.
`unpack_x(length, word)` gives `(record, reason)`; the record may be used only if the reason is NONE.
"""

from math import isfinite

from firmware_py.interface.crc import TABLE
from firmware_py.interface.errors import FrameErrorReason
from firmware_py.interface.float32 import FLOAT32_OVERFLOW, float32_bits, float32_of
from firmware_py.interface.records import (
'''


def frames() -> list[tuple[type[Any], Layout]]:
    """Each record of the bus with its frame's layout, in the order of their identifiers."""
    kinds = [
        kind
        for kind in vars(records).values()
        if isinstance(kind, type) and kind.__module__ == records.__name__
    ]
    pairs = [(kind, layout_of(database().get_message_by_name(kind.__name__))) for kind in kinds]
    return sorted(pairs, key=lambda pair: pair[1].can_id)


def layouts_source() -> str:
    """The text of `layouts.toml`."""
    text = "# The layout of every frame by name: written by `generate.py` out of `vibro.dbc`; do not edit.\n"
    for _, layout in frames():
        fields = {name: value for name, value in layout._asdict().items() if value is not None}
        name, signals = fields.pop("name"), fields.pop("signals")
        text += f"\n[{name}]\n" + "".join(f"{one} = {toml(fields[one])}\n" for one in fields)
        for signal in signals.values():
            each = signal._asdict() | {"kind": signal.kind.value, "values": sorted(signal.values)}
            inline = ", ".join(f"{one} = {toml(each[one])}" for one in each if one != "name")
            text += f"signals.{signal.name} = {{ {inline} }}\n"
    return text


def toml(value: object) -> str:
    """A number, a truth value, a list of numbers or a plain word, which TOML writes as JSON does."""
    return json.dumps(value)


def source() -> str:
    """The text of `packing.py`."""
    pairs = frames()
    names = sorted(kind.__name__ for kind, _ in pairs)
    text = HEADER + "".join(f"    {name},\n" for name in names) + ")\n\n"
    text += "OK = FrameErrorReason.NONE\nLENGTH = FrameErrorReason.LENGTH\nCRC = FrameErrorReason.CRC\n"
    text += "RANGE = FrameErrorReason.RANGE\nENUMERATION = FrameErrorReason.ENUMERATION\n"
    text += "NOT_FINITE = FrameErrorReason.NOT_FINITE\n"
    for _, layout in pairs:
        text += "\n" + constants(layout)
    for kind, layout in pairs:
        text += "\n\n" + pack_source(layout, kind) + "\n\n" + unpack_source(layout, kind)
    return text


def constants(layout: Layout) -> str:
    """Identity and timing of a frame."""
    name = snake(layout.name).upper()
    text = f"{name}_ID = 0x{layout.can_id:03X}\n{name}_LENGTH = {layout.length}\n"
    if layout.period_s is not None:
        text += f"{name}_PERIOD_S = {layout.period_s!r}\n"
    if layout.protected:
        text += f"{name}_COUNTER_BITS = {layout.counter_bits}\n"
    return text


def pack_source(layout: Layout, kind: type[Any]) -> str:
    """The text of `pack_x(record, counter) -> (word, sendable)`."""
    hints = checked_hints(layout, kind)
    name = layout.name
    lines = [
        f"def pack_{snake(name)}({'record' if hints else '_record'}: {name}, "
        f"{'counter' if layout.protected else '_counter'}: int) -> tuple[int, bool]:"
    ]
    if hints:
        lines += [f"    {', '.join(hints) if len(hints) > 1 else f'({next(iter(hints))},)'} = record"]
        conditions = " and ".join(_sendable(layout.signals[field]) for field in hints)
        lines += [f"    if not ({conditions}):", "        return 0, False"]
    terms = []
    for field, signal in layout.signals.items():
        lines += _to_counts(signal, hints[field] is float)
        terms.append(_placed(signal, f"{field}_counts" if _has_counts(signal) else field))
    if layout.protected:
        start = 8 * (layout.length - 1) - layout.counter_bits
        terms.append(f"(counter & {(1 << layout.counter_bits) - 1}) << {start}")
    if not layout.protected:
        lines += [f"    return {' | '.join(terms) or '0'}, True"]
        return "\n".join(lines) + "\n"
    lines += [f"    word = {' | '.join(terms)}", *_lanes(layout.length - 1), *_crc_lines(layout)]
    top = 8 * (layout.length - 1)
    sealed = f"(crc ^ 128) - 128 << {top}" if layout.length == 8 else f"crc << {top}"
    lines += [f"    return word | {sealed}, True"]
    return "\n".join(lines) + "\n"


def unpack_source(layout: Layout, kind: type[Any]) -> str:
    """The text of `unpack_x(length, word) -> (record, reason)`."""
    hints = checked_hints(layout, kind)
    name = layout.name
    empty = f"NO_{snake(name).upper()}"
    zeros = ", ".join("0.0" if hint is float else "0" for hint in hints.values())
    lines = [
        f"{empty} = {name}({zeros})",
        "",
        "",
        f"def unpack_{snake(name)}(length: int, {'word' if hints else '_word'}: int) -> "
        f"tuple[{name}, FrameErrorReason]:",
        f"    if length != {layout.length}:",
        f"        return {empty}, LENGTH",
    ]
    lanes: dict[int, str] = {}
    if layout.protected:
        lines += _lanes(layout.length) + _crc_lines(layout)
        last = layout.length - 1
        lines += [f"    if crc != {_byte(last)}:", f"        return {empty}, CRC"]
        lanes = {16 * lane: f"lane_{lane}" for lane in range((layout.length + 1) // 2)}
    for field, signal in layout.signals.items():
        lines += [f"    {field} = {_from_word(signal, lanes)}"]
        lines += _checks(signal, empty)
    values = ", ".join(_to_value(layout.signals[field], hints[field] is float) for field in hints)
    lines += [f"    return {name}({values}), OK"]
    return "\n".join(lines) + "\n"


def checked_hints(layout: Layout, kind: type[Any]) -> dict[str, type[Any]]:
    """The record's fields and their types, held against the message's signals."""
    hints = get_type_hints(kind)
    if set(hints) != set(layout.signals):
        raise LayoutError(
            f"{layout.name}: signals {sorted(layout.signals)}, but the record has {sorted(hints)}"
        )
    return hints


def _sendable(signal: Signal) -> str:
    """Condition under which the field's value can be sent."""
    name = signal.name
    if signal.is_float:
        return f"-FLOAT32_OVERFLOW < {name} < FLOAT32_OVERFLOW"
    if signal.kind is SignalKind.QUANTITY:
        return f"isfinite({name})"
    return _listed(signal)


def _listed(signal: Signal) -> str:
    """Condition that a whole number is one of the signal's."""
    if signal.kind is SignalKind.ENUMERATION:
        values = sorted(signal.values)
        if values != list(range(values[0], values[-1] + 1)):
            return f"{signal.name} in {tuple(values)}"
        return f"{values[0]} <= {signal.name} <= {values[-1]}"
    return f"{signal.low_counts} <= {signal.name} <= {signal.high_counts}"


def _has_counts(signal: Signal) -> bool:
    return signal.is_float or signal.kind is SignalKind.QUANTITY


def _to_counts(signal: Signal, is_real: bool) -> list[str]:
    """Lines that turn the field's value into its counts."""
    name = signal.name
    counts = f"{name}_counts"
    if signal.is_float:
        return [f"    {counts} = float32_bits({name})"]
    if signal.kind is not SignalKind.QUANTITY:
        return []
    low, high = signal.low_counts, signal.high_counts
    scaled, lines = name, []
    if signal.scale != 1:
        scaled = f"{name}_scaled"
        lines = [f"    {scaled} = {name} / {signal.scale!r}"]
    within = f"round({scaled})" if is_real else scaled
    beyond = f"{high} if {scaled} > 0 else {low}"
    return [*lines, f"    {counts} = {within} if {low} < {scaled} < {high} else ({beyond})"]


def _placed(signal: Signal, counts: str) -> str:
    """Expression of the counts in their place within the word."""
    mask = (1 << signal.bits) - 1
    at = signal.start
    if at + signal.bits == 64:
        # The word is signed: its top bit is a sign.
        if signal.is_signed and not signal.is_float:
            return f"{counts} << {at}"
        half = 1 << signal.bits - 1
        return f"({counts} ^ 0x{half:X}) - 0x{half:X} << {at}"
    if signal.is_signed and not signal.is_float:
        return f"({counts} & 0x{mask:X}) << {at}" if at else f"{counts} & 0x{mask:X}"
    return f"{counts} << {at}" if at else counts


def _lanes(byte_count: int) -> list[str]:
    """Lines that split the word's first bytes into lanes of 16 bits."""
    shifted = (f"word >> {16 * lane}" if lane else "word" for lane in range((byte_count + 1) // 2))
    return [f"    lane_{lane} = {one} & 0xFFFF" for lane, one in enumerate(shifted)]


def _byte(index: int) -> str:
    return f"lane_{index // 2} >> 8" if index % 2 else f"lane_{index // 2} & 0xFF"


def _crc_lines(layout: Layout) -> list[str]:
    """Lines that leave the checksum of all bytes but the last in `crc`."""
    lines = []
    register = str(TABLE[INITIAL ^ (layout.can_id & 0xFF)])
    for index in range(0, layout.length - 1, 2):
        step = f"TABLE[{register} ^ {_byte(index)}]"
        if index + 1 < layout.length - 1:
            step = f"TABLE[{step} ^ {_byte(index + 1)}]"
        last = index + 2 >= layout.length - 1
        lines.append(f"    crc = {step}{' ^ 0xFF' if last else ''}")
        register = "crc"
    return lines


def _from_word(signal: Signal, lanes: dict[int, str]) -> str:
    """Expression of the counts out of the word; of a float, its value."""
    at, bits = signal.start, signal.bits
    mask = (1 << bits) - 1
    raw = lanes.get(at, "") if bits == 16 else ""
    if not raw:
        raw = f"word >> {at} & 0x{mask:X}" if at else f"word & 0x{mask:X}"
    if signal.is_float:
        return f"float32_of({raw})"
    if signal.is_signed:
        half = 1 << bits - 1
        return f"({raw} ^ 0x{half:X}) - 0x{half:X}"
    return raw


def _checks(signal: Signal, empty: str) -> list[str]:
    """Lines that refuse counts which the signal cannot have; none if its bits hold nothing else."""
    if signal.is_float:
        return [f"    if not isfinite({signal.name}):", f"        return {empty}, NOT_FINITE"]
    if signal.kind is SignalKind.ENUMERATION:
        return [f"    if not ({_listed(signal)}):", f"        return {empty}, ENUMERATION"]
    if (signal.low_counts, signal.high_counts) == span(signal.is_signed, signal.bits):
        return []
    return [f"    if not ({_listed(signal)}):", f"        return {empty}, RANGE"]


def _to_value(signal: Signal, is_real: bool) -> str:
    """Expression of the physical value from the counts."""
    if signal.is_float or (signal.scale == 1 and not is_real):
        return signal.name
    return f"float({signal.name})" if signal.scale == 1 else f"{signal.name} * {signal.scale!r}"


if __name__ == "__main__":
    PACKING.write_text(source(), encoding="utf-8")
    LAYOUTS.write_text(layouts_source(), encoding="utf-8")
