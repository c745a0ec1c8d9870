"""Generates code from `vibro.dbc`: records, their codec, and the firmware's received frames.

    python -m firmware_py.interface.sources.generate

A codec that loops over a description of the signals takes several times longer than the packing itself, and a
microcontroller has no such description; so each frame gets the few lines that one would write by hand. The
bench also needs the description, for messages and tables: layouts.toml saves it from parsing DBC files in
each process. A test compares the checked-in files with the output of this module.
"""

import json
from pathlib import Path

from firmware_py.interface.crc import INITIAL, TABLE
from firmware_py.interface.layout import Layout, Signal, SignalKind, snake, span
from firmware_py.interface.sources.dbc import database
from firmware_py.interface.sources.dbc_layout import layout_of
from firmware_py.interface.sources.received import received_source
from firmware_py.interface.sources.records import RECORDS, record_source
from firmware_py.interface.sources.write import write

GENERATED = Path(__file__).parents[1] / "generated"

KINDS = '''"""Identity and timing of every frame: written by `generate.py` out of `vibro.dbc`; do not edit."""

from firmware_py.interface.framing import FrameKind

'''

PACKING = '''"""Records to frames: written by `generate.py` out of `vibro.dbc`; do not edit.

`pack_x(record, counter)` gives `(frame, sendable)`. Quantities saturate at full scale, in counts; a record
with NaN, an infinity or a value outside its list is not sendable, and its frame's word is 0. Frames without
a rolling counter ignore `counter`. All of it is the firmware's subset, as in `unpacking.py`, so that one
source runs interpreted, compiled and on a microcontroller.
"""

from math import isfinite

from firmware_py.interface.frame import WordFrame
from firmware_py.interface.framing import float32_counts, framed, is_float32, saturated, signed
from firmware_py.interface.generated import kinds, records
'''

UNPACKING = '''"""Frames to records: written by `generate.py` out of `vibro.dbc`; do not edit.

`unpack_x(length, word)` gives `(record, reason)`; the record may be used only if the reason is NONE.
"""

from math import isfinite

from firmware_py.interface.errors import FrameErrorReason
from firmware_py.interface.framing import float32_at, judged, signed
from firmware_py.interface.generated import kinds, records
'''


CODECS = '''"""The codec of every frame: written by `generate.py` out of `vibro.dbc`; do not edit."""

from firmware_py.interface.frame_codec import codec_of
from firmware_py.interface.generated import packing, records, unpacking

'''


def frames() -> list[Layout]:
    """The layout of each frame, in the order of their identifiers."""
    return sorted(map(layout_of, database().messages), key=lambda layout: layout.can_id)


def layouts_source() -> str:
    """The text of `layouts.toml`."""
    text = "# The layout of every frame by name: written by `generate.py` out of `vibro.dbc`; do not edit.\n"
    for layout in frames():
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


def sources() -> dict[str, str]:
    """The text of each file by its name, before formatting."""
    layouts, message = frames(), database().get_message_by_name
    return {
        "kinds.py": KINDS + "".join(map(constant, layouts)),
        "records.py": "\n\n".join([RECORDS, *(record_source(one, message(one.name)) for one in layouts)]),
        "packing.py": "\n\n".join([PACKING, *map(pack_source, layouts)]),
        "unpacking.py": "\n\n".join([UNPACKING, *map(unpack_source, layouts)]),
        "codecs.py": CODECS + "".join(map(codec_source, layouts)),
        "received.py": received_source(layouts),
        "layouts.toml": layouts_source(),
    }


def constant(layout: Layout) -> str:
    """The constant with identity and timing of a frame, in kinds.py."""
    register = TABLE[INITIAL ^ (layout.can_id & 0xFF)] if layout.protected else 0
    period_s = layout.period_s or 0.0
    numbers = f"0x{layout.can_id:03X}, {layout.length}, {period_s!r}, {layout.counter_bits}, {register}"
    return f"{snake(layout.name).upper()} = FrameKind({numbers})\n"


def codec_source(layout: Layout) -> str:
    """The constant of a frame's codec, in codecs.py."""
    name = snake(layout.name)
    return f"{name.upper()} = codec_of(records.{layout.name}, packing.pack_{name}, unpacking.unpack_{name})\n"


