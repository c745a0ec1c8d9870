"""Ranges of a scene's numbers, by the unit at the end of the key.

Each range exceeds the values of any module of this kind by orders of magnitude. Outside it, squares and
products overflow a double, or a solver would need an unbounded number of steps.
"""

from typing import NamedTuple


class Quantity(NamedTuple):
    """Unit as a suffix of keys, smallest value if it must be above 0, largest magnitude, and the reason."""

    suffix: str
    smallest: float
    largest: float
    reason: str


QUANTITIES = (
    Quantity("_m_s2_rthz", 1e-9, 1e4, "noise densities, from a seismometer's to more than any range"),
    Quantity("_m_s2", 1e-9, 1e6, "100,000 g: beyond what accelerometers survive"),
    Quantity("_n_s_m", 1e-9, 1e6, "an aperiodic striker of a tonne on a stiff spring has less"),
    Quantity("_n_m_s", 1e-12, 1e3, "losses of motors from watches to ships"),
    Quantity("_n_m_a", 1e-6, 1e3, "torque constants of motors from watches to ships"),
    Quantity("_kg_m2", 1e-10, 1e10, "from a watch's rotor to a wheel that nothing slows"),
    Quantity("_rad_s", 1e-6, 1e5, "a million turns a minute; work per simulated second grows with it"),
    Quantity("_m_s", 1e-15, 1e3, "three times the speed of sound"),
    Quantity("_n_m", 1e-6, 1e10, "a spring of 1e10 N/m gives 0.1 nm to a newton; a torque never comes near"),
    Quantity("stiffness", 1e-3, 1e13, "a rigid stop serves beyond it"),
    Quantity("_degc", 1e-9, 1e4, "motors have melted"),
    Quantity("_kg", 1e-6, 1e6, "from a milligram to a thousand tonnes"),
    Quantity("_hz", 1e-6, 1e5, "work per simulated second grows with it"),
    Quantity("_rad", 1e-12, 1e6, "an angle keeps ten digits below it"),
    Quantity("_rev", 1e-9, 1e9, "an angle keeps six digits below it"),
    Quantity("_ohm", 1e-6, 1e6, "from a busbar to an insulator"),
    Quantity("_h", 1e-9, 1e3, "from a wire to a transformer"),
    Quantity("_v", 1e-6, 1e5, "from noise to a power line"),
    Quantity("_a", 1e-6, 1e6, "from noise to a lightning stroke"),
    Quantity("_m", 1e-9, 1e3, "from an atom's rows to a kilometre"),
    Quantity("_s", 1e-9, 1e7, "from a nanosecond to months"),
    Quantity("", 1e-15, 1e9, "what has no unit: shares, ratios, exponents, counts"),
)
"""The first one whose unit fits applies."""

LARGEST_SPEED_RAD_S = 1e5
"""Limit of crank speed and natural frequency; the solvers' work per simulated second grows with both."""


def quantity_of(key: str) -> Quantity:
    """The quantity of a key.

    >>> quantity_of("mass_kg").largest
    1000000.0
    """
    return next(quantity for quantity in QUANTITIES if key.endswith(quantity.suffix))
