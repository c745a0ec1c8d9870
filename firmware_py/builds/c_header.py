"""The headers of the firmware, valid in C99 and C++11: structs in the layout of `flat.layout`, a config.

In single precision the structs contain floats, and the config's values are rounded once.
"""

import inspect
import math
import re
from collections.abc import Iterator
from enum import IntEnum
from typing import Any, get_args, get_origin

from firmware_py.builds.flat import Precision, layout, members
from firmware_py.builds.single_precision import round_to_single
from firmware_py.core.config import Config
from firmware_py.interface.frame import WordFrame
from firmware_py.node.memory import FirmwareState
from firmware_py.node.tick import Tx

RECORDS = (Config, FirmwareState, WordFrame, Tx)
"""Types of the objects to which the function's pointers point."""
CPP_KEYWORDS = ("operator",)
"""Member names that are keywords of C++; they get an underscore."""

TOP = """\
/* The controller of the vibro-impact drive, built by `vibrohil firmware build`; made by machine, don't edit.
 *
 * SI units: the end of a name is its unit (x_m, v_m_s, omega_rad_s, torque_n_m); without one it has none.
 * An integer that holds an enum's value names the enum in its comment.
 */
#ifndef VIBRO_FIRMWARE_H
#define VIBRO_FIRMWARE_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#define VIBRO_HOLDS static_assert
#elif __STDC_VERSION__ >= 201112L
#define VIBRO_HOLDS _Static_assert
#else /* C99: an array of negative size is an error */
#define VIBRO_HOLDS(condition, message) extern char vibro_holds[(condition) ? 1 : -1]
#endif

"""

BOTTOM = """\
/* Fill `state` as it is at power-up. */
void vibro_power_up(vibro_firmware_state *state);

/* Hand over received frames in the order of their arrival, at any time but during another call. A frame that
 * the firmware does not receive is passed over. Of more frames than it has room for, the firmware keeps the
 * newest, and an E-stop in any case. Returns 0.
 */
int32_t vibro_receive(vibro_firmware_state *state, int64_t frame_count, const vibro_word_frame *frames);

/* Let time pass, once in config->tick_s: `elapsed_ticks` is 1, and n + 1 after n missed periods. Returns how
 * often vibro_tick is to be called now. The firmware finds the frames that belong to each missed period.
 */
int32_t vibro_advance(const vibro_config *config, vibro_firmware_state *state, int64_t elapsed_ticks);

/* One control period. It allocates nothing, keeps nothing beside `state`, and reads no clock.
 * The first tx->frame_count (0 to 3) of tx->first, tx->second and tx->third are to be sent at once, in order.
 *
 * Returns 0; another number where the arithmetic failed, with `state` and `tx` unchanged: stop the drive.
 */
int32_t vibro_tick(const vibro_config *config, vibro_firmware_state *state, vibro_tx *tx);

/* Calibration over XCP: call it after a tick's frames have been sent, never while a tick runs. It processes
 * the write that the tick has received, if any. A commit changes the tuning parameters in `config` and the
 * constants that follow from them. Without it each write is refused, and `config` may be const. Returns 0.
 */
int32_t vibro_calibrate(vibro_config *config, vibro_firmware_state *state);

#ifdef __cplusplus
}
#endif
#endif
"""


CONFIG = """\
/* A config of the vibro-impact drive's controller, made by `vibrohil firmware build` of its parameters. */
#ifndef VIBRO_CONFIG_H
#define VIBRO_CONFIG_H

#include <math.h>

#include "vibro_firmware.h"

static const vibro_config VIBRO_CONFIG = {values};

#endif
"""


def config_header(config: Config, precision: Precision = "double") -> str:
    """The text of the header with a config's values, floats exact to the last bit.

    Members are given by their order, with their names in comments, and floats in decimal digits: C++ before
    2020 has no initializers by name, and before 2017 no hexadecimal floats.
    """
    return CONFIG.format(values=initializer(config, precision, ""))


def initializer(value: Any, precision: Precision, indent: str) -> str:
    """The C initializer of a record or of one of its members."""
    inner = indent + "    "
    if hasattr(value, "_fields"):
        members = zip(value._fields, value, strict=True)
        lines = "".join(
            f"{inner}/* {c_member(name)} */ {initializer(one, precision, inner)},\n" for name, one in members
        )
        return f"{{\n{lines}{indent}}}"
    if isinstance(value, tuple):
        return f"{{{', '.join(initializer(one, precision, inner) for one in value)}}}"
    if isinstance(value, float):
        if math.isnan(value):
            return "NAN"
        if precision == "single":
            value = round_to_single(value)
        digits = repr(value) + ("f" if precision == "single" else "")
        return digits if math.isfinite(value) else "INFINITY" if value > 0.0 else "-INFINITY"
    return str(value).lower() if isinstance(value, bool) else str(int(value))


def header(precision: Precision = "double") -> str:
    """The text of the header with the structs and the function."""
    found: dict[Any, None] = {}
    for record in RECORDS:
        for kind in list_needed(record):
            found[kind] = None
    blocks = [
        enum_text(kind) if issubclass(kind, IntEnum) else struct_text(kind, precision) for kind in found
    ]
    return "\n".join([TOP, *blocks, BOTTOM])


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
    """The name of a Python class in C.

    >>> c_name(FirmwareState)
    'vibro_firmware_state'
    """
    return "vibro_" + re.sub(r"(?<!^)(?=[A-Z])", "_", kind.__name__).lower()


def c_member(name: str) -> str:
    """The name of a member in C."""
    return f"{name}_" if name in CPP_KEYWORDS else name


def comment(kind: type) -> str:
    """The first paragraph of a class's docstring, as a C comment."""
    text = " ".join((inspect.getdoc(kind) or "").partition("\n\n")[0].split())
    return f"/* {text} */"


def enum_text(kind: type[IntEnum]) -> str:
    """The C declaration of an enum."""
    prefix = c_name(kind).upper()
    values = "\n".join(f"    {prefix}_{member.name} = {member.value}," for member in kind)
    return f"{comment(kind)}\nenum {c_name(kind)} {{\n{values}\n}};\n"


def struct_text(kind: Any, precision: Precision) -> str:
    """The C declaration of a record's struct, with a static assertion of its size."""
    lines = "\n".join(f"    {declaration(name, member, precision)}" for name, member in members(kind))
    name = c_name(kind)
    size = layout(kind, precision).itemsize
    return (
        f"{comment(kind)}\ntypedef struct {{\n{lines}\n}} {name};\n"
        f'VIBRO_HOLDS(sizeof({name}) == {size}, "{name} has another layout");\n'
    )


def declaration(name: str, kind: Any, precision: Precision) -> str:
    """The C declaration of a member."""
    if get_origin(kind) is tuple:
        items = get_args(kind)
        first, _, rest = declaration(f"{name}[{len(items)}]", items[0], precision).partition(";")
        return f"{first};{rest}"
    name = c_member(name)
    if kind is float:
        return f"{'double' if precision == 'double' else 'float'} {name};"
    if kind is bool:
        return f"bool {name};"
    if hasattr(kind, "_fields"):
        return f"{c_name(kind)} {name};"
    if kind is int:
        return f"int64_t {name};"
    return f"int64_t {name}; /* enum {c_name(kind)} */"
