"""Generates code from `vibro.dbc` and `parameters.toml`: records, codec, the firmware's received frames.

    python -m firmware_py.interface.generate

A codec that loops over a description of the signals takes several times longer than the packing itself, and a
microcontroller has no such description; so each frame gets the few lines that one would write by hand. A test
compares the checked-in files with the output of this module.
"""

import argparse
import math
import subprocess
import sys
from pathlib import Path
from textwrap import wrap

from firmware_py.interface.dbc import Layout, Signal, SignalKind, layouts, span, value_table
from firmware_py.interface.framing import CRC_INITIAL, CRC_TABLE
from firmware_py.interface.parameter_table import TABLE as PARAMETER_TABLE
from firmware_py.interface.parameter_table import record_name

GENERATED = Path(__file__).with_name("generated")
WIDTH = 95

RECORDS = '''"""One record per CAN frame, in physical units: written by `generate.py`; do not edit.

Fields are in the order of their bits. Records contain no rolling counters and CRCs; the codec adds and checks
them.
"""

from typing import NamedTuple

'''

ENUMS = '''"""The value tables of `vibro.dbc`: written by `generate.py`; do not edit."""

from enum import IntEnum

'''
ENUM_OF_SIGNAL = {
    "mode": ("Mode", "Mode of the supervisor."),
    "request": (
        "OperatorRequest",
        "The operator's request. RUN and PROVE_WATCHDOG act only in READY, and only after a request "
        "for IDLE.",
    ),
    "regime": ("Regime", "Regime of the striker's motion, decided per drive period."),
    "gait_state": (
        "GaitState",
        "State of the wearer's leg. STANDING: the leg is at rest; UNCERTAIN: the gait phase is unreliable.",
    ),
    "fault": (
        "Fault",
        "Reason of disarming, latched until the operator clears it; REQUEST_REFUSED does not disarm.",
    ),
    "refusal": (
        "Refusal",
        "Reason why a request is not met; the firmware uses the nearest possible setting, or waits.",
    ),
    "acting_limit": (
        "ActingLimit",
        "The limit that acts on the torque at present. IMPACT_PHASE keeps the speed away from the "
        "fold, RETREAT from the speed at which the impacts were lost.",
    ),
    "axis_state": (
        "AxisState",
        "ODrive 0.6 axis states; the bench itself uses IDLE and CLOSED_LOOP_CONTROL.",
    ),
    "axis_error": ("AxisError", "ODrive 0.6 error bits; an error field is any combination of them."),
    "procedure_result": ("ProcedureResult", "ODrive 0.6: result of the axis's last procedure."),
    "control_mode": (
        "ControlMode",
        "ODrive 0.6: quantity that the drive's controller regulates. The bench uses TORQUE_CONTROL.",
    ),
    "input_mode": (
        "InputMode",
        "ODrive 0.6: treatment of the controller's set-points. The bench uses PASSTHROUGH.",
    ),
}
"""Name and meaning of the enum of each value table, by a signal that has this table."""

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
from firmware_py.interface.framing import float32_counts, is_float32, saturate, seal, signed
from firmware_py.interface.generated import kinds, records
'''

UNPACKING = '''"""Frames to records: written by `generate.py` out of `vibro.dbc`; do not edit.

`unpack_x(length, word)` gives `(record, reason)`; the record may be used only if the reason is NONE.
"""

from math import isfinite

from firmware_py.interface.frame import FrameErrorReason
from firmware_py.interface.framing import check_frame, float32_at, signed
from firmware_py.interface.generated import kinds, records
'''


RECEIVED = '''"""Frames received by the firmware: written by `generate.py` out of `vibro.dbc`; do not edit."""

from typing import NamedTuple

from firmware_py.interface.arrivals import Arrival, Counters, Now, accept
from firmware_py.interface.frame import WordFrame
from firmware_py.interface.generated import kinds, records, unpacking
from firmware_py.interface.zeroed import zeroed

'''

STATE = '''\
RECEIVED_IDS = ({ids})
"""The identifiers that the firmware receives, the most frequent first."""

class Received(NamedTuple):
    """The newest record and arrival of each frame that the firmware receives."""

{members}

INITIAL = zeroed(Received)
'''
RECEIVE = '''def receive(
    now: Now, received: Received, counters: Counters, frame: WordFrame
) -> tuple[Received, Counters, bool]:
    """Process one frame that arrived before the present tick: `(received, counters, usable)`."""
    can_id, length, word = frame
    usable = False
{branches}    return received, counters, usable
'''


PARAMETERS = '''"""The record of the parameters: written by `generate.py`; do not edit.

Their source is `parameters.toml`, which gives unit, bounds and meaning of each. Counts and
switches are ints, all others floats.
"""

