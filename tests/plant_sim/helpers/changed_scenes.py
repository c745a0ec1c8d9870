"""Scenes with values changed by dotted keys."""

import copy
from typing import Any

from plant_sim.scene import read_scene

DELETE = object()


def changed(name: str, changes: dict[str, Any]) -> dict[str, Any]:
    scene = copy.deepcopy(read_scene(name))
    for dotted, value in changes.items():
        *tables, key = dotted.split(".")
        table = scene
        for step in tables:
            table = table.setdefault(step, {})
        if value is DELETE:
            del table[key]
        else:
            table[key] = value
    return scene
