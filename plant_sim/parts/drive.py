"""What turns the crank. The piston follows x_A = A sin θ."""

from typing import NamedTuple, TypeAlias

from plant_sim.kernels import by_part, law


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


Drive: TypeAlias = IdealDrive | MotorDrive


@by_part
def motor_current_a(drive: Drive, torque_n_m: float, omega_rad_s: float) -> float:
    """Current, A, that flows for a commanded torque: limited by the drive, then by what the supply can push.

    The winding's time constant L/R is below the control period, so R i + K_t ω stays within ± the supply.
    """
    return 0.0


@law(motor_current_a, MotorDrive)
def _(drive: MotorDrive, torque_n_m: float, omega_rad_s: float) -> float:
    back_emf_v = drive.torque_constant_n_m_a * omega_rad_s
    current_a = torque_n_m / drive.torque_constant_n_m_a
    current_a = min(max(current_a, -drive.current_limit_a), drive.current_limit_a)
    current_a = min(current_a, (drive.supply_v - back_emf_v) / drive.resistance_ohm)
    return max(current_a, (-drive.supply_v - back_emf_v) / drive.resistance_ohm)


@by_part
def motor_torque_n_m(drive: Drive, torque_n_m: float, omega_rad_s: float) -> float:
    """Torque on the crank, N m, of the current that flows for a commanded one."""
    return 0.0


@law(motor_torque_n_m, MotorDrive)
def _(drive: MotorDrive, torque_n_m: float, omega_rad_s: float) -> float:
    return drive.torque_constant_n_m_a * motor_current_a(drive, torque_n_m, omega_rad_s)
