"""The functions of FMUs, by the arguments of the process that compiles them."""

import json

from plant_sim.scene import load_scene
from tools.fmu.machine_code import Functions
from tools.fmu.plant import PlantModel
from tools.fmu.plant_node import PlantNodeModel, shared_functions

ANY_SCENE = "table1-motor-soft"


def functions_of(kind: str, scene: str = "", seed: str = "0") -> Functions:
    """The functions of a scene, as JSON, with a seed; or those that all scenes share."""
    any_plant = PlantModel(load_scene(ANY_SCENE), 0)
    if kind == "plant-shared":
        return any_plant.shared_functions()
    if kind == "node-shared":
        return shared_functions(any_plant.run_type())
    its_scene = load_scene(json.loads(scene))
    if kind == PlantNodeModel.kind:
        return PlantNodeModel(its_scene, int(seed), period_s=1e-3).functions()
    return PlantModel(its_scene, int(seed)).functions()
