"""The friction laws that are distinguished, a striker with such a law, and the ranges of its parameters."""

from enum import StrEnum
from typing import NamedTuple

import numpy as np

from plant_sim.arrays import FloatArray

FIRST_V_S_M_S = 0.05
"""First value of Stribeck's v_s."""


class Law(StrEnum):
    """Friction laws that are distinguished."""

    VISCOUS = "viscous"
    COULOMB = "coulomb"
    BOTH = "coulomb and viscous"
    STRIBECK = "stribeck"


class Striker(NamedTuple):
    """Per unit of mass: κ = c/m, d = b/m, f = μ g, h = (μ_s − μ) g; A, the accelerometer's offset β, v_s, δ.

    The piston is at A sin θ + B cos θ; B is 0 unless the encoder's zero is unknown.

    Dry friction is (f + h exp(−(|v|/v_s)^δ)) sign v.
    """

    stiffness_1_s2: float
    amplitude_m: float
    offset_m_s2: float
    damping_1_s: float = 0.0
    dry_m_s2: float = 0.0
    rise_m_s2: float = 0.0
    v_s_m_s: float = FIRST_V_S_M_S
    delta: float = 1.0
    quadrature_m: float = 0.0


COMMON = ("stiffness_1_s2", "amplitude_m", "offset_m_s2")
FITTED: dict[Law, tuple[str, ...]] = {
    Law.VISCOUS: (*COMMON, "damping_1_s"),
    Law.COULOMB: (*COMMON, "dry_m_s2"),
    Law.BOTH: (*COMMON, "damping_1_s", "dry_m_s2"),
    Law.STRIBECK: (*COMMON, "dry_m_s2", "rise_m_s2", "v_s_m_s"),
}
QUADRATURE = "quadrature_m"
"""The parameter that is fitted too if the encoder's zero is unknown."""
KAPPA, RADIUS, OFFSET, DAMPING, DRY, RISE, V_S, DELTA, B, X0, V0 = range(11)
"""Derivatives of the reading by the striker's values in their order, then by the initial state; none by δ."""


RANGES = {
    "stiffness_1_s2": (1.0, 1e4),
    "damping_1_s": (-2.0, 20.0),
    "rise_m_s2": (1e-3, 5.0),
    "v_s_m_s": (0.02, 1.0),
}
"""Bounds of parameters with which a law that does not hold could diverge. Noise may make b negative."""


def friction_m_s2(striker: Striker, v_m_s: FloatArray) -> FloatArray:
    """Friction per unit of mass against the velocity, d v + (f + h exp(−(|v|/v_s)^δ)) sign v."""
    rise = striker.rise_m_s2 * np.exp(-((np.abs(v_m_s) / striker.v_s_m_s) ** striker.delta))
    return np.asarray(striker.damping_1_s * v_m_s + (striker.dry_m_s2 + rise) * np.sign(v_m_s))
