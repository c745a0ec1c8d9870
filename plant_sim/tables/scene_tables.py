"""The tables of a scene file: their keys, units, bounds and defaults, each default with its reason."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticCustomError

from plant_sim.tables.quantities import quantity_of

STANDARD_GRAVITY_M_S2 = 9.80665

CONTACT_REFERENCE_SPEED_M_S = 0.9
"""`contact_s` holds at this approach speed: the module's at r = 1.3 (0.91 m/s)."""


class Table(BaseModel):
    """Unknown keys, wrong types, NaN, infinity and unphysical sizes are refused; a table never changes."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _plain_numbers(cls, data: object) -> object:
        if not isinstance(data, Mapping):
            return data
        return {key: value.item() if isinstance(value, np.generic) else value for key, value in data.items()}

    @field_validator("*", mode="after")
    @classmethod
    def _has_a_physical_size(cls, value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, bool) or not isinstance(value, int | float) or info.field_name is None:
            return value
        quantity = quantity_of(info.field_name)
        bounds = cls.model_fields[info.field_name].metadata
        is_positive = any(getattr(bound, "gt", None) == 0.0 for bound in bounds)
        smallest = quantity.smallest if is_positive else 0.0
        if not smallest <= abs(value) <= quantity.largest:
            raise PydanticCustomError(
                "physical_size",
                "not a size from {smallest} to {largest}",
                {"smallest": f"{smallest:g}", "largest": f"{quantity.largest:g}", "reason": quantity.reason},
            )
        return value


class StrikerTable(Table):
    """The impact mass on its coupling spring."""

    mass_kg: float = Field(gt=0.0, description="the striker's mass in kg")
    spring_n_m: float = Field(gt=0.0, description="the coupling spring's stiffness in N/m")
    rest_length_m: float = Field(description="the striker's position in m where the spring is relaxed")
    gravity_m_s2: float = Field(
        default=STANDARD_GRAVITY_M_S2,
        ge=0.0,
        description="gravity in m/s² (it enters dry friction, and the motion where the housing is tilted)",
    )


_Rod = Annotated[
    float | None,
    Field(
        gt=0.0, description="the connecting rod's length in m, above amplitude_m (default: endless, a sine)"
    ),
]


class CrankTable(Table):
    """What every drive turns."""

    amplitude_m: float = Field(ge=0.0, description="the piston's amplitude in m: the crank's radius")
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
    """The paper's crank: constant speed, whatever the load."""

    model: Literal["ideal"]
    ratio: float | None = Field(default=None, ge=0.0, description="the crank's speed as a ratio Ω/ω")
    frequency_hz: float | None = Field(default=None, ge=0.0, description="the crank's frequency in Hz")
    speed_rad_s: float | None = Field(default=None, ge=0.0, description="the crank's speed in rad/s")
    phase_rad: float = Field(default=0.0, description="the crank's angle at the start in rad")

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


_SPEEDS = ("ratio", "frequency_hz", "speed_rad_s")


class TorqueDriveTable(CrankTable):
    """The crank on a motor that is commanded a torque."""

    phase_rad: float = Field(default=0.0, description="the crank's angle at the start in rad")

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


class MotorDriveTable(TorqueDriveTable):
    """A motor whose current follows at once what is asked of it, as far as limit and supply allow."""

    model: Literal["motor"]


class DqMotorDriveTable(TorqueDriveTable):
    """A motor with its windings in the rotor's frame, current loop, bus voltage, cogging and ripple."""

    model: Literal["dq-motor"]


class NoFrictionTable(Table):
    """A guide without friction."""

    law: Literal["none"]


class ViscousTable(Table):
    """Friction proportional to speed."""

    law: Literal["viscous"]
    b_n_s_m: float = Field(ge=0.0, description="the viscous coefficient in N s/m")


class CoulombTable(Table):
    """Dry friction; it sticks."""

    law: Literal["coulomb"]
    mu: float = Field(ge=0.0, description="the coefficient of dry friction")
    b_n_s_m: float = Field(default=0.0, ge=0.0, description="the viscous coefficient in N s/m")


class StribeckTable(Table):
    """Dry friction that falls from μ_s to μ with speed; it sticks."""

    law: Literal["stribeck"]
    mu: float = Field(ge=0.0, description="the coefficient of sliding friction at speed")
    mu_s: float = Field(ge=0.0, description="the coefficient of static friction, at least mu")
    v_s_m_s: float = Field(gt=0.0, description="the Stribeck speed in m/s")
    delta: float = Field(gt=0.0, description="the Stribeck exponent")
    b_n_s_m: float = Field(default=0.0, ge=0.0, description="the viscous coefficient in N s/m")

    @model_validator(mode="after")
    def _static_not_below_sliding(self) -> Self:
        if self.mu_s < self.mu:
            raise ValueError(
                f"friction.mu_s = {self.mu_s} is below friction.mu = {self.mu}; "
                "static friction is at least the sliding one, raise mu_s or lower mu"
            )
        return self


