"""A scene: which parts the module has and their numbers, read from TOML and refused where it makes no sense.

Lengths along the striker's axis, in metres, positive towards the stop; a table that is missing is a part that
is not there.
"""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from plant_sim.parts.drive import Drive, IdealDrive, MotorDrive
from plant_sim.parts.friction import Coulomb, Friction, NoFriction, Stribeck, Viscous
from plant_sim.parts.housing import Housing, Level, Moving, Tilted
from plant_sim.parts.linkage import Sine, SliderCrank
from plant_sim.parts.parts import Parts
from plant_sim.parts.restitution import (
    HERTZ_EXPONENT,
    hertz_stiffness,
    hunt_crossley_dissipation,
    kelvin_voigt_damping,
    linear_stiffness,
)
from plant_sim.parts.stop import HuntCrossley, KelvinVoigt, NoStop, RigidStop, Stop
from plant_sim.parts.striker import Striker
from plant_sim.parts.walking import TOE_OFF, Walking
from plant_sim.parts.wearer import Ankle, NoWearer, Wearer, contact_mass_kg
from plant_sim.parts.winding import DqWinding, Settled, Smooth, Unevenness, Wave, Waves, Winding
from plant_sim.strides import draw_strides
from plant_sim.tables.gait_tables import GaitTable
from plant_sim.tables.quantities import LARGEST_SPEED_RAD_S
from plant_sim.tables.scene_tables import (
    CONTACT_REFERENCE_SPEED_M_S,
    AxisTable,
    CoulombTable,
    DqMotorDriveTable,
    HuntCrossleyTable,
    IdealDriveTable,
    InitialTable,
    KelvinVoigtTable,
    MotionTable,
    MotorDriveTable,
    MotorTable,
    NoFrictionTable,
    NoStopTable,
    RigidStopTable,
    SolverTable,
    StribeckTable,
    StrikerTable,
    Table,
    TorqueDriveTable,
    ViscousTable,
    WearerTable,
    WindingTable,
)
from plant_sim.tables.sensor_tables import SensorsTable
from plant_sim.text_input import TextInputError, read_toml
from plant_sim.validation_messages import complaints, nearest

SCENES = Path(__file__).parent / "scenes"

STRIDES_STREAM = 9
"""Strides are sampled separately from the sensors' noise, which is the seed's own."""


class SceneError(TextInputError):
    """A scene that cannot be simulated; the message has one sentence for each thing wrong with it."""


