"""The wearer's foot plate: position p and velocity, m_f (p'' + a_b) = F_stop − k_a p − d_a p'.

Without a wearer the stop is fixed to the housing, and p = 0.
"""

import math

from plant_sim.kernels import subroutine
from plant_sim.parts.parts import Parts
from plant_sim.parts.wearer import Ankle, is_worn
from plant_sim.solvers.adaptive.state_layout import Vector, ankle_place, plate_place
from plant_sim.solvers.bernstein import at


@subroutine(inline=True)
def from_stop_m(parts: Parts, y: Vector) -> float:
    """The striker's position relative to the stop's position in the scene, m."""
    place_m: float = y[0]
    return place_m + y[plate_place(parts.drive)] if is_worn(parts.wearer) else place_m


@subroutine(inline=True)
def closing_m_s(parts: Parts, y: Vector) -> float:
    """The striker's velocity relative to the stop's surface, m/s: the time derivative of depth."""
    v_m_s: float = y[1]
    return v_m_s - y[plate_place(parts.drive) + 1] if is_worn(parts.wearer) else v_m_s


@subroutine
def place_within(parts: Parts, dense: Vector, out: Vector) -> None:
    """Bernstein coefficients of `from_stop_m` over a step, into `out`."""
    for i in range(out.size):
        out[i] = from_stop_m(parts, dense[:, i])


@subroutine(inline=True)
def plate_at(parts: Parts, dense: Vector, s: float) -> tuple[float, float]:
    """The plate's position, m, and velocity, m/s, within a step."""
    if not is_worn(parts.wearer):
        return 0.0, 0.0
    place = plate_place(parts.drive)
    return at(dense[place], s), at(dense[place + 1], s)


@subroutine
def ankle_force_n(ankle: Ankle, place_m: float, velocity_m_s: float) -> float:
    """Force of spring and damper of the ankle on the wearer, N: k_a p + d_a p'."""
    return ankle.stiffness_n_per_m * place_m + ankle.damping_n_s_m * velocity_m_s


@subroutine
def felt_force_n(parts: Parts, y: Vector) -> float:
    """Force on the wearer, N."""
    wearer, place = parts.wearer, plate_place(parts.drive)
    return ankle_force_n(wearer, y[place], y[place + 1]) if is_worn(wearer) else 0.0


@subroutine
def plate_momentum_n_s(parts: Parts, y: Vector) -> float:
    """m_f p', N s."""
    wearer = parts.wearer
    return wearer.plate_kg * y[plate_place(parts.drive) + 1] if is_worn(wearer) else 0.0


@subroutine
def plate_energy_j(parts: Parts, y: Vector) -> float:
    """Energy of plate and ankle spring, J."""
    wearer, place = parts.wearer, plate_place(parts.drive)
    if not is_worn(wearer):
        return 0.0
    p, v = y[place], y[place + 1]
    energy_j: float = 0.5 * (wearer.plate_kg * v * v + wearer.stiffness_n_per_m * p * p)
    return energy_j


@subroutine(inline=True)
def plate_derivative(parts: Parts, push_n: float, a_b: float, y: Vector, out: Vector) -> None:
    """Fill in the plate's part of the derivative and the ankle's loss."""
    wearer = parts.wearer
    if not is_worn(wearer):
        return
    place = plate_place(parts.drive)
    v = y[place + 1]
    out[place] = v
    out[place + 1] = (push_n - felt_force_n(parts, y)) / wearer.plate_kg - a_b
    out[ankle_place(parts)] = wearer.damping_n_s_m * v * v


@subroutine
def ankle_s(parts: Parts) -> float:
    """Longest step for the ankle, s: a radian of its oscillation."""
    wearer = parts.wearer
    return math.sqrt(wearer.plate_kg / wearer.stiffness_n_per_m) if is_worn(wearer) else math.inf
