"""The stop that the striker meets at x = position_m, approached with x' > 0."""

import math
from typing import NamedTuple, TypeAlias

from plant_sim.kernels import by_part, law
from plant_sim.parts.striker import Striker


class NoStop(NamedTuple):
    """No stop."""


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


Stop: TypeAlias = NoStop | RigidStop | KelvinVoigt | HuntCrossley

LEAST_TOUCH_SPEED_M_S = 1e-3
"""Below it λ no longer grows: a striker laid against the stop would else meet unbounded damping."""


@by_part
def origin_m(stop: Stop, striker: Striker) -> float:
    """Where depth is counted from, m: the stop, so that depths near it keep their digits."""
    raise NotImplementedError


@law(origin_m, NoStop)
def _(stop: NoStop, striker: Striker) -> float:
    return striker.rest_length_m


@law(origin_m, RigidStop, KelvinVoigt, HuntCrossley)
def _(stop: RigidStop | KelvinVoigt | HuntCrossley, striker: Striker) -> float:
    return stop.position_m


@by_part
def damping_s_m(stop: Stop, touch_speed_m_s: float) -> float:
    """λ, s/m, of a contact that began at this speed; 0 for stops whose damping does not depend on it."""
    return 0.0


@law(damping_s_m, HuntCrossley)
def _(stop: HuntCrossley, touch_speed_m_s: float) -> float:
    return stop.dissipation / max(touch_speed_m_s, LEAST_TOUCH_SPEED_M_S)


@by_part
def elastic_force_n(stop: Stop, depth_m: float) -> float:
    """Force, N, of the stop's spring alone on the striker, against +x."""
    return 0.0


@law(elastic_force_n, KelvinVoigt)
def _(stop: KelvinVoigt, depth_m: float) -> float:
    return stop.stiffness_n_m * depth_m


@law(elastic_force_n, HuntCrossley)
def _(stop: HuntCrossley, depth_m: float) -> float:
    force_n: float = stop.stiffness_n_mn * max(depth_m, 0.0) ** stop.exponent
    return force_n


@by_part
def stop_force_n(stop: Stop, elastic_n: float, v_m_s: float, damping_s_m: float) -> float:
    """Force, N, of the stop on a striker in contact, against +x, from that of its spring."""
    return 0.0


@law(stop_force_n, KelvinVoigt)
def _(stop: KelvinVoigt, elastic_n: float, v_m_s: float, damping_s_m: float) -> float:
    return elastic_n + stop.damping_n_s_m * v_m_s


@law(stop_force_n, HuntCrossley)
def _(stop: HuntCrossley, elastic_n: float, v_m_s: float, damping_s_m: float) -> float:
    return elastic_n * max(1.0 + damping_s_m * v_m_s, 0.0)  # it never pulls


@by_part
def elastic_energy_j(stop: Stop, depth_m: float) -> float:
    """Energy, J, in the stop's spring."""
    return 0.0


@law(elastic_energy_j, KelvinVoigt)
def _(stop: KelvinVoigt, depth_m: float) -> float:
    return 0.5 * stop.stiffness_n_m * depth_m * depth_m


@law(elastic_energy_j, HuntCrossley)
def _(stop: HuntCrossley, depth_m: float) -> float:
    return elastic_force_n(stop, depth_m) * depth_m / (stop.exponent + 1.0)


@by_part
def is_rigid(stop: Stop) -> bool:
    """Whether an impact takes no time."""
    return False


@law(is_rigid, RigidStop)
def _(stop: RigidStop) -> bool:
    return True


@by_part
def is_soft(stop: Stop) -> bool:
    """Whether an impact is a contact that lasts."""
    return False


@law(is_soft, KelvinVoigt, HuntCrossley)
def _(stop: KelvinVoigt | HuntCrossley) -> bool:
    return True


@by_part
def restitution(stop: Stop) -> float:
    """Newton's k of a rigid stop."""
    return 1.0


@law(restitution, RigidStop)
def _(stop: RigidStop) -> float:
    return stop.restitution


@by_part
def contact_rate_rad_s(stop: Stop, mass_kg: float, touch_speed_m_s: float) -> float:
    """Speed over greatest depth, rad/s, of an undamped contact: how fast things happen in it."""
    return 0.0


@law(contact_rate_rad_s, KelvinVoigt)
def _(stop: KelvinVoigt, mass_kg: float, touch_speed_m_s: float) -> float:
    return math.sqrt(stop.stiffness_n_m / mass_kg)


@law(contact_rate_rad_s, HuntCrossley)
def _(stop: HuntCrossley, mass_kg: float, touch_speed_m_s: float) -> float:
    # ½ m v² = K δⁿ⁺¹ / (n + 1)
    speed = max(touch_speed_m_s, LEAST_TOUCH_SPEED_M_S)
    order = stop.exponent + 1.0
    depth_m: float = (0.5 * order * mass_kg * speed * speed / stop.stiffness_n_mn) ** (1.0 / order)
    return speed / depth_m
