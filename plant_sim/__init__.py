"""The vibro-impact module (striker, drive, friction, stop, motor and sensors) and its solvers.

`load_scene` reads a scene, `simulate` runs it from start to end, `Plant` advances it tick by tick. The module
of a name is imported when the name is first used, because importing the solvers takes a second.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plant_sim.plant import Plant as Plant
    from plant_sim.plant import PlantError as PlantError
    from plant_sim.result import EnergyLedger as EnergyLedger
    from plant_sim.result import Impact as Impact
    from plant_sim.result import MotionState as MotionState
    from plant_sim.result import Observation as Observation
    from plant_sim.result import Phase as Phase
    from plant_sim.result import SimulationResult as SimulationResult
    from plant_sim.scene import Scene as Scene
    from plant_sim.scene import SceneError as SceneError
    from plant_sim.scene import load_scene as load_scene
    from plant_sim.scene import read_scene as read_scene
    from plant_sim.scene import scene_names as scene_names
    from plant_sim.simulation import SimulationError as SimulationError
    from plant_sim.simulation import simulate as simulate

_NAMES = {
    "plant": ("Plant", "PlantError"),
    "result": ("EnergyLedger", "Impact", "MotionState", "Observation", "Phase", "SimulationResult"),
    "scene": ("Scene", "SceneError", "load_scene", "read_scene", "scene_names"),
    "simulation": ("SimulationError", "simulate"),
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"plant_sim has no {name}; its names are {', '.join(sorted(_MODULES))}")
    return getattr(importlib.import_module(f"plant_sim.{_MODULES[name]}"), name)