class NoStopTable(Table):
    """No stop."""

    law: Literal["none"]


_Position = Annotated[float, Field(description="the stop's position in m")]


class RigidStopTable(Table):
    """Newton's impact law."""

    law: Literal["rigid"]
    position_m: _Position
    restitution: float = Field(ge=0.0, le=1.0, description="the coefficient of restitution, 0 to 1")


class SoftStopTable(Table):
    """What every soft stop is given."""

    position_m: _Position
    restitution: float = Field(
        gt=0.0,
        le=1.0,
        description="the coefficient of restitution, above 0 (a soft stop always returns some) to 1",
    )
    contact_s: float | None = Field(
        default=None,
        gt=0.0,
        description=f"the elastic contact time in s at {CONTACT_REFERENCE_SPEED_M_S} m/s of approach",
    )
    stiffness: float | None = Field(
        default=None, gt=0.0, description="the stop's stiffness in N/m (hunt-crossley: N/m^1.5)"
    )

    @model_validator(mode="after")
    def _one_stiffness(self) -> Self:
        if self.contact_s is not None and self.stiffness is not None:
            raise ValueError(
                f"stop.contact_s = {self.contact_s} and stop.stiffness = {self.stiffness} are both given; "
                "each gives the other, keep one of them"
            )
        if self.contact_s is None and self.stiffness is None:
            raise ValueError("stop has no stiffness; give one of stop.contact_s (in s) or stop.stiffness")
        return self


class KelvinVoigtTable(SoftStopTable):
    """A linear spring and damper that cannot pull."""

    law: Literal["kelvin-voigt"]


class HuntCrossleyTable(SoftStopTable):
    """A Hertzian spring whose damping grows with depth."""

    law: Literal["hunt-crossley"]


class HarmonicTable(Table):
    """The housing swings along the axis; ±20° of slow tilt is 3.4 m/s² of it."""

    amplitude_m_s2: float = Field(gt=0.0, description="the amplitude in m/s²")
    frequency_hz: float = Field(gt=0.0, description="the frequency in Hz")
    phase_rad: float = Field(default=0.0, description="the phase at t = 0 in rad")


class ShockTable(Table):
    """The housing is knocked along the axis once, as a half-sine."""

    peak_m_s2: float = Field(description="the largest acceleration in m/s², negative away from the stop")
    start_s: float = Field(ge=0.0, description="when it begins in s")
    duration_s: float = Field(gt=0.0, description="how long it lasts in s")


class MotionTable(Table):
    """[housing]: tilt and acceleration of what carries the module, along the striker's axis."""

    tilt_rad: float = Field(
        default=0.0,
        ge=-math.pi / 2.0,
        le=math.pi / 2.0,
        description="by how much the axis rises towards the stop in rad",
    )
    harmonic: HarmonicTable | None = Field(default=None, description="the table [housing.harmonic]")
    shock: ShockTable | None = Field(default=None, description="the table [housing.shock]")


class WearerTable(Table):
    """[wearer]: the stop rests on a foot plate, the plate on the ankle. In `result`: peak_felt_force_n."""

    plate_kg: float = Field(gt=0.0, description="the mass of foot plate and foot in kg")
    ankle_n_m: float = Field(gt=0.0, description="the ankle's stiffness along the axis in N/m")
    ankle_n_s_m: float = Field(ge=0.0, description="the ankle's damping along the axis in N s/m")


class InitialTable(Table):
    """The striker at t = 0."""

    x_m: float | None = Field(
        default=None, description="the striker's position in m (default: rest_length_m)"
    )
    v_m_s: float = Field(default=0.0, description="the striker's velocity in m/s")


class SolverTable(Table):
    """Which solver, and how accurate."""

    method: Literal["auto", "exact", "adaptive", "stepping"] = Field(
        default="auto", description="one of auto, exact, adaptive, stepping"
    )
    accuracy: float = Field(
        default=1e-9,
        ge=1e-13,
        le=1e-2,
        description="the largest state error per forcing period, in m and in m/s over ω, from 1e-13 to 1e-2",
    )
    step_s: float | None = Field(
        default=None, gt=0.0, description="the step of method = 'stepping' in s (default: from accuracy)"
    )

    @model_validator(mode="after")
    def _step_belongs_to_stepping(self) -> Self:
        if self.step_s is not None and self.method != "stepping":
            raise ValueError(
                f"solver.step_s = {self.step_s} is given while solver.method = {self.method!r} finds its own "
                "steps; delete it, or set solver.method = 'stepping'"
            )
        return self


