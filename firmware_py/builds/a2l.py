"""The A2L file (ASAM MCD-2 MC, ASAP2 1.71) of the firmware, for any master of XCP.

It is made of the tables that the firmware itself uses: the state's members (`node.elements`), the parameters
(`parameters.toml`) and the frames (`vibro.dbc`). The addresses are those of `node.xcp`, equal in all builds.
"""

from collections.abc import Iterable, Iterator
from enum import IntEnum

from firmware_py.interface.addresses import DEFAULT, Addresses, bus_id
from firmware_py.interface.enums import XcpCommandCode
from firmware_py.interface.generated import kinds
from firmware_py.interface.parameter_table import TABLE, Parameter
from firmware_py.node import xcp
from firmware_py.node.elements import ALL, Element
from firmware_py.node.memory import file_name

FLOAT32_MAX, INT32_MIN, INT32_MAX = 3.4028235e38, -(2**31), 2**31 - 1
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

A2ML = """\
    /begin A2ML
      block "IF_DATA" taggedunion if_data {
        "XCP" struct {
          taggedstruct {
            block "PROTOCOL_LAYER" struct {
              uint; uint; uint; uint; uint; uint; uint; uint; uchar; uint;
              enum { "BYTE_ORDER_MSB_LAST" = 0, "BYTE_ORDER_MSB_FIRST" = 1 };
              enum { "ADDRESS_GRANULARITY_BYTE" = 1 };
              taggedstruct { ("OPTIONAL_CMD" enum { %(commands)s })*; };
            };
            block "DAQ" struct {
              enum { "STATIC" = 0, "DYNAMIC" = 1 };
              uint; uint; uchar;
              enum { "OPTIMISATION_TYPE_DEFAULT" = 0 };
              enum { "ADDRESS_EXTENSION_FREE" = 0 };
              enum { "IDENTIFICATION_FIELD_TYPE_ABSOLUTE" = 0 };
              enum { "GRANULARITY_ODT_ENTRY_SIZE_DAQ_DWORD" = 4 };
              uchar;
              enum { "NO_OVERLOAD_INDICATION" = 0 };
              taggedstruct {
                "PRESCALER_SUPPORTED";
                block "TIMESTAMP_SUPPORTED" struct {
                  uint;
                  enum { "SIZE_WORD" = 2 };
                  enum { "UNIT_10US" = 4 };
                };
                (block "EVENT" struct {
                  char[101]; char[9]; uint;
                  enum { "DAQ" = 1 };
                  uchar; uchar; uchar; uchar;
                })*;
              };
            };
          };
          taggedstruct {
            block "XCP_ON_CAN" struct {
              uint;
              taggedstruct {
                "CAN_ID_MASTER" ulong;
                "CAN_ID_SLAVE" ulong;
                "BAUDRATE" ulong;
                "MAX_DLC_REQUIRED";
              };
            };
          };
        };
      };
    /end A2ML
"""

IF_DATA = """\
    /begin IF_DATA XCP
      /begin PROTOCOL_LAYER
        0x0100 1000 1000 1000 1000 1000 1000 1000 8 8 BYTE_ORDER_MSB_LAST ADDRESS_GRANULARITY_BYTE
%(commands)s
      /end PROTOCOL_LAYER
      /begin DAQ
        DYNAMIC %(lists)d 1 0 OPTIMISATION_TYPE_DEFAULT ADDRESS_EXTENSION_FREE
        IDENTIFICATION_FIELD_TYPE_ABSOLUTE GRANULARITY_ODT_ENTRY_SIZE_DAQ_DWORD 4 NO_OVERLOAD_INDICATION
        PRESCALER_SUPPORTED
        /begin TIMESTAMP_SUPPORTED %(units)d SIZE_WORD UNIT_10US /end TIMESTAMP_SUPPORTED
        /begin EVENT "tick" "tick" 0 DAQ %(lists)d %(units)d 4 0 /end EVENT
      /end DAQ
      /begin XCP_ON_CAN
        0x0100
        CAN_ID_MASTER 0x%(master)03X
        CAN_ID_SLAVE 0x%(slave)03X
        BAUDRATE 1000000
        MAX_DLC_REQUIRED
      /end XCP_ON_CAN
    /end IF_DATA
"""


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


