"""What turns the crank. The piston follows x_A = A sin θ."""

from typing import NamedTuple


class IdealDrive(NamedTuple):
    """The paper's drive: θ = Ω t + θ0, whatever the load."""

    amplitude_m: float
    omega_rad_s: float
    phase_rad: float


class MotorDrive(NamedTuple):
    """A BLDC motor in torque mode: J θ'' = T − T_viscous − T_dry − T_crank.

    The crank's load is T_crank = c (A sin θ + l0 − x) A cos θ.
    """

    amplitude_m: float
    phase_rad: float
    inertia_kg_m2: float
    torque_constant_n_m_a: float
    resistance_ohm: float
    inductance_h: float
    pole_pairs: int
    supply_v: float
    current_limit_a: float
    viscous_n_m_s: float
    dry_n_m: float
    speed_limit_rad_s: float