class Scene(Table):
    """A whole scene; `parts()` is what solvers take of it."""

    striker: StrikerTable = Field(
        description="the table [striker] with mass_kg, spring_n_m and rest_length_m"
    )
    drive: Annotated[IdealDriveTable | MotorDriveTable | DqMotorDriveTable, Field(discriminator="model")] = (
        Field(description="the table [drive] with model and amplitude_m")
    )
    friction: Annotated[
        NoFrictionTable | ViscousTable | CoulombTable | StribeckTable, Field(discriminator="law")
    ] = NoFrictionTable(law="none")
    stop: Annotated[
        NoStopTable | RigidStopTable | KelvinVoigtTable | HuntCrossleyTable, Field(discriminator="law")
    ] = NoStopTable(law="none")
    initial: InitialTable = InitialTable()
    solver: SolverTable = SolverTable()
    motor: MotorTable | None = Field(default=None, description="the table [motor]")
    axis: AxisTable | None = Field(default=None, description="the table [axis]")
    winding: WindingTable | None = Field(default=None, description="the table [winding]")
    sensors: SensorsTable | None = Field(default=None, description="the table [sensors]")
    housing: MotionTable | None = Field(default=None, description="the table [housing]")
    wearer: WearerTable | None = Field(default=None, description="the table [wearer]")
    gait: GaitTable | None = Field(default=None, description="the table [gait]")

    @model_validator(mode="after")
    def _parts_fit(self) -> Self:
        if self.motor is not None and self.drive.model == "ideal":
            raise ValueError(
                f"motor is given while drive.model = {self.drive.model!r}; "
                "delete the table [motor], or set drive.model = 'motor'"
            )
        if self.winding is not None and self.drive.model != "dq-motor":
            raise ValueError(
                f"winding is given while drive.model = {self.drive.model!r}; "
                "delete the table [winding], or set drive.model = 'dq-motor'"
            )
        if isinstance(self.stop, RigidStopTable) and self.initial_x_m > self.stop.position_m:
            key = "initial.x_m" if self.initial.x_m is not None else "striker.rest_length_m"
            raise ValueError(
                f"{key} = {self.initial_x_m} starts the striker beyond the rigid stop at "
                f"stop.position_m = {self.stop.position_m}; start at most there (initial.x_m), or make the "
                "stop soft"
            )
        if self.gait is not None and self.housing is not None:
            raise ValueError(
                "gait and housing are both given; each says how the housing moves, delete the table "
                "[housing] or the table [gait]"
            )
        self._speeds_fit()
        self._wearer_fits()
        self._method_fits()
        return self

    def _speeds_fit(self) -> None:
        """Work per simulated second grows with the crank's speed and the striker's own."""
        speeds = {"sqrt(striker.spring_n_m / striker.mass_kg)": self.natural_rad_s}
        drive = self._drive()
        if isinstance(drive, IdealDrive):
            speeds["the drive's speed"] = drive.omega_rad_s
        for name, speed_rad_s in speeds.items():
            if speed_rad_s > LARGEST_SPEED_RAD_S:
                raise ValueError(
                    f"{name} = {speed_rad_s:g} rad/s is beyond {LARGEST_SPEED_RAD_S:g} rad/s, for which the "
                    "solvers take too long; make it slower"
                )

    def _wearer_fits(self) -> None:
        if self.wearer is None:
            return
        if self.stop.law not in ("kelvin-voigt", "hunt-crossley"):
            raise ValueError(
                f"wearer is given while stop.law = {self.stop.law!r}; a wearer feels a force, which only "
                "a soft stop has: set stop.law = 'hunt-crossley' or 'kelvin-voigt', or delete the table "
                "[wearer]"
            )
        if self.friction.law in ("coulomb", "stribeck"):
            raise ValueError(
                f"wearer is given while friction.law = {self.friction.law!r}; a striker that sticks against "
                "a moving foot plate is not modelled: set friction.law = 'viscous' or 'none', or delete the "
                "table [wearer]"
            )

    def _method_fits(self) -> None:
        if self.solver.method not in ("exact", "stepping"):
            return
        beyond = [
            f"{key} = {value!r}"
            for key, value, possible in (
                ("drive.model", self.drive.model, ("ideal",)),
                ("friction.law", self.friction.law, ("none", "viscous", "coulomb")),
                ("stop.law", self.stop.law, ("none", "rigid")),
            )
            if value not in possible
        ]
        beyond += [
            key
            for key, is_given in (
                ("drive.rod_m", self.drive.rod_m is not None),
                ("housing.harmonic", self.housing is not None and self.housing.harmonic is not None),
                ("housing.shock", self.housing is not None and self.housing.shock is not None),
                ("gait", self.gait is not None),
            )
            if is_given
        ]
        if beyond and self.solver.method == "exact":
            raise ValueError(
                f"solver.method = 'exact' has no closed form for {' and '.join(beyond)}; "
                "use 'auto' or 'adaptive'"
            )
        rigid_only = [fault for fault in beyond if not fault.startswith("friction")]
        if rigid_only and self.solver.method == "stepping":
            raise ValueError(
                f"solver.method = 'stepping' has no {' and no '.join(rigid_only)}; use 'auto' or 'adaptive'"
            )

    @property
    def natural_rad_s(self) -> float:
        """ω = √(c/m_B), rad/s."""
        return math.sqrt(self.striker.spring_n_m / self.striker.mass_kg)

    @property
    def initial_x_m(self) -> float:
        """Where the striker starts, m."""
        return self.striker.rest_length_m if self.initial.x_m is None else self.initial.x_m

    def parts(self, seed: int = 1) -> Parts:
        """The records that kernels are specialised for; of a walk the strides are sampled with `seed`."""
        return Parts(
            self._striker(),
            self._drive(),
            self._friction(),
            self._stop(),
            Sine() if self.drive.rod_m is None else SliderCrank(self.drive.rod_m),
            self._housing(seed),
            self._wearer(),
            self._winding(),
        )

    def _wearer(self) -> Wearer:
        return NoWearer() if self.wearer is None else Ankle(*self.wearer.model_dump().values())

    def _striker(self) -> Striker:
        striker = Striker(**self.striker.model_dump())
        if self.housing is None:
            return striker
        return striker._replace(gravity_m_s2=striker.gravity_m_s2 * math.cos(self.housing.tilt_rad))

    def _walking(self, gait: GaitTable, seed: int) -> Walking:
        # χ = φ + w sin² π φ reaches the curves' toe-off at φ = stance_share.
        stance = gait.stance_share
        warp = (TOE_OFF - stance) / math.sin(math.pi * stance) ** 2
        rows = draw_strides(gait.walk(), np.random.default_rng((seed, STRIDES_STREAM)))
        return Walking(*gait.direction, gait.mount_m, self.striker.gravity_m_s2, warp, rows)

    def _housing(self, seed: int) -> Housing:
        housing = self.housing
        if self.gait is not None:
            return self._walking(self.gait, seed)
        if housing is None:
            return Level()
        along_m_s2 = self.striker.gravity_m_s2 * math.sin(housing.tilt_rad)
        swing, shock = housing.harmonic, housing.shock
        if swing is None and shock is None:
            return Tilted(along_m_s2)
        return Moving(
            along_m_s2,
            *(
                (swing.amplitude_m_s2, 2.0 * math.pi * swing.frequency_hz, swing.phase_rad)
                if swing
                else (0.0,) * 3
            ),
            *((shock.peak_m_s2, shock.start_s, shock.duration_s) if shock else (0.0,) * 3),
        )

    def _drive(self) -> Drive:
        drive = self.drive
        if isinstance(drive, TorqueDriveTable):
            motor = self.motor or MotorTable()
            return MotorDrive(drive.amplitude_m, drive.phase_rad, **motor.model_dump())
        units = (
            (drive.ratio, self.natural_rad_s),
            (drive.frequency_hz, 2.0 * math.pi),
            (drive.speed_rad_s, 1.0),
        )
        speed = sum(value * unit for value, unit in units if value is not None)  # exactly one is given
        return IdealDrive(drive.amplitude_m, speed, drive.phase_rad)

    def _winding(self) -> Winding:
        if not isinstance(self.drive, DqMotorDriveTable):
            return Settled()
        winding, inductance_h = self.winding or WindingTable(), (self.motor or MotorTable()).inductance_h
        return DqWinding(
            winding.d_inductance_h or inductance_h,
            winding.q_inductance_h or inductance_h,
            winding.bandwidth_rad_s,
            _unevenness((wave.order, wave.amplitude_n_m, wave.phase_rad) for wave in winding.cogging),
            _unevenness((wave.order, wave.share, wave.phase_rad) for wave in winding.ripple),
        )

    def _friction(self) -> Friction:
        friction = self.friction
        if isinstance(friction, ViscousTable):
            return Viscous(friction.b_n_s_m)
        if isinstance(friction, CoulombTable):
            return Coulomb(friction.mu, friction.b_n_s_m)
        if isinstance(friction, StribeckTable):
            return Stribeck(friction.mu, friction.mu_s, friction.v_s_m_s, friction.delta, friction.b_n_s_m)
        return NoFriction()

    def _stop(self) -> Stop:
        stop, wearer, mass_kg = self.stop, self._wearer(), self.striker.mass_kg
        if isinstance(stop, RigidStopTable):
            return RigidStop(stop.position_m, stop.restitution)
        if isinstance(stop, KelvinVoigtTable):
            stiffness = stop.stiffness or linear_stiffness(mass_kg, stop.contact_s or math.nan)
            damping = kelvin_voigt_damping(contact_mass_kg(wearer, mass_kg), stiffness, stop.restitution)
            return KelvinVoigt(stop.position_m, stiffness, damping)
        if isinstance(stop, HuntCrossleyTable):
            stiffness = stop.stiffness or hertz_stiffness(
                mass_kg, stop.contact_s or math.nan, CONTACT_REFERENCE_SPEED_M_S
            )
            dissipation = hunt_crossley_dissipation(stop.restitution)
            return HuntCrossley(stop.position_m, stiffness, HERTZ_EXPONENT, dissipation)
        return NoStop()