class MotorTable(Table):
    """A small direct-drive BLDC gimbal motor with a flywheel, as seen at its torque command."""

    # Together: 0.8 N m at 10 A, against peaks of 0.14 N m (table1, r = 1.3) and 0.49 N m (gait, r = 1.2).
    torque_constant_n_m_a: float = Field(default=0.08, gt=0.0, description="the torque constant in N m/A")
    resistance_ohm: float = Field(default=0.4, gt=0.0, description="the winding's resistance in Ω")
    # 0.75 ms with 0.4 Ω: faster than the 1 ms tick, so that the current is taken as settled.
    inductance_h: float = Field(default=0.3e-3, gt=0.0, description="the winding's inductance in H")
    # A 12N14P stator, the usual one of gimbal motors.
    pole_pairs: int = Field(default=7, ge=1, description="the number of pole pairs")
    # Six lithium cells; no-load speed 300 rad/s, ten times what r = 1.3 needs.
    supply_v: float = Field(default=24.0, gt=0.0, description="the supply voltage in V")
    current_limit_a: float = Field(default=10.0, gt=0.0, description="the drive's current limit in A")
    # A flywheel that keeps the speed ripple at 2.7 % under a plain PI loop; 1e-4 alone would not.
    inertia_kg_m2: float = Field(
        default=5e-4, gt=0.0, description="the inertia of rotor and flywheel in kg m²"
    )
    # A tenth of the dry loss at 5 rad/s: bearings of this size.
    viscous_n_m_s: float = Field(default=1e-4, ge=0.0, description="the viscous loss in N m s")
    # Cogging and seals of a motor of this size, 1 % of its torque.
    dry_n_m: float = Field(default=5e-3, ge=0.0, description="the dry loss in N m")
    # Three times the crank's speed at r = 1.3 of table1, 1.6 times gait's at r = 1.
    speed_limit_rad_s: float = Field(default=40.0, gt=0.0, description="the drive's speed limit in rad/s")


class AxisTable(Table):
    """[axis]: what a client may configure of the drive, an ODrive axis."""

    # Half of the 100 ms in which the motor is to be free of torque.
    watchdog_s: float = Field(
        default=0.05, ge=1e-3, description="without a command for this long the axis disarms, in s"
    )
    # ODrive's heartbeat_rate_ms, whose own default is 100 ms.
    heartbeat_s: float = Field(default=0.1, ge=1e-3, le=60.0, description="the heartbeat's period in s")
    # ODrive's encoder_msg_rate_ms, whose own default is 10 ms; the firmware needs a sample a tick.
    encoder_s: float | None = Field(
        default=None, ge=1e-3, le=60.0, description="the period of position and speed in s (default: a tick)"
    )
    control_mode: Literal["torque", "velocity"] = Field(
        default="torque", description="the drive's mode as its supply comes on: `torque` or `velocity`"
    )


class CoggingTable(Table):
    """[[winding.cogging]]: a wave of the magnets' torque on the slots."""

    order: int = Field(ge=1, description="the number of periods in a turn of the crank")
    amplitude_n_m: float = Field(ge=0.0, description="the amplitude in N m")
    phase_rad: float = Field(default=0.0, description="the phase at θ = 0 in rad, of a sine")


class RippleTable(Table):
    """[[winding.ripple]]: a wave of the magnets' flux, and with it of torque and back-EMF."""

    order: int = Field(ge=1, description="the number of periods in an electrical turn, p θ")
    share: float = Field(ge=0.0, lt=1.0, description="the amplitude as a share of the mean flux, below 1")
    phase_rad: float = Field(default=0.0, description="the phase at θ = 0 in rad, of a sine")


class WindingTable(Table):
    """[winding]: what a dq-motor has beside [motor], whose R and L are a phase's and K_t per peak ampere."""

    d_inductance_h: float | None = Field(
        default=None, gt=0.0, description="the inductance along the magnets in H (default: the motor's)"
    )
    q_inductance_h: float | None = Field(
        default=None, gt=0.0, description="the inductance across them in H (default: the motor's)"
    )
    # An ODrive's own default. With the 1 ms tick of the torque command a faster loop shows little.
    bandwidth_rad_s: float = Field(
        default=1000.0, gt=0.0, description="the bandwidth of the current loop in rad/s"
    )
    cogging: list[CoggingTable] = Field(default=[], description="the tables [[winding.cogging]]")
    ripple: list[RippleTable] = Field(default=[], description="the tables [[winding.ripple]]")
