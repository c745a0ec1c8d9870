"""The nominal stop at the start of a contact: a Hertz contact with Hunt–Crossley's damping.

    a(t) = growth · (x'⁻ t)^1.5

For another stop, replace `contact_growth` and its inverse `contact_age_s`, and `depth_at_end_m`.
"""

import math

from firmware_py.core.elementary import cube_root
from firmware_py.core.numbers import at_least

REFERENCE_M_S = 0.9
"""Touch-down speed to which the contact time refers."""
END_FRACTION = 0.02
"""Share of the peak below which a contact has ended."""
LEAST_RESTITUTION = 1e-3
"""A smaller restitution counts as this one, because d of 0 would be infinite."""


def excess_of_dissipation(d: float, k: float) -> float:
    """The difference of the two sides of the equation in `hertz_dissipation`."""
    return (d - math.log1p(d)) - (-k * d - math.log1p(-k * d))


def hertz_dissipation(restitution: float) -> float:
    """d = λ x'⁻ of a Hunt–Crossley stop with this restitution k: d − ln(1 + d) = −k d − ln(1 − k d)."""
    if restitution >= 1.0:
        return 0.0
    k = at_least(restitution, LEAST_RESTITUTION)
    low, high = 1e-9, (1.0 - 1e-12) / k
    for _ in range(200):
        middle = 0.5 * (low + high)
        if excess_of_dissipation(middle, k) > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def elastic_depth_m(contact_s: float) -> float:
    """δ_max of an elastic Hertz contact of this duration at the reference speed: 2.9432 δ_max/x'⁻ = t."""
    return contact_s * REFERENCE_M_S / 2.9432


def depth_at_end_m(contact_s: float, restitution: float, share: float) -> float:
    """How deep the striker still is when the stop's force has fallen to a share of that of δ_max.

    Near the separation F = K δ^1.5 (1 − k d), which for a small k is almost zero before the striker is out.
    """
    left = 1.0 - at_least(restitution, LEAST_RESTITUTION) * hertz_dissipation(restitution)
    root = cube_root(min(share / at_least(left, share), 1.0))
    return elastic_depth_m(contact_s) * root * root


def contact_growth(mass_kg: float, contact_s: float, restitution: float) -> float:
    """`growth` of a(t) = growth · (x'⁻ t)^1.5 at the start of a contact, m/s² per m^1.5.

    Hertz: δ_max = (5 m x'⁻²/(4 K))^(2/5).
    """
    deepest_m = elastic_depth_m(contact_s)
    stiffness = 1.25 * mass_kg * REFERENCE_M_S * REFERENCE_M_S / math.pow(deepest_m, 2.5)
    return stiffness / mass_kg * (1.0 + hertz_dissipation(restitution))


def contact_age_s(growth: float, excess_m_s2: float, approach_speed_m_s: float) -> float:
    """The time since the touch-down after which the stop accelerates the striker by `excess_m_s2`."""
    root = cube_root(excess_m_s2 / growth)
    return root * root / approach_speed_m_s