def _unevenness(waves: Iterable[tuple[int, float, float]]) -> Unevenness:
    """Waves of an order, an amplitude and a phase."""
    found = tuple(Wave(float(order), amplitude, phase_rad) for order, amplitude, phase_rad in waves)
    return Waves(found) if found else Smooth()


def require_scene(scene: object) -> Scene:
    """`scene` itself; raises `SceneError` where a caller gave something else."""
    if not isinstance(scene, Scene):
        raise SceneError(f"scene = {scene!r}: wanted a Scene; make one with load_scene(name, path or tables)")
    return scene


def scene_names() -> list[str]:
    """The scenes that come with the package."""
    return sorted(path.stem for path in SCENES.glob("*.toml"))


def read_scene(source: str | Path | Mapping[str, Any]) -> dict[str, Any]:
    """The raw tables of a named scene, of a TOML file or of a mapping.

    A text is a file's path if it has a slash or ends in `.toml`, else a scene's name. Raises TextInputError.
    """
    if isinstance(source, Mapping):
        return dict(source)
    if not isinstance(source, str | Path):
        raise SceneError(f"scene = {source!r}: wanted a scene's name, the path of a TOML file, or its tables")
    if isinstance(source, str) and not source.endswith(".toml") and "/" not in source:
        path = SCENES / f"{source}.toml"
        if source not in scene_names():
            raise SceneError(
                f"{source!r} is no named scene; {nearest(source, scene_names())} "
                "(a file's path ends in .toml)"
            )
    else:
        path = Path(source)
    remedy = f"give a scene's file, or one of the named scenes: {', '.join(scene_names())}"
    return read_toml(path, "scene file", remedy)


def load_scene(source: str | Path | Mapping[str, Any]) -> Scene:
    """A checked scene from a name, a TOML file or a mapping; raises SceneError, of a file TextInputError."""
    try:
        return Scene.model_validate(read_scene(source))
    except ValidationError as error:
        raise SceneError("\n".join(complaints(error, Scene))) from error
