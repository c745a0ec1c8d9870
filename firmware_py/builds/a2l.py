"""The A2L file (ASAM MCD-2 MC, ASAP2 1.71) of the firmware, for any master of XCP.

It is made of the tables that the firmware itself uses: the state's members (`node.elements`), the parameters
(`parameters.toml`) and the frames (`vibro.dbc`). The addresses are those of `node.xcp`, equal in all builds.
"""

from enum import IntEnum

from firmware_py.builds.c99.header import TEMPLATES
from firmware_py.interface.addresses import DEFAULT, Addresses, bus_id
from firmware_py.interface.enums import XcpCommandCode
from firmware_py.interface.generated import kinds
from firmware_py.interface.parameter_table import TABLE, Parameter
from firmware_py.node import xcp
from firmware_py.node.elements import ALL, Element
from firmware_py.node.memory import file_name

FLOAT32_MAX = 3.4028235e38
TICK_S = 0.001
"""The control period on CAN."""
MANDATORY = ("CONNECT", "DISCONNECT", "GET_STATUS", "SYNCH")

UNITS = {
    "_rad_s2": "rad/s^2",
    "_rad_s": "rad/s",
    "_m_s2": "m/s^2",
    "_m_s": "m/s",
    "_1_s": "1/s",
    "_n_m_s": "N m s",
    "_n_m": "N m",
    "_n_s": "N s",
    "_kg_m2": "kg m^2",
    "_rev_s": "rev/s",
    "_rev": "rev",
    "_rad": "rad",
    "_degc": "degC",
    "_deg": "deg",
    "_kg": "kg",
    "_hz": "Hz",
    "_us": "us",
    "_ns": "ns",
    "_m": "m",
    "_n": "N",
    "_j": "J",
    "_s": "s",
    "_a": "A",
    "_v": "V",
}
"""The unit of a name's end, longer ends first."""


def unit_of(name: str) -> str:
    """The unit of a quantity's name, "" without one.

    >>> unit_of("state.crank.omega_rad_s"), unit_of("state.start.stage")
    ('rad/s', '')
    """
    ends = sorted(UNITS, key=len, reverse=True)
    return next((UNITS[end] for end in ends if name.rpartition(".")[2].endswith(end)), "")


def a2l_name(name: str) -> str:
    """A name as an identifier of A2L, in which an index stands in brackets.

    >>> a2l_name("waiting.answers.0.value")
    'waiting.answers[0].value'
    """
    first, *rest = name.split(".")
    return first + "".join(f"[{part}]" if part.isdecimal() else f".{part}" for part in rest)


def quote(text: str) -> str:
    """A string of A2L."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def conversion_of(unit: str) -> str:
    """The name of the conversion that only states a unit, its own for each.

    >>> conversion_of("N m"), conversion_of("N/m")
    ('unit_N_m', 'unit_N_per_m')
    """
    words = (unit or "none").replace("/", "_per_")
    return "unit_" + "".join(letter if letter.isalnum() else "_" for letter in words)


def unit_text(parameter: Parameter) -> str:
    """A parameter's unit, "" without one."""
    return "" if parameter.unit == "1" else parameter.unit


def kind_and_conversion(element: Element) -> str:
    """A measurement's type and the conversion that states its unit or its names."""
    if element.kind is float:
        return f"FLOAT32_IEEE {conversion_of(unit_of(element.name))}"
    is_enum = issubclass(element.kind, IntEnum)
    return f"SLONG {element.kind.__name__ if is_enum else conversion_of(unit_of(element.name))}"


def a2l(module: Addresses = DEFAULT) -> str:
    """The text of the file for a module with these node numbers; its name is `file_name()` and `.a2l`."""
    enums = {one.kind.__name__: one.kind for one in ALL if issubclass(one.kind, IntEnum)}
    return TEMPLATES.get_template("vibro.a2l.j2").render(
        conversion=conversion_of,
        quote=quote,
        a2l_name=a2l_name,
        unit=unit_text,
        kind_and_conversion=kind_and_conversion,
        file_name=file_name(),
        commands=[code for code in XcpCommandCode if code.name not in MANDATORY],
        xcp=xcp,
        units=round(TICK_S / xcp.TIMESTAMP_UNIT_S),
        master=bus_id(module, kinds.XCP_COMMAND.can_id),
        slave=bus_id(module, kinds.XCP_RESPONSE.can_id),
        units_of_all=sorted({unit_of(one.name) for one in ALL} | {unit_text(one) for one in TABLE}),
        enums=[enums[name] for name in sorted(enums)],
        measurements=ALL,
        parameters=TABLE,
        float=float,
        float32_max=FLOAT32_MAX,
        int32_bounds=f"{-(2**31)} {2**31 - 1}",
    )