def conversions() -> Iterator[str]:
    """Conversions: one for each unit and one for each enum."""
    for unit in sorted({unit_of(one.name) for one in ALL} | {unit_text(one) for one in TABLE}):
        method = f'{conversion_of(unit)} "" IDENTICAL "%9.6" {quote(unit)}'
        yield f"    /begin COMPU_METHOD {method} /end COMPU_METHOD"
    enums = {one.kind.__name__: one.kind for one in ALL if issubclass(one.kind, IntEnum)}
    for name, kind in sorted(enums.items()):
        values = "\n".join(f"        {member.value} {quote(member.name)}" for member in kind)
        method = f'{name} "" TAB_VERB "%4.0" "" COMPU_TAB_REF {name}_names'
        yield (
            f"    /begin COMPU_METHOD {method} /end COMPU_METHOD\n"
            f'    /begin COMPU_VTAB {name}_names "" TAB_VERB {len(kind)}\n{values}\n    /end COMPU_VTAB'
        )


def unit_text(parameter: Parameter) -> str:
    """A parameter's unit, "" without one."""
    return "" if parameter.unit == "1" else parameter.unit


def measurement(index: int, element: Element) -> str:
    """One measurement."""
    kind, bounds, conversion = "FLOAT32_IEEE", f"{-FLOAT32_MAX:.7e} {FLOAT32_MAX:.7e}", ""
    if element.kind is not float:
        kind, bounds = "SLONG", f"{INT32_MIN} {INT32_MAX}"
        conversion = element.kind.__name__ if issubclass(element.kind, IntEnum) else ""
    conversion = conversion or conversion_of(unit_of(element.name))
    return (
        f'    /begin MEASUREMENT {a2l_name(element.name)} "" {kind} {conversion} 0 0 {bounds}\n'
        f"      ECU_ADDRESS 0x{xcp.ELEMENT_BYTES * index:X}"
        f" ECU_ADDRESS_EXTENSION {xcp.MEASUREMENTS}\n"
        "    /end MEASUREMENT"
    )


def characteristic(index: int, parameter: Parameter) -> str:
    """One parameter; those that are never written over the bus are read-only."""
    read_only = "" if parameter.is_calibrated else " READ_ONLY"
    return (
        f"    /begin CHARACTERISTIC {parameter.name} {quote(parameter.meaning)} VALUE "
        f"0x{xcp.ELEMENT_BYTES * index:X} layout_float32 0 {conversion_of(unit_text(parameter))} "
        f"{parameter.low!r} {parameter.high!r}\n"
        f"      ECU_ADDRESS_EXTENSION {xcp.CHARACTERISTICS}{read_only}\n"
        "    /end CHARACTERISTIC"
    )


COMMIT = f"""\
    /begin CHARACTERISTIC calibration.commit "1 applies all staged values together" VALUE
      0x{xcp.ELEMENT_BYTES * xcp.COMMIT:X} layout_ulong 0 unit_none 0 1
      ECU_ADDRESS_EXTENSION {xcp.CHARACTERISTICS}
    /end CHARACTERISTIC"""


def a2l(module: Addresses = DEFAULT) -> str:
    """The text of the file for a module with these node numbers; its name is `file_name()` and `.a2l`."""
    optional = [code for code in XcpCommandCode if code.name not in MANDATORY]
    commands = ", ".join(f'"{code.name}" = 0x{code.value:02X}' for code in optional)
    used = "\n".join(f"        OPTIONAL_CMD {code.name}" for code in optional)
    interface = IF_DATA % {
        "commands": used,
        "lists": xcp.MOST_LISTS,
        "units": round(TICK_S / xcp.TIMESTAMP_UNIT_S),
        "master": bus_id(module, kinds.XCP_COMMAND.can_id),
        "slave": bus_id(module, kinds.XCP_RESPONSE.can_id),
    }
    blocks: Iterable[str] = (
        *conversions(),
        "    /begin RECORD_LAYOUT layout_float32 FNC_VALUES 1 FLOAT32_IEEE ROW_DIR DIRECT /end RECORD_LAYOUT",
        "    /begin RECORD_LAYOUT layout_ulong FNC_VALUES 1 ULONG ROW_DIR DIRECT /end RECORD_LAYOUT",
        *(measurement(index, element) for index, element in enumerate(ALL)),
        *(characteristic(index, parameter) for index, parameter in enumerate(TABLE)),
        COMMIT,
    )
    return (
        "ASAP2_VERSION 1 71\n"
        '/begin PROJECT vibro "vibro-impact drive"\n'
        f'  /begin MODULE {file_name()} "the controller"\n'
        + A2ML % {"commands": commands}
        + '    /begin MOD_COMMON "" BYTE_ORDER MSB_LAST /end MOD_COMMON\n'
        + interface
        + "\n".join(blocks)
        + "\n  /end MODULE\n/end PROJECT\n"
    )
