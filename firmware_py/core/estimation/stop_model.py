"""The nominal stop at the start of a contact: a Hertz contact with Hunt–Crossley's damping.

    a(t) = growth · (x'⁻ t)^1.5

For another stop, replace `contact_growth` and its inverse `contact_age_s`.
"""

import math

from firmware_py.core.elementary import cube_root
from firmware_py.core.numbers import at_least

REFERENCE_M_S = 0.9
"""Touch-down speed to which the contact time refers."""


def excess_of_dissipation(d: float, k: float) -> float:
    """The difference of the two sides of the equation in `hertz_dissipation`."""
    return (d - math.log1p(d)) - (-k * d - math.log1p(-k * d))


def hertz_dissipation(restitution: float) -> float:
    """d = λ x'⁻ of a Hunt–Crossley stop with this restitution k: d − ln(1 + d) = −k d − ln(1 − k d)."""
    if restitution >= 1.0:
        return 0.0
    k = at_least(restitution, 1e-3)
    low, high = 1e-9, (1.0 - 1e-12) / k
    for _ in range(200):
        middle = 0.5 * (low + high)
        if excess_of_dissipation(middle, k) > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def contact_growth(mass_kg: float, contact_s: float, restitution: float) -> float:
    """`growth` of a(t) = growth · (x'⁻ t)^1.5 at the start of a contact, m/s² per m^1.5.

    Hertz: the elastic contact lasts 2.9432 δ_max/x'⁻ with δ_max = (5 m x'⁻²/(4 K))^(2/5).
    """
    deepest_m = contact_s * REFERENCE_M_S / 2.9432
    stiffness = 1.25 * mass_kg * REFERENCE_M_S * REFERENCE_M_S / math.pow(deepest_m, 2.5)
    return stiffness / mass_kg * (1.0 + hertz_dissipation(restitution))


def contact_age_s(growth: float, excess_m_s2: float, approach_speed_m_s: float) -> float:
    """The time since the touch-down after which the stop accelerates the striker by `excess_m_s2`."""
    root = cube_root(excess_m_s2 / growth)
    return root * root / approach_speed_m_s
