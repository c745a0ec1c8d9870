"""Friction laws of the striker's guide. Dry ones are set-valued at rest: the striker sticks."""

import math
from typing import NamedTuple, TypeAlias

from plant_sim.kernels import by_part, law

ROUNDING = 1e-14
"""Of a sum of forces or torques, as a share of the largest term: what holds at rest, be it friction, the dry
loss of a crank or the stop, holds up to and including its limit and this much beyond it, in every solver."""


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


Friction: TypeAlias = NoFriction | Viscous | Coulomb | Stribeck


@by_part
def static_limit_n(friction: Friction, normal_n: float) -> float:
    """Largest force, N, that holds the striker at rest under the normal force m g; 0 where nothing sticks."""
    return 0.0


@law(static_limit_n, Coulomb)
def _(friction: Coulomb, normal_n: float) -> float:
    return friction.mu * normal_n


@law(static_limit_n, Stribeck)
def _(friction: Stribeck, normal_n: float) -> float:
    return friction.mu_s * normal_n


@by_part
def friction_force_n(friction: Friction, normal_n: float, v_m_s: float, direction: float) -> float:
    """F_f, N, of a striker sliding in `direction`, ±1; within a solver's stage v may overshoot zero."""
    return 0.0


@law(friction_force_n, Viscous)
def _(friction: Viscous, normal_n: float, v_m_s: float, direction: float) -> float:
    return -friction.b_n_s_m * v_m_s


@law(friction_force_n, Coulomb)
def _(friction: Coulomb, normal_n: float, v_m_s: float, direction: float) -> float:
    return -friction.mu * normal_n * direction - friction.b_n_s_m * v_m_s


@law(friction_force_n, Stribeck)
def _(friction: Stribeck, normal_n: float, v_m_s: float, direction: float) -> float:
    speed = v_m_s * (direction / friction.v_s_m_s)
    # Where a stage slides backwards the law is continued smoothly, as far as a solver may look ahead.
    if friction.delta == 1.0:
        power = max(speed, -2.0)
    elif friction.delta == 2.0:
        power = speed * speed
    else:
        power = abs(speed) ** friction.delta
    # What does not wait for the exponential comes first: a solver's stages hang on one another by it.
    weight_n = normal_n * direction
    sliding_n = -(friction.mu * weight_n) - friction.b_n_s_m * v_m_s
    return sliding_n - (friction.mu_s - friction.mu) * weight_n * math.exp(-power)
