"""Generates code from `vibro.dbc` and `parameters.toml`: records, codec, the firmware's received frames.

    python -m firmware_py.interface.generate

A codec that loops over a description of the signals takes several times longer than the packing itself, and a
microcontroller has no such description; so each frame gets the few lines that one would write by hand. Each
file has its template in `templates`. A test compares the checked-in files with the output of this module.
"""

import argparse
import math
import subprocess
import sys
from itertools import groupby
from pathlib import Path
from textwrap import wrap

import jinja2

from firmware_py.interface.dbc import Layout, Signal, SignalKind, layouts, span, value_table
from firmware_py.interface.framing import CRC_INITIAL, CRC_TABLE
from firmware_py.interface.parameter_table import TABLE as PARAMETER_TABLE
from firmware_py.interface.parameter_table import record_name

GENERATED = Path(__file__).with_name("generated")
WIDTH = 95


def to_snake(name: str) -> str:
    """`SetInputTorque` as `set_input_torque`."""
    return "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name).lstrip("_")


def sources() -> dict[str, str]:
    """The text of each file by its name, before formatting."""
    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).with_name("templates")),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters |= FILTERS
    frames = list(layouts().values())
    received = sorted(
        (layout for layout in frames if "Firmware" in layout.receivers),
        key=lambda layout: (layout.period_s or math.inf, layout.can_id),
    )
    tables = {table: list(entries) for table, entries in groupby(PARAMETER_TABLE, lambda one: one.table)}
    return {
        name.removesuffix(".j2"): templates.get_template(name).render(
            frames=frames, received=received, tables=tables
        )
        for name in templates.list_templates()
    }


def numbers_of_kind(layout: Layout) -> str:
    """The members of a frame's `FrameKind`."""
    register = CRC_TABLE[CRC_INITIAL ^ (layout.can_id & 0xFF)] if layout.protected else 0
    period_s = layout.period_s or 0.0
    return f"0x{layout.can_id:03X}, {layout.length}, {period_s!r}, {layout.counter_bits}, {register}"


def members_of(signal: str) -> list[tuple[str, str]]:
    """The numbers and names of a signal's value table; flags in hexadecimal digits."""
    table = value_table(signal)
    numbers = (f"0x{one:08X}" if one and max(table) > 0xFFFF else str(one) for one in table)
    return list(zip(numbers, table.values(), strict=True))


def about(layout: Layout) -> str:
    """The docstring of a frame's record: identifier, sender, period and meaning."""
    when = ""
    if layout.period_s is not None:
        period_ms = round(layout.period_s * 1000)
        when = ", every tick" if period_ms == 1 else f", every {period_ms} ms"
    sender = f", from {layout.sender}" if layout.sender else ""
    return f"0x{layout.can_id:03X}{sender}{when}. {layout.comment}"


def docstring(text: str) -> str:
    """The text as a docstring in a class's body; empty for an empty text."""
    lines = wrap(text, WIDTH)
    if len(lines) < 2:
        return f'    """{lines[0]}"""' if lines else ""
    return '    """' + "\n    ".join(lines) + '\n    """'


def sendable(signal: Signal) -> str:
    """Condition under which the field's value can be sent."""
    if signal.is_float:
        return f"is_float32({signal.name})"
    if signal.kind is SignalKind.QUANTITY:
        return f"isfinite({signal.name})"
    return valid(signal, signal.name, -math.inf, math.inf)


def received(signal: Signal) -> str:
    """Condition that the received signal is valid; empty if all values of its bits are."""
    if signal.is_float:
        return f"isfinite(record.{signal.name})"
    counts = operand(signal) if signal.is_real else f"record.{signal.name}"
    return valid(signal, counts, *span(signal.is_signed, signal.bits))


def valid(signal: Signal, counts: str, lowest: float, highest: float) -> str:
    """Condition that `counts`, from `lowest` to `highest`, are valid for the signal; empty if all are."""
    values = sorted(signal.values) or [signal.low_counts, signal.high_counts]
    low, high = values[0], values[-1]
    if signal.values and values != list(range(low, high + 1)):
        return f"{counts} in {tuple(values)}"
    if low > lowest and high < highest:
        return f"{low} <= {counts} <= {high}"
    if low > lowest:
        return f"{counts} >= {low}"
    return f"{counts} <= {high}" if high < highest else ""


def shifted(signal: Signal) -> str:
    """Expression of the field's counts at their bits of the word."""
    counts, is_signed = signal.name, signal.is_signed
    if signal.is_float:
        counts, is_signed = f"float32_counts({signal.name})", False
    elif signal.kind is SignalKind.QUANTITY:
        scaled = f"{signal.name} / {signal.scale!r}" if signal.is_real else f"float({signal.name})"
        counts = f"saturate({scaled}, {signal.low_counts}, {signal.high_counts})"
    if signal.start + signal.bits == 64:
        # The word is signed: its top bit is the sign.
        counts = counts if is_signed else f"signed({counts}, {signal.bits})"
    elif is_signed:
        masked = f"{counts} & 0x{(1 << signal.bits) - 1:X}"
        counts = f"({masked})" if signal.start else masked
    return f"{counts} << {signal.start}" if signal.start else counts


def counts_of(signal: Signal) -> str:
    """Expression of the counts in the word."""
    raw = f"word >> {signal.start}" if signal.start else "word"
    return f"signed({raw}, {signal.bits})" if signal.is_signed else f"{raw} & 0x{(1 << signal.bits) - 1:X}"


def operand(signal: Signal) -> str:
    """`counts_of` within a larger expression."""
    return counts_of(signal) if signal.is_signed else f"({counts_of(signal)})"


def from_word(signal: Signal) -> str:
    """Expression of the physical value of the signal in the word."""
    if signal.is_float:
        return f"float32_at(word >> {signal.start})" if signal.start else "float32_at(word)"
    return f"{operand(signal)} * {signal.scale!r}" if signal.is_real else counts_of(signal)


FILTERS = {
    "snake": to_snake,
    "numbers_of_kind": numbers_of_kind,
    "value_table": members_of,
    "about": about,
    "docstring": docstring,
    "record_name": record_name,
    "shifted": shifted,
    "sendable": sendable,
    "received": received,
    "from_word": from_word,
}
"""What the templates apply to a name, a frame, a signal or a comment."""


def format_source(text: str) -> str:
    """The Python source, formatted by `ruff format`; needs the packages of requirements-dev.lock."""
    command = [sys.executable, "-P", "-m", "ruff", "format", "--stdin-filename", __file__, "-"]
    return subprocess.run(command, input=text, check=True, capture_output=True, text=True).stdout


if __name__ == "__main__":
    argparse.ArgumentParser(prog="python -m firmware_py.interface.generate", description=__doc__).parse_args()
    for file, text in sources().items():
        (GENERATED / file).write_text(format_source(text), encoding="utf-8")
