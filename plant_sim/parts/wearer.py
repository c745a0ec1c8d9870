"""The wearer behind the stop: a foot plate on the ankle, which yields under an impact.

m_f p'' = F_stop − k_a p − d_a p' (− m_f a_b), with p the displacement of the plate from the stop's position
in the scene. The law of the stop holds between striker and plate. The felt force is k_a p + d_a p'. The plate
starts at rest at the equilibrium under the constant part of a_b.
"""

from typing import NamedTuple, TypeAlias

from pydantic import Field

from plant_sim.kernels import by_part, one_of
from plant_sim.tables.quantities import Damping, Mass, Stiffness
from plant_sim.tables.table import Table


class NoWearer(NamedTuple):
    """The stop is fixed to the housing."""


class Ankle(NamedTuple):
    """Foot plate and ankle as one mass on a spring and a damper (Kelvin–Voigt)."""

    plate_kg: float
    stiffness_n_per_m: float
    damping_n_s_m: float


Wearer: TypeAlias = NoWearer | Ankle


is_worn = one_of(Ankle)
"""Whether the stop rests on a wearer."""


@by_part
def contact_mass_kg(wearer: Wearer, striker_kg: float) -> float:
    """Effective mass of a contact: the striker's, or the reduced mass of striker and plate."""
    return striker_kg


@contact_mass_kg.register(Ankle)
def _ankle_contact_mass_kg(wearer: Ankle, striker_kg: float) -> float:
    return striker_kg * wearer.plate_kg / (striker_kg + wearer.plate_kg)


@by_part
def equilibrium_m(wearer: Wearer, a_b_m_s2: float) -> float:
    """Displacement, m, of a plate that hangs in its ankle under a constant a_b: k_a p = −m_f a_b."""
    return 0.0


@equilibrium_m.register(Ankle)
def _ankle_equilibrium_m(wearer: Ankle, a_b_m_s2: float) -> float:
    return 0.0 - wearer.plate_kg * a_b_m_s2 / wearer.stiffness_n_per_m  # without a_b it is 0, not −0


class WearerTable(Table):
    """[wearer]: the stop rests on a foot plate, the plate on the ankle. In `result`: peak_felt_force_n."""

    plate_kg: Mass = Field(gt=0.0, description="the mass of foot plate and foot in kg")
    ankle_n_m: Stiffness = Field(gt=0.0, description="the ankle's stiffness along the axis in N/m")
    ankle_n_s_m: Damping = Field(ge=0.0, description="the ankle's damping along the axis in N s/m")

    def part(self) -> Ankle:
        """The ankle."""
        return Ankle(self.plate_kg, self.ankle_n_m, self.ankle_n_s_m)
