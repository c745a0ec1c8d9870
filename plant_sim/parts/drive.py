"""Drives of the crank. The piston follows x_A = A sin θ."""

import math
from collections.abc import Mapping
from typing import Annotated, Literal, NamedTuple, Self, TypeAlias

from pydantic import Field, model_validator

from plant_sim.kernels import one_of, subroutine
from plant_sim.tables.quantities import (
    Angle,
    AngularSpeed,
    Current,
    Frequency,
    Inductance,
    Inertia,
    Length,
    Number,
    Resistance,
    RotaryDamping,
    Torque,
    TorqueConstant,
    Voltage,
)
from plant_sim.tables.table import Table


class IdealDrive(NamedTuple):
    """The paper's drive: θ = Ω t + θ0, independent of the load."""

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
    pole_pairs: int
    supply_v: float
    current_limit_a: float
    viscous_n_m_s: float
    dry_n_m: float
    speed_limit_rad_s: float


Drive: TypeAlias = IdealDrive | MotorDrive


is_motor = one_of(MotorDrive)
"""Whether a torque turns the crank; an ideal drive turns it at constant speed."""


@subroutine
def constant_speed_rad_s(drive: Drive) -> float:
    """Ω of an ideal drive, rad/s; 0 for a motor, which finds its own speed."""
    return 0.0 if is_motor(drive) else drive.omega_rad_s


@subroutine
def commanded_current_a(drive: MotorDrive, torque_n_m: float) -> float:
    """Current command, A, of a drive for a torque command, within its limit: i_q* of the windings."""
    current_a = torque_n_m / drive.torque_constant_n_m_a
    return min(max(current_a, -drive.current_limit_a), drive.current_limit_a)


@subroutine
def voltage_limit_v(drive: MotorDrive) -> float:
    """Largest voltage vector of a bus, V: the circle inscribed in the inverter's hexagon."""
    return drive.supply_v / math.sqrt(3.0)


@subroutine(inline=True)
def motor_current_a(drive: Drive, torque_n_m: float, omega_rad_s: float) -> float:
    """Current, A, for a commanded torque, limited by the drive and by the supply voltage.

    The voltage limit is that of the windings (`plant_sim.parts.winding`): R i_q + p ω ψ within ± V/√3, with
    p ψ = K_t / (3/2). The winding's time constant L/R is below the control period, so that the current has
    settled, and the voltage p ω L i_q across it, some 2 % of the limit, is neglected. An ideal drive has no
    current.
    """
    if not is_motor(drive):
        return 0.0
    limit_v, back_emf_v = voltage_limit_v(drive), drive.torque_constant_n_m_a * omega_rad_s / 1.5
    current_a = min(commanded_current_a(drive, torque_n_m), (limit_v - back_emf_v) / drive.resistance_ohm)
    return max(current_a, (-limit_v - back_emf_v) / drive.resistance_ohm)


@subroutine(inline=True)
def motor_torque_n_m(drive: Drive, torque_n_m: float, omega_rad_s: float) -> float:
    """Torque on the crank, N m, for a commanded torque; 0 with an ideal drive."""
    if not is_motor(drive):
        return 0.0
    return drive.torque_constant_n_m_a * motor_current_a(drive, torque_n_m, omega_rad_s)


class MotorTable(Table):
    """A small direct-drive BLDC gimbal motor with a flywheel, as seen at its torque command."""

    # Together: 0.8 N m at 10 A, against peaks of 0.14 N m (table1, r = 1.3) and 0.49 N m (gait, r = 1.2).
    torque_constant_n_m_a: TorqueConstant = Field(
        default=0.08, gt=0.0, description="the torque constant in N m/A"
    )
    resistance_ohm: Resistance = Field(default=0.4, gt=0.0, description="the winding's resistance in Ω")
    # 0.75 ms with 0.4 Ω: faster than the 1 ms tick, so that the current is taken as settled.
    inductance_h: Inductance = Field(default=0.3e-3, gt=0.0, description="the winding's inductance in H")
    # A 12N14P stator, the usual one of gimbal motors.
    pole_pairs: int = Field(default=7, ge=1, description="the number of pole pairs")
    # Six lithium cells; no-load speed 260 rad/s, twenty times what r = 1.3 needs.
    supply_v: Voltage = Field(default=24.0, gt=0.0, description="the supply voltage in V")
    current_limit_a: Current = Field(default=10.0, gt=0.0, description="the drive's current limit in A")
    # A flywheel that keeps the speed ripple at 2.7 % under a plain PI loop; 1e-4 alone would not.
    inertia_kg_m2: Inertia = Field(
        default=5e-4, gt=0.0, description="the inertia of rotor and flywheel in kg m²"
    )
    # A tenth of the dry loss at 5 rad/s: bearings of this size.
    viscous_n_m_s: RotaryDamping = Field(default=1e-4, ge=0.0, description="the viscous loss in N m s")
    # Cogging and seals of a motor of this size, 1 % of its torque.
    dry_n_m: Torque = Field(default=5e-3, ge=0.0, description="the dry loss in N m")
    # Three times the crank's speed at r = 1.3 of table1, 1.6 times gait's at r = 1.
    speed_limit_rad_s: AngularSpeed = Field(
        default=40.0, gt=0.0, description="the drive's speed limit in rad/s"
    )


