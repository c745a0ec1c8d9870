"""The variables of an FMU: the scene's keys as parameters with units and bounds, and CAN frames.

A group of frames is a count, and four 32-bit integers a frame.
"""

import math
from collections.abc import Iterator
from typing import Literal, NamedTuple

from pydantic.fields import FieldInfo

from plant_sim.tables.quantities import Quantity, quantity_of
from plant_sim.tables.table import Table
from text_input import RefusalError

Role = Literal["input", "output", "fixed", "tunable"]
"""`fixed` and `tunable` are parameters; the master may change tunable ones between two steps."""

FMI_SIGNS = str.maketrans({" ": ".", "²": "2", "Ω": "Ohm"})
"""How FMI writes the signs in a quantity's unit."""
UNITS = {
    "_m_s2_rthz": ("m/s2/Hz0.5", ""),  # FMI has whole exponents only
    "_n_s_m": ("N.s/m", 'kg="1" s="-1"'),
    "_n_m_s": ("N.m.s", 'kg="1" m="2" s="-1"'),
    "_n_m_a": ("N.m/A", 'kg="1" m="2" s="-2" A="-1"'),
    "_kg_m2": ("kg.m2", 'kg="1" m="2"'),
    "_rad_s": ("rad/s", 's="-1" rad="1"'),
    "_rev_s": ("rev/s", 's="-1" rad="1" factor="6.283185307179586"'),
    "_m_s2": ("m/s2", 'm="1" s="-2"'),
    "_n_s": ("N.s", 'kg="1" m="1" s="-1"'),
    "_m_s": ("m/s", 'm="1" s="-1"'),
    "torque_n_m": ("N.m", 'kg="1" m="2" s="-2"'),
    "dry_n_m": ("N.m", 'kg="1" m="2" s="-2"'),
    "_n_m": ("N/m", 'kg="1" s="-2"'),
    "_rad": ("rad", 'rad="1"'),
    "_rev": ("rev", 'rad="1" factor="6.283185307179586"'),
    "_ohm": ("Ohm", 'kg="1" m="2" s="-3" A="-2"'),
    "_kg": ("kg", 'kg="1"'),
    "_hz": ("Hz", 's="-1"'),
    "_n": ("N", 'kg="1" m="1" s="-2"'),
    "_j": ("J", 'kg="1" m="2" s="-2"'),
    "_h": ("H", 'kg="1" m="2" s="-2" A="-2"'),
    "_v": ("V", 'kg="1" m="2" s="-3" A="-1"'),
    "_a": ("A", 'A="1"'),
    "_m": ("m", 'm="1"'),
    "_s": ("s", 's="1"'),
}
"""Units by the end of a name, with their base units as FMI writes them. The first that fits applies."""
NO_KEYS = ("axis", "gait", "sensors.coarse", "sensors.gait", "sensors.rigid_contact_s")
"""Keys that are no parameters: the drive is configured and strides are sampled when the FMU is
built, and no variable has the others."""
MOST_RECEIVED = 8
"""Frames to a node in one step; no node of the bench receives more in a tick."""
LOW, HIGH = -(2.0**31), 2.0**31 - 1.0
FIXED = ("initial.", "solver.", "sensors.", "drive.phase_rad")


class FmuError(RefusalError, ValueError):
    """An FMU that cannot be built; the message names the remedy."""


class Variable(NamedTuple):
    """A variable of an FMU; its value reference is its place among them."""

    name: str
    role: Role
    description: str = ""
    start: float = 0.0
    low: float = -math.inf
    high: float = math.inf
    is_integer: bool = False
    quantity: Quantity | None = None
    """Of a scene's key."""

    @property
    def unit(self) -> str | None:
        """The unit: of a scene's key as declared, of others by the end of the name; None without one."""
        if self.quantity is not None:
            unit = self.quantity.unit.translate(FMI_SIGNS).replace("√Hz", "Hz0.5")
            return unit if unit in dict(UNITS.values()) else None
        return next((unit for suffix, (unit, _) in UNITS.items() if self.name.endswith(suffix)), None)


def parameters(scene: Table, prefix: str = "") -> Iterator[Variable]:
    """The keys of a scene that are numbers, with the bounds of their tables.

    Names, counts and absent keys determine which parts there are, and the arrays of the FMU; they stay.
    """
    for key, field in type(scene).model_fields.items():
        value, name = getattr(scene, key), f"{prefix}{key}"
        if name in NO_KEYS:
            continue
        if isinstance(value, Table):
            yield from parameters(value, f"{name}.")
        elif isinstance(value, float):
            role: Role = "fixed" if name.startswith(FIXED) else "tunable"
            yield Variable(
                name, role, field.description or "", value, *bounds(field), quantity=quantity_of(field)
            )


def bounds(field: FieldInfo) -> tuple[float, float]:
    """The smallest and largest value of a key, from its quantity and the marks of its field."""
    quantity = quantity_of(field)
    low, high = -quantity.largest, quantity.largest
    for mark in field.metadata:
        if getattr(mark, "gt", None) == 0.0:
            low = quantity.smallest
        low = max(low, getattr(mark, "ge", low))
        high = min(high, getattr(mark, "le", high))
        high = min(high, math.nextafter(getattr(mark, "lt", math.inf), -math.inf))
    return low, high


def frame_places(variables: list[Variable]) -> str:
    """Where frames are among the variables, for `model.h`."""
    names = [one.name for one in variables]
    received, sent = names.index("received.count"), names.index("sent.count")
    most_sent = sum(one.startswith("sent[") and one.endswith(".id") for one in names)
    places = f"RECEIVED = {received}, MOST_RECEIVED = {MOST_RECEIVED}, SENT = {sent}, MOST_SENT = {most_sent}"
    return f"enum {{ {places} }};"


def frame_variables(direction: str, role: Role, most: int) -> list[Variable]:
    """The variables of the frames that arrive in a step (`received`) or leave in it (`sent`)."""
    variables = [
        Variable(f"{direction}.count", role, f"number of frames {direction}", 0.0, 0.0, most, is_integer=True)
    ]
    for place in range(most):
        name = f"{direction}[{place}]"
        variables += [
            Variable(f"{name}.id", role, "11-bit identifier", 0.0, 0.0, 2047.0, is_integer=True),
            Variable(f"{name}.length", role, "number of bytes", 0.0, 0.0, 8.0, is_integer=True),
            Variable(f"{name}.low", role, "bytes 0 to 3, the first lowest", 0.0, LOW, HIGH, is_integer=True),
            Variable(f"{name}.high", role, "bytes 4 to 7, the first lowest", 0.0, LOW, HIGH, is_integer=True),
        ]
    return variables
