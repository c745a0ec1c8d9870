"""Results of a simulation, the same for all solvers."""

from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

from plant_sim.arrays import FloatArray


class Phase(IntEnum):
    """The striker's mode of motion; each has its own equations and its own events that end it."""

    FLIGHT = 0
    STICK = 1
    REST_ON_STOP = 2
    CONTACT = 3


class LegState(IntEnum):
    """Phase of the leg of a wearer who walks."""

    STANDING = 0
    STANCE = 1
    SWING = 2


@dataclass(frozen=True, slots=True)
class MotionState:
    """The module at one instant. The crank angle is carried modulo 2π, never as Ω t."""

    t_s: float
    x_m: float
    v_m_s: float
    crank_rad: float
    omega_rad_s: float
    phase: Phase


class Observation(NamedTuple):
    """The observable quantities of a module at one instant.

    `accel_m_s2` is x'' relative to the housing, `motor_torque_n_m` the motor's torque on the crank before
    losses, `current_a` the torque-producing current, `stop_force_n` the force of a soft stop on the striker,
    `felt_force_n` the force of ankle spring and damper on the wearer; 0 for a part that is missing. The
    fields from `drive_work_j` on are the ledger since the start.
    """

    x_m: float
    v_m_s: float
    accel_m_s2: float
    crank_rad: float
    omega_rad_s: float
    motor_torque_n_m: float
    current_a: float
    stop_force_n: float
    felt_force_n: float
    drive_work_j: float
    stored_j: float
    friction_j: float
    impact_loss_j: float
    housing_work_j: float
    ankle_j: float
    phase: Phase


class Impact(NamedTuple):
    """One impact. `t_s` is the touch-down, `v_m_s` and `v_after_m_s` are the velocities before and after it.

    `peak_force_n` is nan at a rigid stop, whose force is not finite.
    """

    t_s: float
    v_m_s: float
    v_after_m_s: float
    impulse_n_s: float
    peak_force_n: float
    crank_rad: float


@dataclass(frozen=True, slots=True)
class EnergyLedger:
    """drive_work + housing_work = stored_change + friction + impact_loss + ankle, all in joules.

    `housing_work_j` is the work of −m a_b in the frame of a tilted or moving housing; `ankle_j` is the energy
    dissipated in the wearer's ankle; `stored_j` is the energy stored at the end.
    """

    drive_work_j: float
    stored_change_j: float
    friction_j: float
    impact_loss_j: float
    housing_work_j: float = 0.0
    ankle_j: float = 0.0
    stored_j: float = 0.0

    @property
    def exchanged_j(self) -> float:
        """The energy exchanged or still stored: the scale of the residual, above 0 for any motion."""
        moved_j = abs(self.drive_work_j) + abs(self.stored_change_j) + abs(self.housing_work_j)
        return moved_j + self.friction_j + self.impact_loss_j + self.ankle_j + abs(self.stored_j)

    @property
    def residual(self) -> float:
        """The imbalance as a fraction of the energy exchanged or stored; 0 where there is none."""
        given_j = self.drive_work_j + self.housing_work_j
        error = given_j - self.stored_change_j - self.friction_j - self.impact_loss_j - self.ankle_j
        return abs(error) / self.exchanged_j if self.exchanged_j > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class ElectricalLedger:
    """work = shaft + copper + magnetic, all in joules since the start.

    `work_j` is the work at the motor's terminals, `shaft_j` the `drive_work_j` of the other ledger,
    `magnetic_j` the energy of the currents' magnetic fields.
    """

    work_j: float
    shaft_j: float
    copper_j: float
    magnetic_j: float

    @property
    def residual(self) -> float:
        """The imbalance as a fraction of the energy exchanged; 0 where none was."""
        error = self.work_j - self.shaft_j - self.copper_j - self.magnetic_j
        exchanged_j = abs(self.work_j) + abs(self.shaft_j) + self.copper_j + self.magnetic_j
        return abs(error) / exchanged_j if exchanged_j > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class Impacts:
    """One entry for each impact: touch-down time, approach velocity v⁻ > 0, velocity after it, impulse, peak
    force.

    `peak_force_n` is nan at a rigid stop, whose force is not finite. Both velocities are relative to the foot
    plate of a wearer. All arrays have the shape (n,).
    """

    t_s: FloatArray
    v_m_s: FloatArray
    v_after_m_s: FloatArray
    impulse_n_s: FloatArray
    peak_force_n: FloatArray
    crank_rad: FloatArray


@dataclass(frozen=True, slots=True)
class Samples:
    """The module at requested times, as in `Observation`; arrays of shape (n,)."""

    t_s: FloatArray
    x_m: FloatArray
    v_m_s: FloatArray
    accel_m_s2: FloatArray
    crank_rad: FloatArray
    omega_rad_s: FloatArray
    motor_torque_n_m: FloatArray
    current_a: FloatArray
    stop_force_n: FloatArray
    felt_force_n: FloatArray


@dataclass(frozen=True, slots=True)
class SimulationResult:
    """A whole run of the plant alone."""

    impacts: Impacts
    final: MotionState
    energy: EnergyLedger
    method: str
    samples: Samples | None = None
    notes: tuple[str, ...] = field(default=())
    peak_felt_force_n: float | None = None
    """Largest force of ankle spring and damper on the wearer; None without a wearer."""
    electrical: ElectricalLedger | None = None
    """None if the motor's windings are not modelled."""
