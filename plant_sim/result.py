"""What a simulation hands back, whichever solver ran."""

from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Phase(IntEnum):
    """The striker's mode of motion; each has its own flow and its own exits."""

    FLIGHT = 0
    STICK = 1
    REST_ON_STOP = 2
    CONTACT = 3


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
    """All that can be read off a module at one instant.

    `accel_m_s2` is x'' as seen from the housing, `motor_torque_n_m` the motor's on the crank before its
    losses, `current_a` its torque-producing current, `stop_force_n` a soft stop's on the striker,
    `felt_force_n` that of ankle spring and damper on the wearer; 0 where there is none. From `drive_work_j`
    on it is the ledger since the start.
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

    `peak_force_n` is nan at a rigid stop, which has none.
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

    `housing_work_j` is that of −m a_b, as seen from a tilted or moving housing; `ankle_j` is what the
    wearer's ankle damps.
    """

    drive_work_j: float
    stored_change_j: float
    friction_j: float
    impact_loss_j: float
    housing_work_j: float = 0.0
    ankle_j: float = 0.0

    @property
    def exchanged_j(self) -> float:
        """The energy that went through the ledger: the scale of its residual."""
        moved_j = abs(self.drive_work_j) + abs(self.stored_change_j) + abs(self.housing_work_j)
        return moved_j + self.friction_j + self.impact_loss_j + self.ankle_j

    @property
    def residual(self) -> float:
        """What does not balance, as a fraction of the energy exchanged; 0 where none was."""
        given_j = self.drive_work_j + self.housing_work_j
        error = given_j - self.stored_change_j - self.friction_j - self.impact_loss_j - self.ankle_j
        return abs(error) / self.exchanged_j if self.exchanged_j > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class ElectricalLedger:
    """work = shaft + copper + magnetic, all in joules since the start.

    `work_j` is that at the motor's terminals, `shaft_j` the `drive_work_j` of the other ledger, `magnetic_j`
    what the currents' own fields hold.
    """

    work_j: float
    shaft_j: float
    copper_j: float
    magnetic_j: float

    @property
    def residual(self) -> float:
        """What does not balance, as a fraction of the energy exchanged; 0 where none was."""
        error = self.work_j - self.shaft_j - self.copper_j - self.magnetic_j
        exchanged_j = abs(self.work_j) + abs(self.shaft_j) + self.copper_j + self.magnetic_j
        return abs(error) / exchanged_j if exchanged_j > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class Impacts:
    """One entry an impact: touch-down time, approach velocity v⁻ > 0, velocity after it, impulse, peak force.

    `peak_force_n` is nan at a rigid stop, which has none. Against a wearer's foot plate both velocities are
    those relative to it. Arrays share one shape (n,).
    """

    t_s: NDArray[np.float64]
    v_m_s: NDArray[np.float64]
    v_after_m_s: NDArray[np.float64]
    impulse_n_s: NDArray[np.float64]
    peak_force_n: NDArray[np.float64]
    crank_rad: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Samples:
    """The motion on a grid of times the caller asked for; arrays of shape (n,)."""

    t_s: NDArray[np.float64]
    x_m: NDArray[np.float64]
    v_m_s: NDArray[np.float64]
    crank_rad: NDArray[np.float64]


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
    """Largest force of ankle spring and damper on the wearer; None where nobody wears the module."""
    electrical: ElectricalLedger | None = None
    """None where the motor's windings are not modelled."""
