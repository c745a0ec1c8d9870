"""The text of `records.py`: one record per frame, in the units of `vibro.dbc`."""

from textwrap import wrap

from cantools.database.can import Message

from firmware_py.interface.layout import Layout

RECORDS = '''"""One record per CAN frame, in physical units: written by `generate.py`; do not edit.

Fields are in the order of their bits. Records contain no rolling counters and CRCs; the codec adds and checks
them.
"""

from typing import NamedTuple

'''
WIDTH = 95


def record_source(layout: Layout, message: Message) -> str:
    """The text of a frame's record; its fields are ints for whole numbers and floats for quantities."""
    when = ""
    if layout.period_s is not None:
        period_ms = round(layout.period_s * 1000)
        when = ", every tick" if period_ms == 1 else f", every {period_ms} ms"
    sender = f", from {layout.sender}" if layout.sender else ""
    text = f"class {layout.name}(NamedTuple):\n"
    text += docstring(f"0x{layout.can_id:03X}{sender}{when}. {message.comment}")
    for name, signal in layout.signals.items():
        kind = "float" if signal.is_real else "int"
        text += f"\n    {name}: {kind}\n" + docstring(message.get_signal_by_name(name).comment or "")
    return text


def nothing(layout: Layout) -> str:
    """The expression of a frame's record with all its signals at zero."""
    zeros = ("0.0" if signal.is_real else "0" for signal in layout.signals.values())
    return f"records.{layout.name}({', '.join(zeros)})"


def docstring(text: str) -> str:
    """The text as a docstring in a class's body; empty for an empty text."""
    if not text:
        return ""
    lines = wrap(text, WIDTH)
    if len(lines) == 1:
        return f'    """{lines[0]}"""\n'
    return '    """' + "\n    ".join(lines) + '\n    """\n'
