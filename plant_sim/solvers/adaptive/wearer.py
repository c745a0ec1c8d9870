"""The wearer's foot plate: position p and velocity, m_f (p'' + a_b) = F_stop − k_a p − d_a p'.

Without a wearer the stop is fixed to the housing, and p = 0.
"""

import math

from plant_sim.jets import ROW, Jet, State, set_rate, square
from plant_sim.kernels import subroutine
from plant_sim.parts.parts import Parts
from plant_sim.parts.wearer import Ankle, is_worn


@subroutine(inline=True)
def from_stop_m(y: State) -> float:
    """The striker's position relative to the stop's position in the scene, m."""
    return y.depth_m + y.plate_m


@subroutine(inline=True)
def closing_m_s(y: State) -> float:
    """The striker's velocity relative to the stop's surface, m/s: the time derivative of depth."""
    return y.v_m_s - y.plate_m_s


@subroutine
def ankle_force_n(ankle: Ankle, place_m: float, velocity_m_s: float) -> float:
    """Force of spring and damper of the ankle on the wearer, N: k_a p + d_a p'."""
    return ankle.stiffness_n_per_m * place_m + ankle.damping_n_s_m * velocity_m_s


@subroutine
def felt_force_n(parts: Parts, y: State) -> float:
    """Force on the wearer, N."""
    return ankle_force_n(parts.wearer, y.plate_m, y.plate_m_s) if is_worn(parts.wearer) else 0.0


@subroutine
def plate_momentum_n_s(parts: Parts, y: State) -> float:
    """m_f p', N s."""
    wearer = parts.wearer
    return wearer.plate_kg * y.plate_m_s if is_worn(wearer) else 0.0


@subroutine
def plate_energy_j(parts: Parts, y: State) -> float:
    """Energy of plate and ankle spring, J."""
    wearer = parts.wearer
    if not is_worn(wearer):
        return 0.0
    p, v = y.plate_m, y.plate_m_s
    energy_j: float = 0.5 * (wearer.plate_kg * v * v + wearer.stiffness_n_per_m * p * p)
    return energy_j


@subroutine(inline=True)
def set_plate_rates(parts: Parts, jet: Jet, push_n: float, a_b: float, y: State) -> None:
    """Store the rates of the plate and the ankle's loss."""
    wearer = parts.wearer
    if not is_worn(wearer):
        return
    v = y.plate_m_s
    set_rate(jet, ROW.plate_m, v)
    set_rate(jet, ROW.plate_m_s, (push_n - felt_force_n(parts, y)) * (1.0 / wearer.plate_kg) - a_b)
    set_rate(jet, ROW.ankle_j, wearer.damping_n_s_m * square(jet, ROW.plate_m_s, v))


@subroutine
def ankle_s(parts: Parts) -> float:
    """Longest step for the ankle, s: a radian of its oscillation."""
    wearer = parts.wearer
    return math.sqrt(wearer.plate_kg / wearer.stiffness_n_per_m) if is_worn(wearer) else math.inf
