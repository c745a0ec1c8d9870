"""A scene: the parts of the module and their parameters, read from TOML and checked for consistency.

Lengths are in metres along the striker's axis, positive towards the stop. A missing table means that the part
is not there.
"""

import copy
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator

from plant_sim.parts.drive import DriveTable, IdealDrive, MotorTable
from plant_sim.parts.friction import FrictionTable, NoFrictionTable, is_dry
from plant_sim.parts.housing import Housing, Level, MotionTable
from plant_sim.parts.linkage import Sine, SliderCrank
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import NoStopTable, RigidStopTable, SoftStopTable, StopTable
from plant_sim.parts.strides import sample_strides
from plant_sim.parts.striker import StrikerTable
from plant_sim.parts.walking import TOE_OFF, Walking
from plant_sim.parts.wearer import NoWearer, WearerTable
from plant_sim.parts.winding import IdealCurrent, Winding, WindingTable
from plant_sim.tables.gait_tables import GaitTable
from plant_sim.tables.quantities import LARGEST_SPEED_RAD_S
from plant_sim.tables.scene_tables import InitialTable, SolverTable
from plant_sim.tables.sensor_tables import SensorsTable
from plant_sim.tables.table import Table
from plant_sim.validation_messages import messages_of, nearest
from text_input import TextInputError, read_toml

SCENES = Path(__file__).parent / "scenes"

STRIDES_STREAM = 9
"""Random stream of the strides; the sensors' noise uses the seed's own stream."""


class SceneError(TextInputError):
    """A scene that cannot be simulated; the message has one sentence for each error."""


class Scene(Table):
    """A whole scene; solvers take its `parts()`."""

    striker: StrikerTable = Field(
        description="the table [striker] with mass_kg, spring_n_m and rest_length_m"
    )
    drive: DriveTable = Field(description="the table [drive] with model and amplitude_m")
    friction: FrictionTable = NoFrictionTable(law="none")
    stop: StopTable = NoStopTable(law="none")
    initial: InitialTable = InitialTable()
    solver: SolverTable = SolverTable()
    motor: MotorTable | None = Field(default=None, description="the table [motor]")
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
        """Refuse speeds that are too high: the work per simulated second grows with them."""
        speeds = {"sqrt(striker.spring_n_m / striker.mass_kg)": self.natural_rad_s}
        drive = self.drive.part(self.natural_rad_s, self.motor or MotorTable())
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
        if not isinstance(self.stop, SoftStopTable):
            raise ValueError(
                f"wearer is given while stop.law = {self.stop.law!r}; a wearer feels a force, which only "
                "a soft stop has: set stop.law = 'hunt-crossley' or 'kelvin-voigt', or delete the table "
                "[wearer]"
            )
        if is_dry(self.friction.part()):
            raise ValueError(
                f"wearer is given while friction.law = {self.friction.law!r}; a striker that sticks against "
                "a moving foot plate is not modelled: set friction.law = 'viscous' or 'none', or delete the "
                "table [wearer]"
            )

    @property
    def beyond_closed_form(self) -> list[str]:
        """Keys, with the values of names, that only the adaptive solver can simulate."""
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
        return beyond

    def _method_fits(self) -> None:
        beyond = self.beyond_closed_form
        if beyond and self.solver.method == "exact":
            raise ValueError(
                f"solver.method = 'exact' has no closed form for {' and '.join(beyond)}; "
                "use 'auto' or 'adaptive'"
            )

    @classmethod
    def load(cls, source: str | Path | Mapping[str, Any]) -> Self:
        """A checked scene as `load_scene`, of this class."""
        try:
            return cls.model_validate(read_scene(source))
        except ValidationError as error:
            raise SceneError("\n".join(messages_of(error, cls))) from error

    def with_(self, changes: Mapping[str, object]) -> Self:
        """This scene with other values, by dotted keys as in `with_values`. Raises SceneError.

        >>> load_scene("table1-viscous").with_({"drive.ratio": 1.2}).drive.ratio
        1.2
        """
        return self.load(with_values(self.model_dump(exclude_unset=True), changes))

    @property
    def natural_rad_s(self) -> float:
        """ω = √(c/m_B), rad/s."""
        return math.sqrt(self.striker.spring_n_m / self.striker.mass_kg)

    @property
    def initial_x_m(self) -> float:
        """Initial position of the striker, m."""
        return self.striker.rest_length_m if self.initial.x_m is None else self.initial.x_m

    def parts(self, seed: int = 1) -> Parts:
        """The records of the parts; `seed` samples the strides of a walk."""
        striker = self.striker.part(0.0 if self.housing is None else self.housing.tilt_rad)
        wearer = NoWearer() if self.wearer is None else self.wearer.part()
        return Parts(
            striker=striker,
            drive=self.drive.part(self.natural_rad_s, self.motor or MotorTable()),
            friction=self.friction.part(),
            stop=self.stop.part(striker.mass_kg, wearer),
            linkage=Sine() if self.drive.rod_m is None else SliderCrank(self.drive.rod_m),
            housing=self._housing(seed),
            wearer=wearer,
            winding=self._winding(),
        )

    def _housing(self, seed: int) -> Housing:
        if self.gait is not None:
            return self._walking(self.gait, seed)
        return Level() if self.housing is None else self.housing.part(self.striker.gravity_m_s2)

    def _walking(self, gait: GaitTable, seed: int) -> Walking:
        # χ = φ + w sin² π φ reaches the curves' toe-off at φ = stance_share.
        stance = gait.stance_share
        warp = (TOE_OFF - stance) / math.sin(math.pi * stance) ** 2
        rows = sample_strides(gait, np.random.default_rng((seed, STRIDES_STREAM)))
        return Walking(*gait.direction, gait.mount_m, self.striker.gravity_m_s2, warp, rows)

    def _winding(self) -> Winding:
        if self.drive.model != "dq-motor":
            return IdealCurrent()
        return (self.winding or WindingTable()).part((self.motor or MotorTable()).inductance_h)


