"""The stop that the striker hits at x = position_m, approached with x' > 0."""

from typing import NamedTuple


class NoStop(NamedTuple):
    """Nothing to hit."""


class RigidStop(NamedTuple):
    """x'⁺ = −k x'⁻ at x = position_m (Newton)."""

    position_m: float
    restitution: float


class KelvinVoigt(NamedTuple):
    """F = K δ + D δ', δ = x − position_m ≥ 0; the pair is released when F would pull."""

    position_m: float
    stiffness_n_m: float
    damping_n_s_m: float


class HuntCrossley(NamedTuple):
    """F = K δⁿ (1 + λ δ'), λ = dissipation / touch-down speed, so that k does not vary with speed.

    Hunt & Crossley 1975. `dissipation` is the dimensionless λ·v⁻ that gives the wanted restitution.
    """

    position_m: float
    stiffness_n_mn: float
    exponent: float
    dissipation: float