_Rod = Annotated[
    Length | None,
    Field(
        gt=0.0, description="the connecting rod's length in m, above amplitude_m (default: endless, a sine)"
    ),
]


class CrankTable(Table):
    """The crank, which every drive has."""

    amplitude_m: Length = Field(ge=0.0, description="the piston's amplitude in m: the crank's radius")
    rod_m: _Rod = None

    @model_validator(mode="after")
    def _rod_outreaches_crank(self) -> Self:
        if self.rod_m is not None and self.rod_m <= self.amplitude_m:
            raise ValueError(
                f"drive.rod_m = {self.rod_m} is not longer than the crank, drive.amplitude_m = "
                f"{self.amplitude_m}; such a crank cannot turn, give a longer rod or delete rod_m"
            )
        return self


class IdealDriveTable(CrankTable):
    """The paper's crank: constant speed, independent of the load."""

    model: Literal["ideal"]
    ratio: Number | None = Field(default=None, ge=0.0, description="the crank's speed as a ratio Ω/ω")
    frequency_hz: Frequency | None = Field(default=None, ge=0.0, description="the crank's frequency in Hz")
    speed_rad_s: AngularSpeed | None = Field(default=None, ge=0.0, description="the crank's speed in rad/s")
    phase_rad: Angle = Field(default=0.0, description="the crank's angle at the start in rad")

    @model_validator(mode="after")
    def _one_speed(self) -> Self:
        given = {name: getattr(self, name) for name in _SPEEDS if getattr(self, name) is not None}
        if len(given) > 1:
            both = " and ".join(f"drive.{name} = {value}" for name, value in given.items())
            raise ValueError(f"{both} are both given; the drive has one speed, keep one of them")
        if not given:
            raise ValueError(
                "drive has no speed; give one of drive.ratio (Ω/ω), drive.frequency_hz or drive.speed_rad_s"
            )
        return self

    def part(self, natural_rad_s: float, motor: MotorTable) -> IdealDrive:
        """The drive of a striker with this natural frequency."""
        # exactly one is given
        speed_rad_s = (self.ratio or 0.0) * natural_rad_s
        speed_rad_s += (self.frequency_hz or 0.0) * 2.0 * math.pi + (self.speed_rad_s or 0.0)
        return IdealDrive(self.amplitude_m, speed_rad_s, self.phase_rad)


_SPEEDS = ("ratio", "frequency_hz", "speed_rad_s")


class TorqueDriveTable(CrankTable):
    """The crank on a motor with a torque command."""

    phase_rad: Angle = Field(default=0.0, description="the crank's angle at the start in rad")

    @model_validator(mode="before")
    @classmethod
    def _no_speed(cls, data: object) -> object:
        for name in _SPEEDS:
            if isinstance(data, Mapping) and name in data:
                raise ValueError(
                    f"drive.{name} = {data[name]} is given for a motor, which takes a torque and finds its "
                    "own speed; delete it, or set drive.model = 'ideal'"
                )
        return data

    def part(self, natural_rad_s: float, motor: MotorTable) -> MotorDrive:
        """The drive on this motor; names each number, since an FMU compiles this function."""
        return MotorDrive(
            amplitude_m=self.amplitude_m,
            phase_rad=self.phase_rad,
            inertia_kg_m2=motor.inertia_kg_m2,
            torque_constant_n_m_a=motor.torque_constant_n_m_a,
            resistance_ohm=motor.resistance_ohm,
            pole_pairs=motor.pole_pairs,
            supply_v=motor.supply_v,
            current_limit_a=motor.current_limit_a,
            viscous_n_m_s=motor.viscous_n_m_s,
            dry_n_m=motor.dry_n_m,
            speed_limit_rad_s=motor.speed_limit_rad_s,
        )


class MotorDriveTable(TorqueDriveTable):
    """A motor whose current follows its command at once, within the limits of drive and supply."""

    model: Literal["motor"]


class DqMotorDriveTable(TorqueDriveTable):
    """A motor with its windings in the rotor's frame, current loop and bus voltage."""

    model: Literal["dq-motor"]


DriveTable: TypeAlias = Annotated[
    IdealDriveTable | MotorDriveTable | DqMotorDriveTable, Field(discriminator="model")
]
