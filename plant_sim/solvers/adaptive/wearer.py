"""The wearer's foot plate: position p and velocity, m_f (p'' + a_b) = F_stop − k_a p − d_a p'.

Without a wearer the stop is fixed to the housing, and p = 0.
"""

import math

from plant_sim.kernels import by_part, subroutine
from plant_sim.parts.drive import Drive
from plant_sim.parts.parts import Parts
from plant_sim.parts.wearer import Ankle, Wearer
from plant_sim.solvers.adaptive.state_layout import Vector, ankle_place, plate_place
from plant_sim.solvers.bernstein import at


@by_part
def from_stop_m(wearer: Wearer, drive: Drive, y: Vector) -> float:
    """The striker's position relative to the stop's position in the scene, m."""
    depth_m: float = y[0]
    return depth_m


@from_stop_m.register(Ankle)
def _ankle_from_stop_m(wearer: Ankle, drive: Drive, y: Vector) -> float:
    place_m: float = y[0] + y[plate_place(drive)]
    return place_m


@by_part
def closing_m_s(wearer: Wearer, drive: Drive, y: Vector) -> float:
    """The striker's velocity relative to the stop's surface, m/s: the time derivative of depth."""
    v_m_s: float = y[1]
    return v_m_s


@closing_m_s.register(Ankle)
def _ankle_closing_m_s(wearer: Ankle, drive: Drive, y: Vector) -> float:
    v_m_s: float = y[1] - y[plate_place(drive) + 1]
    return v_m_s


@subroutine
def place_within(wearer: Wearer, drive: Drive, dense: Vector, out: Vector) -> None:
    """Bernstein coefficients of `from_stop_m` over a step, into `out`."""
    for i in range(out.size):
        out[i] = from_stop_m(wearer, drive, dense[:, i])


@by_part
def plate_at(wearer: Wearer, drive: Drive, dense: Vector, s: float) -> tuple[float, float]:
    """The plate's position, m, and velocity, m/s, within a step."""
    return 0.0, 0.0


@plate_at.register(Ankle)
def _ankle_plate_at(wearer: Ankle, drive: Drive, dense: Vector, s: float) -> tuple[float, float]:
    place = plate_place(drive)
    return at(dense[place], s), at(dense[place + 1], s)


@subroutine
def ankle_force_n(ankle: Ankle, place_m: float, velocity_m_s: float) -> float:
    """Force of spring and damper of the ankle on the wearer, N: k_a p + d_a p'."""
    return ankle.stiffness_n_per_m * place_m + ankle.damping_n_s_m * velocity_m_s


@by_part
def felt_force_n(wearer: Wearer, drive: Drive, y: Vector) -> float:
    """Force on the wearer, N."""
    return 0.0


@felt_force_n.register(Ankle)
def _ankle_felt_force_n(wearer: Ankle, drive: Drive, y: Vector) -> float:
    place = plate_place(drive)
    return ankle_force_n(wearer, y[place], y[place + 1])


@by_part
def plate_momentum_n_s(wearer: Wearer, drive: Drive, y: Vector) -> float:
    """m_f p', N s."""
    return 0.0


@plate_momentum_n_s.register(Ankle)
def _ankle_plate_momentum_n_s(wearer: Ankle, drive: Drive, y: Vector) -> float:
    momentum_n_s: float = wearer.plate_kg * y[plate_place(drive) + 1]
    return momentum_n_s


@by_part
def plate_energy_j(wearer: Wearer, drive: Drive, y: Vector) -> float:
    """Energy of plate and ankle spring, J."""
    return 0.0


@plate_energy_j.register(Ankle)
def _ankle_plate_energy_j(wearer: Ankle, drive: Drive, y: Vector) -> float:
    p, v = y[plate_place(drive)], y[plate_place(drive) + 1]
    energy_j: float = 0.5 * (wearer.plate_kg * v * v + wearer.stiffness_n_per_m * p * p)
    return energy_j


@by_part
def plate_derivative(wearer: Wearer, parts: Parts, push_n: float, a_b: float, y: Vector, out: Vector) -> None:
    """Fill in the plate's part of the derivative and the ankle's loss."""
    return


@plate_derivative.register(Ankle)
def _ankle_plate_derivative(
    wearer: Ankle, parts: Parts, push_n: float, a_b: float, y: Vector, out: Vector
) -> None:
    place = plate_place(parts.drive)
    v = y[place + 1]
    out[place] = v
    out[place + 1] = (push_n - felt_force_n(wearer, parts.drive, y)) / wearer.plate_kg - a_b
    out[ankle_place(parts)] = wearer.damping_n_s_m * v * v


@by_part
def ankle_s(wearer: Wearer) -> float:
    """Longest step for the ankle, s: a radian of its oscillation."""
    return math.inf


@ankle_s.register(Ankle)
def _plate_on_ankle_s(wearer: Ankle) -> float:
    return math.sqrt(wearer.plate_kg / wearer.stiffness_n_per_m)
