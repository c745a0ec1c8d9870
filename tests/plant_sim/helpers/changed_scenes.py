"""Scenes with values changed by dotted keys; DELETE deletes one."""

from typing import Any

from plant_sim.scene import read_scene, with_values

DELETE = None


def changed(name: str, changes: dict[str, Any]) -> dict[str, Any]:
    return with_values(read_scene(name), changes)
