"""The headers of the firmware, valid in C99 and C++11: structs in the layout of `flat.layout`, a config.

In single precision the structs contain floats, and the config's values are rounded once.
"""

import math
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path
from typing import Any, get_args, get_origin

import jinja2

from firmware_py.builds.c99.names import c_identifier, first_paragraph, is_record, snake
from firmware_py.builds.c99.single_precision import round_to_single
from firmware_py.builds.flat import Precision, layout, members
from firmware_py.core.config import Config
from firmware_py.interface.frame import WordFrame
from firmware_py.node.memory import FirmwareState
from firmware_py.node.tick import Tx

RECORDS = (Config, FirmwareState, WordFrame, Tx)
"""Types of the objects to which the function's pointers point."""
TEMPLATES = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)


def config_header(config: Config, precision: Precision = "double") -> str:
    """The text of the header with a config's values, floats exact to the last bit.

    Members are given by their order, with their names in comments, and floats in decimal digits: C++ before
    2020 has no initializers by name, and before 2017 no hexadecimal floats.
    """
    values = initializer(config, precision, "")
    return TEMPLATES.get_template("vibro_config.h.j2").render(values=values)


def initializer(value: Any, precision: Precision, indent: str) -> str:
    """The C initializer of a record or of one of its members."""
    inner = indent + "    "
    if hasattr(value, "_fields"):
        members = zip(value._fields, value, strict=True)
        lines = "".join(
            f"{inner}/* {c_identifier(name)} */ {initializer(one, precision, inner)},\n"
            for name, one in members
        )
        return f"{{\n{lines}{indent}}}"
    if isinstance(value, tuple):
        return f"{{{', '.join(initializer(one, precision, inner) for one in value)}}}"
    return number(value, precision)


def number(value: Any, precision: Precision, written: str = "") -> str:
    """A number or truth value in C; `written`: the digits of a float, if they are known."""
    if not isinstance(value, float):
        return str(value).lower() if isinstance(value, bool) else str(int(value))
    if precision == "single" and not math.isnan(value):
        value, written = round_to_single(value), ""
    if not math.isfinite(value):
        return "NAN" if math.isnan(value) else "INFINITY" if value > 0.0 else "-INFINITY"
    return (written or repr(value)) + ("f" if precision == "single" else "")


def header(precision: Precision = "double") -> str:
    """The text of the header with the structs and the function."""
    found: dict[Any, None] = {}
    for record in RECORDS:
        for kind in list_needed(record):
            found[kind] = None
    blocks = [
        enum_text(kind)
        if issubclass(kind, IntEnum)
        else struct_text(kind, precision) + size_text(kind, precision)
        for kind in found
    ]
    return TEMPLATES.get_template("vibro_firmware.h.j2").render(declarations="\n".join(blocks))


def list_needed(kind: Any) -> Iterator[Any]:
    """The records and enums that a type contains, each after its own members, and the type itself."""
    if get_origin(kind) is tuple:
        yield from list_needed(get_args(kind)[0])
    elif hasattr(kind, "_fields"):
        for _, member in members(kind):
            yield from list_needed(member)
        yield kind
    elif issubclass(kind, IntEnum):
        yield kind


def c_name(kind: type) -> str:
    """The name of a Python class in C; that of a block's constants begins with the block.

    >>> from firmware_py.core.safety import consent
    >>> c_name(FirmwareState), c_name(consent.Constants)
    ('vibro_firmware_state', 'vibro_consent_constants')
    """
    block = f"{kind.__module__.rpartition('.')[2]}_" if kind.__name__ == "Constants" else ""
    return f"vibro_{block}{snake(kind.__name__)}"


def enum_text(kind: type[IntEnum]) -> str:
    """The C declaration of an enum."""
    prefix = c_name(kind).upper()
    values = "\n".join(f"    {prefix}_{member.name} = {member.value}," for member in kind)
    return f"{first_paragraph(kind.__doc__)}\nenum {c_name(kind)} {{\n{values}\n}};\n"


def struct_text(kind: Any, precision: Precision) -> str:
    """The C declaration of a record's struct."""
    lines = [f"    {declaration(name, member, precision)}" for name, member in members(kind)]
    body = "\n".join(lines or ["    uint8_t nothing;"])  # C has no empty struct
    return f"{first_paragraph(kind.__doc__)}\ntypedef struct {{\n{body}\n}} {c_name(kind)};\n"


def size_text(kind: Any, precision: Precision) -> str:
    """A static assertion of a struct's size."""
    name, size = c_name(kind), layout(kind, precision).itemsize
    return f'VIBRO_HOLDS(sizeof({name}) == {size}, "{name} has another layout");\n'


def declaration(name: str, kind: Any, precision: Precision) -> str:
    """The C declaration of a member."""
    if get_origin(kind) is tuple:
        items = get_args(kind)
        first, _, rest = declaration(f"{name}[{len(items)}]", items[0], precision).partition(";")
        return f"{first};{rest}"
    real = "double" if precision == "double" else "float"
    named = {float: real, bool: "bool", int: "int64_t"}
    known = named.get(kind) or (c_name(kind) if is_record(kind) else "")
    enum = "" if known else f" /* enum {c_name(kind)} */"
    return f"{known or 'int64_t'} {c_identifier(name)};{enum}"
