"""The striker: a mass on the coupling spring."""

import math
from typing import NamedTuple

from pydantic import Field

from plant_sim.kernels import subroutine
from plant_sim.tables.quantities import Acceleration, Length, Mass, Stiffness
from plant_sim.tables.table import STANDARD_GRAVITY_M_S2, Table


class Striker(NamedTuple):
    """m_B x'' + c (x − l0 − x_A) = F_f + F_stop.

    `gravity_m_s2` is gravity across the axis, which presses on the guide: it enters dry friction only.
    """

    mass_kg: float
    spring_n_per_m: float
    rest_length_m: float
    gravity_m_s2: float


@subroutine
def has_linear_spring(striker: Striker) -> bool:
    """Whether the spring's force is proportional to its stretch, as in a Taylor series."""
    return True


@subroutine
def spring_force_n(striker: Striker, stretch_m: float) -> float:
    """Force, N, of the coupling spring along +x, stretched by x_A + l0 − x."""
    return striker.spring_n_per_m * stretch_m


@subroutine
def spring_energy_j(striker: Striker, stretch_m: float) -> float:
    """Energy, J, in the coupling spring."""
    return 0.5 * striker.spring_n_per_m * stretch_m * stretch_m


@subroutine
def spring_stretch_m(striker: Striker, force_n: float) -> float:
    """Stretch, m, of the coupling spring under a force."""
    return force_n / striker.spring_n_per_m


class StrikerTable(Table):
    """The striker on its coupling spring."""

    mass_kg: Mass = Field(gt=0.0, description="the striker's mass in kg")
    spring_n_m: Stiffness = Field(gt=0.0, description="the coupling spring's stiffness in N/m")
    rest_length_m: Length = Field(description="the striker's position in m where the spring is relaxed")
    gravity_m_s2: Acceleration = Field(
        default=STANDARD_GRAVITY_M_S2,
        ge=0.0,
        description="gravity in m/s² (it enters dry friction, and the motion where the housing is tilted)",
    )

    def part(self, tilt_rad: float) -> Striker:
        """The striker in a housing whose axis rises by this angle towards the stop."""
        across_m_s2 = self.gravity_m_s2 * math.cos(tilt_rad)
        return Striker(self.mass_kg, self.spring_n_m, self.rest_length_m, across_m_s2)
