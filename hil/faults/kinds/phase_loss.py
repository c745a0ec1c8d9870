"""A motor that loses a phase."""

import math
from typing import Literal

from hil.faults.on_plant import PhysicalFault


class PhaseLoss(PhysicalFault):
    """One winding is disconnected: the torque pulsates, with half of its mean."""

    kind: Literal["phase-loss"]

    def given_n_m(self, torque_n_m: float, pole_pairs: int, crank_rad: float) -> float:
        """The share of the requested torque that the motor produces.

        With one wire disconnected, current flows along one axis u of the windings only. Of a current
        requested along q, perpendicular to the rotor's flux, only the projection (q·u) u flows, and its
        component along q produces torque: the share is (q·u)² = sin²(p θ).
        """
        return torque_n_m * math.sin(pole_pairs * crank_rad) ** 2
