"""Friction laws of the striker's guide. Dry ones are set-valued at rest: the striker sticks."""

from typing import NamedTuple


class NoFriction(NamedTuple):
    """F_f = 0."""


class Viscous(NamedTuple):
    """F_f = −b x'."""

    b_n_s_m: float


class Coulomb(NamedTuple):
    """F_f = −μ m g sign(x') − b x'; sticks up to μ m g."""

    mu: float
    b_n_s_m: float


class Stribeck(NamedTuple):
    """F_f = −[μ + (μ_s − μ) exp(−(|x'|/v_s)^δ)] m g sign(x') − b x'; sticks up to μ_s m g."""

    mu: float
    mu_s: float
    v_s_m_s: float
    delta: float
    b_n_s_m: float