from typing import NamedTuple

'''


def to_snake(name: str) -> str:
    """`SetInputTorque` as `set_input_torque`."""
    return "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name).lstrip("_")


def sources() -> dict[str, str]:
    """The text of each file by its name, before formatting."""
    frames = list(layouts().values())
    return {
        "kinds.py": KINDS + "".join(map(constant, frames)),
        "enums.py": "\n\n".join([ENUMS, *map(enum_source, ENUM_OF_SIGNAL)]),
        "records.py": "\n\n".join([RECORDS, *map(record_source, frames)]),
        "packing.py": "\n\n".join([PACKING, *map(pack_source, frames)]),
        "unpacking.py": "\n\n".join([UNPACKING, *map(unpack_source, frames)]),
        "received.py": received_source(frames),
        "parameters.py": parameters_source(),
    }


def constant(layout: Layout) -> str:
    """The constant with identity and timing of a frame, in kinds.py."""
    register = CRC_TABLE[CRC_INITIAL ^ (layout.can_id & 0xFF)] if layout.protected else 0
    period_s = layout.period_s or 0.0
    numbers = f"0x{layout.can_id:03X}, {layout.length}, {period_s!r}, {layout.counter_bits}, {register}"
    return f"{to_snake(layout.name).upper()} = FrameKind({numbers})\n"


def enum_source(signal: str) -> str:
    """The text of the enum of a signal's value table; flags in hexadecimal digits."""
    name, comment = ENUM_OF_SIGNAL[signal]
    table = value_table(signal)
    numbers = (f"0x{one:08X}" if one and max(table) > 0xFFFF else str(one) for one in table)
    members = "".join(f"    {key} = {number}\n" for key, number in zip(table.values(), numbers, strict=True))
    return f"class {name}(IntEnum):\n{docstring(comment)}\n{members}"


def record_source(layout: Layout) -> str:
    """The text of a frame's record; its fields are ints for whole numbers and floats for quantities."""
    when = ""
    if layout.period_s is not None:
        period_ms = round(layout.period_s * 1000)
        when = ", every tick" if period_ms == 1 else f", every {period_ms} ms"
    sender = f", from {layout.sender}" if layout.sender else ""
    text = f"class {layout.name}(NamedTuple):\n"
    text += docstring(f"0x{layout.can_id:03X}{sender}{when}. {layout.comment}")
    fields = ""
    for name, signal in layout.signals.items():
        kind = "float" if signal.is_real else "int"
        fields += f"    {name}: {kind}\n" + docstring(signal.comment)
    return f"{text}\n{fields}" if fields else text


def docstring(text: str) -> str:
    """The text as a docstring in a class's body; empty for an empty text."""
    if not text:
        return ""
    lines = wrap(text, WIDTH)
    if len(lines) == 1:
        return f'    """{lines[0]}"""\n'
    return '    """' + "\n    ".join(lines) + '\n    """\n'


def parameters_source() -> str:
    """The text of `parameters.py`."""
    tables = dict.fromkeys(parameter.table for parameter in PARAMETER_TABLE)
    records = "\n\n".join(
        f'class {record_name(table)}(NamedTuple):\n    """The table `{table}`."""\n\n{members(table)}'
        for table in tables
    )
    fields = "".join(f"    {table}: {record_name(table)}\n" for table in tables)
    whole = f'class Parameters(NamedTuple):\n    """All parameters, by table and key."""\n\n{fields}'
    return f"{PARAMETERS}\n{records}\n\n{whole}"


def members(table: str) -> str:
    """The fields of a table's record."""
    own = (one for one in PARAMETER_TABLE if one.table == table)
    return "".join(f"    {one.key}: {'int' if one.whole else 'float'}\n" for one in own)


def pack_source(layout: Layout) -> str:
    """The text of `pack_x(record, counter) -> (frame, sendable)`."""
    name, fields = to_snake(layout.name), list(layout.signals)
    lines = [
        f"def pack_{name}({'record' if fields else '_record'}: records.{layout.name}, counter: int) -> "
        "tuple[WordFrame, bool]:"
    ]
    if fields:
        lines += [f"    {', '.join(fields) if len(fields) > 1 else f'({fields[0]},)'} = record"]
    word = " | ".join(map(_shifted, layout.signals.values())) or "0"
    sendable = " and ".join(map(_sendable, layout.signals.values())) or "True"
    lines += [f"    word = {word}", f"    sendable = {sendable}"]
    return "\n".join([*lines, f"    return seal(kinds.{name.upper()}, word, counter, sendable)\n"])


def unpack_source(layout: Layout) -> str:
    """The text of `unpack_x(length, word) -> (record, reason)`."""
    name = to_snake(layout.name)
    values = ", ".join(f"{field}={_from_word(signal)}" for field, signal in layout.signals.items())
    lines = [
        f"def unpack_{name}(length: int, word: int) -> tuple[records.{layout.name}, FrameErrorReason]:",
        f"    record = records.{layout.name}({values})",
    ]
    listed = " and ".join(filter(None, map(_received, layout.signals.values())))
    if listed:
        lines += [f"    listed = {listed}"]
    valid = "listed" if listed else "True"
    return "\n".join(
        [*lines, f"    return record, check_frame(kinds.{name.upper()}, length, word, {valid})\n"]
    )


def _sendable(signal: Signal) -> str:
    """Condition under which the field's value can be sent."""
    if signal.is_float:
        return f"is_float32({signal.name})"
    if signal.kind is SignalKind.QUANTITY:
        return f"isfinite({signal.name})"
    return _valid(signal, signal.name, -math.inf, math.inf)


def _received(signal: Signal) -> str:
    """Condition that the received signal is valid; empty if all values of its bits are."""
    if signal.is_float:
        return f"isfinite(record.{signal.name})"
    counts = _operand(signal) if signal.is_real else f"record.{signal.name}"
    return _valid(signal, counts, *span(signal.is_signed, signal.bits))


def _valid(signal: Signal, counts: str, lowest: float, highest: float) -> str:
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


def _shifted(signal: Signal) -> str:
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


def _counts(signal: Signal) -> str:
    """Expression of the counts in the word."""
    raw = f"word >> {signal.start}" if signal.start else "word"
    return f"signed({raw}, {signal.bits})" if signal.is_signed else f"{raw} & 0x{(1 << signal.bits) - 1:X}"


def _operand(signal: Signal) -> str:
    """`_counts` within a larger expression."""
    return _counts(signal) if signal.is_signed else f"({_counts(signal)})"


def _from_word(signal: Signal) -> str:
    """Expression of the physical value of the signal in the word."""
    if signal.is_float:
        return f"float32_at(word >> {signal.start})" if signal.start else "float32_at(word)"
    return f"{_operand(signal)} * {signal.scale!r}" if signal.is_real else _counts(signal)


def received_source(frames: list[Layout]) -> str:
    """The text of the file: `RECEIVED_IDS`, `Received`, `INITIAL` and `receive`."""
    frames = sorted(
        (layout for layout in frames if "Firmware" in layout.receivers),
        key=lambda layout: (layout.period_s or math.inf, layout.can_id),
    )
    ids = ", ".join(f"kinds.{to_snake(layout.name).upper()}.can_id" for layout in frames)
    members, branches = "", ""
    for layout in frames:
        name = to_snake(layout.name)
        if layout.signals:
            members += f"    {name}: records.{layout.name}\n"
        members += f"    {name}_arrival: Arrival\n"
        branches += branch(layout)
    return (
        RECEIVED
        + STATE.format(ids=ids, members=members)
        + RECEIVE.format(branches=branches.replace("    elif", "    if", 1))
    )


def branch(layout: Layout) -> str:
    """The lines that process one frame."""
    name = to_snake(layout.name)
    kind, new = f"kinds.{name.upper()}", f"{name}_arrival=arrival"
    if layout.signals:
        new += f", {name}={name} if usable else received.{name}"
    return (
        f"    elif can_id == {kind}.can_id:\n"
        f"        {name if layout.signals else '_'}, reason = unpacking.unpack_{name}(length, word)\n"
        f"        arrival, counters, usable = accept(\n"
        f"            received.{name}_arrival, counters, {kind}, reason, word, now\n        )\n"
        f"        received = received._replace({new})\n"
    )


def format_source(text: str) -> str:
    """The Python source, formatted by `ruff format`; needs the packages of requirements-dev.lock."""
    command = [sys.executable, "-P", "-m", "ruff", "format", "--stdin-filename", __file__, "-"]
    return subprocess.run(command, input=text, check=True, capture_output=True, text=True).stdout


if __name__ == "__main__":
    argparse.ArgumentParser(prog="python -m firmware_py.interface.generate", description=__doc__).parse_args()
    for file, text in sources().items():
        (GENERATED / file).write_text(format_source(text), encoding="utf-8")
