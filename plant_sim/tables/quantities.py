"""Physical quantities of a table's numbers: unit, range, and the reason for it. A field declares its own.

Each range exceeds the values of any module of this kind by orders of magnitude. Outside it, squares and
products overflow a double, or a solver would need an unbounded number of steps.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias, get_args

from pydantic.fields import FieldInfo


@dataclass(frozen=True, slots=True)
class Quantity:
    """Name and unit, smallest value if it must be above 0, largest magnitude, and the reason."""

    name: str
    unit: str
    smallest: float
    largest: float
    reason: str


NUMBER = Quantity("number", "", 1e-15, 1e9, "what has no unit: shares, ratios, exponents, counts")
SPEED = Quantity("speed", "m/s", 1e-15, 1e3, "three times the speed of sound")

Number: TypeAlias = Annotated[float, NUMBER]
Speed: TypeAlias = Annotated[float, SPEED]
NoiseDensity: TypeAlias = Annotated[
    float,
    Quantity("noise density", "m/s²/√Hz", 1e-9, 1e4, "from a seismometer's to more than any range"),
]
Acceleration: TypeAlias = Annotated[
    float, Quantity("acceleration", "m/s²", 1e-9, 1e6, "100,000 g: beyond what accelerometers survive")
]
Damping: TypeAlias = Annotated[
    float,
    Quantity("damping", "N s/m", 1e-9, 1e6, "an aperiodic striker of a tonne on a stiff spring has less"),
]
RotaryDamping: TypeAlias = Annotated[
    float, Quantity("rotary damping", "N m s", 1e-12, 1e3, "losses of motors from watches to ships")
]
TorqueConstant: TypeAlias = Annotated[
    float, Quantity("torque constant", "N m/A", 1e-6, 1e3, "motors from watches to ships")
]
Inertia: TypeAlias = Annotated[
    float, Quantity("inertia", "kg m²", 1e-10, 1e10, "from a watch's rotor to a wheel that nothing slows")
]
AngularSpeed: TypeAlias = Annotated[
    float,
    Quantity(
        "angular speed",
        "rad/s",
        1e-6,
        1e5,
        "a million turns a minute; work per simulated second grows with it",
    ),
]
Stiffness: TypeAlias = Annotated[
    float, Quantity("stiffness", "N/m", 1e-6, 1e10, "a spring of 1e10 N/m gives 0.1 nm to a newton")
]
PadStiffness: TypeAlias = Annotated[
    float, Quantity("stiffness of a pad", "N/m or N/m^1.5", 1e-3, 1e13, "a rigid stop serves beyond it")
]
Torque: TypeAlias = Annotated[float, Quantity("torque", "N m", 1e-6, 1e10, "no motor comes near it")]
Impulse: TypeAlias = Annotated[float, Quantity("impulse", "N s", 1e-9, 1e7, "no striker comes near it")]
Temperature: TypeAlias = Annotated[float, Quantity("temperature", "°C", 1e-9, 1e4, "motors have melted")]
Mass: TypeAlias = Annotated[float, Quantity("mass", "kg", 1e-6, 1e6, "from a milligram to a thousand tonnes")]
Frequency: TypeAlias = Annotated[
    float, Quantity("frequency", "Hz", 1e-6, 1e5, "work per simulated second grows with it")
]
Angle: TypeAlias = Annotated[
    float, Quantity("angle", "rad", 1e-12, 1e6, "an angle keeps ten digits below it")
]
Turns: TypeAlias = Annotated[float, Quantity("turns", "rev", 1e-9, 1e9, "an angle keeps six digits below it")]
Resistance: TypeAlias = Annotated[
    float, Quantity("resistance", "Ω", 1e-6, 1e6, "from a busbar to an insulator")
]
Inductance: TypeAlias = Annotated[
    float, Quantity("inductance", "H", 1e-9, 1e3, "from a wire to a transformer")
]
Voltage: TypeAlias = Annotated[float, Quantity("voltage", "V", 1e-6, 1e5, "from noise to a power line")]
Current: TypeAlias = Annotated[float, Quantity("current", "A", 1e-6, 1e6, "from noise to a lightning stroke")]
Length: TypeAlias = Annotated[float, Quantity("length", "m", 1e-9, 1e3, "from an atom's rows to a kilometre")]
WalkRatio: TypeAlias = Annotated[
    float, Quantity("walk ratio", "m s", 1e-9, 1e3, "people walk at 1 to 2, whatever their pace")
]
Duration: TypeAlias = Annotated[float, Quantity("duration", "s", 1e-9, 1e7, "from a nanosecond to months")]

LARGEST_SPEED_RAD_S = 1e5
"""Limit of crank speed and natural frequency; the solvers' work per simulated second grows with both."""


def quantity_of(field: FieldInfo) -> Quantity:
    """The quantity that a field declares; that of a plain int is `NUMBER`.

    >>> quantity_of(FieldInfo.from_annotation(Mass)).unit
    'kg'
    """
    return next(_quantities((field.annotation, *field.metadata)), NUMBER)


def is_undeclared(field: FieldInfo) -> bool:
    """Whether a field is a float without a quantity.

    >>> is_undeclared(FieldInfo.from_annotation(float))
    True
    """
    is_float = float in (field.annotation, *get_args(field.annotation))
    return is_float and next(_quantities((field.annotation, *field.metadata)), None) is None


def _quantities(marks: Iterable[Any]) -> Iterator[Quantity]:
    for mark in marks:
        if isinstance(mark, Quantity):
            yield mark
        else:
            yield from _quantities(get_args(mark))