def pack_source(layout: Layout) -> str:
    """The text of `pack_x(record, counter) -> (frame, sendable)`."""
    name, fields = snake(layout.name), list(layout.signals)
    lines = [
        f"def pack_{name}({'record' if fields else '_record'}: records.{layout.name}, counter: int) -> "
        "tuple[WordFrame, bool]:"
    ]
    if fields:
        lines += [f"    {', '.join(fields) if len(fields) > 1 else f'({fields[0]},)'} = record"]
    word = " | ".join(map(_placed, layout.signals.values())) or "0"
    sendable = " and ".join(map(_sendable, layout.signals.values())) or "True"
    lines += [f"    word = {word}", f"    sendable = {sendable}"]
    return "\n".join([*lines, f"    return framed(kinds.{name.upper()}, word, counter, sendable)\n"])


def unpack_source(layout: Layout) -> str:
    """The text of `unpack_x(length, word) -> (record, reason)`."""
    name = snake(layout.name)
    lines = [
        f"def unpack_{name}(length: int, word: int) -> tuple[records.{layout.name}, FrameErrorReason]:",
        *(f"    {field} = {_from_word(signal)}" for field, signal in layout.signals.items()),
    ]
    listed = " and ".join(filter(None, map(_received, layout.signals.values()))) or "True"
    values = ", ".join(map(_to_value, layout.signals.values()))
    lines += [f"    reason = judged(kinds.{name.upper()}, length, word, {listed})"]
    return "\n".join([*lines, f"    return records.{layout.name}({values}), reason\n"])


def _sendable(signal: Signal) -> str:
    """Condition under which the field's value can be sent."""
    if signal.is_float:
        return f"is_float32({signal.name})"
    if signal.kind is SignalKind.QUANTITY:
        return f"isfinite({signal.name})"
    return _listed(signal)


def _listed(signal: Signal) -> str:
    """Condition that a whole number is a valid value of the signal."""
    if signal.kind is SignalKind.ENUMERATION:
        values = sorted(signal.values)
        if values != list(range(values[0], values[-1] + 1)):
            return f"{signal.name} in {tuple(values)}"
        return f"{values[0]} <= {signal.name} <= {values[-1]}"
    return f"{signal.low_counts} <= {signal.name} <= {signal.high_counts}"


def _received(signal: Signal) -> str:
    """Condition that received counts are valid for the signal; empty if all values of its bits are."""
    if signal.is_float:
        return f"isfinite({signal.name})"
    is_listed = signal.kind is SignalKind.ENUMERATION
    is_any = (signal.low_counts, signal.high_counts) == span(signal.is_signed, signal.bits)
    return _listed(signal) if is_listed or not is_any else ""


def _placed(signal: Signal) -> str:
    """Expression of the field's counts in their place within the word."""
    counts, is_signed = signal.name, signal.is_signed
    if signal.is_float:
        counts, is_signed = f"float32_counts({signal.name})", False
    elif signal.kind is SignalKind.QUANTITY:
        scaled = f"{signal.name} / {signal.scale!r}" if signal.is_real else f"float({signal.name})"
        counts = f"saturated({scaled}, {signal.low_counts}, {signal.high_counts})"
    if signal.start + signal.bits == 64:
        # The word is signed: its top bit is the sign.
        counts = counts if is_signed else f"signed({counts}, {signal.bits})"
    elif is_signed:
        masked = f"{counts} & 0x{(1 << signal.bits) - 1:X}"
        counts = f"({masked})" if signal.start else masked
    return f"{counts} << {signal.start}" if signal.start else counts


def _from_word(signal: Signal) -> str:
    """Expression of the counts in the word; of the value for a float."""
    raw = f"word >> {signal.start}" if signal.start else "word"
    if signal.is_float:
        return f"float32_at({raw})"
    return f"signed({raw}, {signal.bits})" if signal.is_signed else f"{raw} & 0x{(1 << signal.bits) - 1:X}"


def _to_value(signal: Signal) -> str:
    """Expression of the physical value from the counts."""
    return signal.name if signal.is_float or not signal.is_real else f"{signal.name} * {signal.scale!r}"


if __name__ == "__main__":
    for file, text in sources().items():
        write(GENERATED / file, text)
