"""What the rigid-body solvers ask of a scene's friction and stop, chosen at compile time."""

import math

from plant_sim.kernels import by_part, law
from plant_sim.parts.friction import Coulomb, Friction, Stribeck, Viscous
from plant_sim.parts.stop import RigidStop, Stop


@by_part
def is_dry(friction: Friction) -> bool:
    """Whether the law has a dry part: the striker can stick and friction reverses with its direction."""
    return False


@law(is_dry, Coulomb, Stribeck)
def _(friction: Coulomb | Stribeck) -> bool:
    return True


@by_part
def damping_n_s_m(friction: Friction) -> float:
    """The viscous coefficient b."""
    return 0.0


@law(damping_n_s_m, Viscous, Coulomb, Stribeck)
def _(friction: Viscous | Coulomb | Stribeck) -> float:
    return friction.b_n_s_m


@by_part
def dry_limit_m_s2(friction: Friction, gravity_m_s2: float, v_m_s: float) -> float:
    """Largest dry friction at a speed, over the mass."""
    return 0.0


@law(dry_limit_m_s2, Coulomb)
def _(friction: Coulomb, gravity_m_s2: float, v_m_s: float) -> float:
    return friction.mu * gravity_m_s2


@law(dry_limit_m_s2, Stribeck)
def _(friction: Stribeck, gravity_m_s2: float, v_m_s: float) -> float:
    fall = math.exp(-((abs(v_m_s) / friction.v_s_m_s) ** friction.delta))
    return (friction.mu + (friction.mu_s - friction.mu) * fall) * gravity_m_s2


@by_part
def has_stop(stop: Stop) -> bool:
    """Whether there is a stop."""
    return False


@law(has_stop, RigidStop)
def _(stop: RigidStop) -> bool:
    return True


@by_part
def stop_position_m(stop: Stop) -> float:
    """Where the stop is; infinitely far if there is none."""
    return math.inf


@law(stop_position_m, RigidStop)
def _(stop: RigidStop) -> float:
    return stop.position_m


@by_part
def restitution(stop: Stop) -> float:
    """Newton's k; 0 where there is nothing to bounce off."""
    return 0.0


@law(restitution, RigidStop)
def _(stop: RigidStop) -> float:
    return stop.restitution
