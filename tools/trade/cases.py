"""The scenes on which the cost of methods is measured, each with one difficulty."""

import math
from dataclasses import dataclass
from functools import cached_property

from hil.scenario.settings import apply_settings
from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.parts import Parts
from plant_sim.scene import Scene, load_scene, read_scene


@dataclass(frozen=True)
class Case:
    """A scene, the duration of its run, and its constant torque."""

    name: str
    base: str
    settings: tuple[str, ...]
    until_s: float
    torque_n_m: float = 0.0

    @cached_property
    def scene(self) -> Scene:
        """The checked scene."""
        settings = [f"scene.{setting}" for setting in self.settings]
        return load_scene(apply_settings({"scene": read_scene(self.base)}, settings)["scene"])

    @cached_property
    def parts(self) -> Parts:
        """The scene's parts."""
        return self.scene.parts()

    @property
    def period_s(self) -> float:
        """Forcing period; for a motor the period of the free oscillation."""
        drive = self.parts.drive
        fast = drive.omega_rad_s if isinstance(drive, IdealDrive) else self.scene.natural_rad_s
        return 2.0 * math.pi / fast


CASES = (
    Case("periodic", "table1-viscous", ("drive.ratio=1.0",), 50.0),
    Case("sensitive", "table1-coulomb", ("drive.ratio=0.9",), 20.0),
    # The stop is at the spring's rest length: once a period chatter, rest on the stop, and release.
    Case("chattering", "table1-viscous", ("stop.position_m=0.12", "drive.ratio=0.3"), 50.0),
    Case("sticking", "table1-coulomb", ("drive.amplitude_m=0.024",), 50.0),
    Case("Stribeck", "table1-stribeck", (), 50.0),
    # Without the motor's dry loss, which no peer models, and with a stop smooth enough for Taylor series.
    Case("motor", "gait-motor-soft", ("motor.dry_n_m=0.0", "stop.law=kelvin-voigt"), 3.0, 0.05),
)