def require_scene(scene: object) -> Scene:
    """Return `scene`; raise `SceneError` if it is not a Scene."""
    if not isinstance(scene, Scene):
        raise SceneError(f"scene = {scene!r}: wanted a Scene; make one with load_scene(name, path or tables)")
    return scene


def scene_names() -> list[str]:
    """Names of the scenes that come with the package."""
    return sorted(path.stem for path in SCENES.glob("*.toml"))


def read_scene(source: str | Path | Mapping[str, Any]) -> dict[str, Any]:
    """The raw tables of a named scene, of a TOML file or of a mapping.

    A text is a path if it has a slash or ends in `.toml`, otherwise the name of a scene. Raises SceneError.
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
    try:
        tables = read_toml(path, "scene file", remedy)
    except TextInputError as error:
        raise SceneError(str(error)) from error
    if "striker" not in tables and {"scene", "script", "like"} & set(tables):
        raise SceneError(f"{str(path)!r} is a scenario; use `vibrohil run`, or {remedy}")
    return tables


def with_values(tables: Mapping[str, Any], changes: Mapping[str, object]) -> dict[str, Any]:
    """A copy of these tables with values replaced by dotted keys, such as `drive.ratio`; None deletes one.

    Raises SceneError for a key within a value that is no table.
    """
    changed: dict[str, Any] = copy.deepcopy(dict(tables))
    for dotted, value in changes.items():
        *path, key = dotted.split(".")
        table = changed
        for index, step in enumerate(path):
            inside = table.setdefault(step, {})
            if not isinstance(inside, dict):
                whole = ".".join(path[: index + 1])
                raise SceneError(
                    f"{whole} = {inside!r} is no table and has no key {dotted!r}; give {whole} itself"
                )
            table = inside
        if value is None:
            table.pop(key, None)
        else:
            table[key] = copy.deepcopy(value)
    return changed


def load_scene(source: str | Path | Mapping[str, Any]) -> Scene:
    """A checked scene from a name, a TOML file or a mapping. Raises SceneError."""
    return Scene.load(source)
