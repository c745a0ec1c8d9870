"""The parameters over which branches are followed: their values in a scene, and scenes with other values."""

import math
from typing import Any, NamedTuple

from plant_sim.parts.drive import IdealDrive
from plant_sim.scene import Scene

TURN_RAD = 2.0 * math.pi


class Parameter(NamedTuple):
    """A parameter of a scene: its table and key, unit, typical size, and the range that branches cover."""

    table: str
    key: str
    unit: str
    scale: float
    low: float
    high: float


PARAMETERS = {
    "ratio": Parameter("drive", "ratio", "", 1.0, 0.3, 2.5),
    "gap": Parameter("stop", "position_m", "m", 0.06, 0.0, 0.2),
    "mu": Parameter("friction", "mu", "", 0.2, 0.0, 1.0),
    "b": Parameter("friction", "b_n_s_m", "N s/m", 0.5, 0.0, 5.0),
    "amplitude": Parameter("drive", "amplitude_m", "m", 0.03, 1e-4, 0.1),
    "restitution": Parameter("stop", "restitution", "", 0.5, 0.0, 1.0),
}
"""The parameters of branches by name; the gap is measured from the rest length."""


def value_in(scene: Scene, name: str) -> float:
    """The value of a parameter (`PARAMETERS`) in a scene."""
    if name == "ratio":
        drive = scene.parts().drive
        assert isinstance(drive, IdealDrive)
        return drive.omega_rad_s / scene.natural_rad_s
    parameter = PARAMETERS[name]
    value = float(getattr(getattr(scene, parameter.table), parameter.key))
    return value - scene.striker.rest_length_m if name == "gap" else value


def with_values(scene: Scene, values: dict[str, float]) -> Scene:
    """The scene with other values of some parameters; Stribeck's μ_s/μ stays as it is, or μ_s − μ if μ is 0.

    The values are not checked, so that a curve may look beyond its end.
    """
    tables: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        parameter = PARAMETERS[name]
        keys = tables.setdefault(parameter.table, {})
        keys[parameter.key] = value + scene.striker.rest_length_m if name == "gap" else value
        if name == "ratio":
            keys.update(frequency_hz=None, speed_rad_s=None)
        if name == "mu" and scene.friction.law == "stribeck":
            mu, mu_s = scene.friction.mu, scene.friction.mu_s
            keys["mu_s"] = value * mu_s / mu if mu > 0.0 else value + mu_s
    changed = {name: getattr(scene, name).model_copy(update=keys) for name, keys in tables.items()}
    return scene.model_copy(update=changed)
