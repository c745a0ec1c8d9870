"""Which solver a scene is given, and that a result says so."""

from typing import Any

import pytest
from changed_scenes import changed

from plant_sim.plant import Plant, PlantError
from plant_sim.scene import Scene, load_scene
from plant_sim.simulation import simulate


def scene(name: str, **solver: object) -> Scene:
    return load_scene(changed(name, {f"solver.{key}": value for key, value in solver.items()}))


@pytest.mark.parametrize(
    ("name", "changes", "method", "why"),
    [
        ("table1-viscous", {}, "exact", ""),
        ("table1-coulomb", {}, "exact", ""),
        ("table1-stribeck", {}, "adaptive", "stribeck"),
        ("table1-motor-soft", {}, "adaptive", "motor"),
        ("table1-viscous", {"drive.rod_m": 0.1}, "adaptive", "rod"),
        ("table1-walking", {}, "adaptive", "gait"),
    ],
)
@pytest.mark.parametrize("accuracy", [1e-13, 1e-2])
def test_auto_takes_the_closed_form_if_there_is_one(
    name: str, changes: dict[str, Any], method: str, why: str, accuracy: float
) -> None:
    result = simulate(load_scene(changed(name, changes | {"solver.accuracy": accuracy})), 0.1)
    assert result.method == method
    assert result.notes[0].startswith(f"auto took {method}")
    assert why in result.notes[0]


@pytest.mark.parametrize("method", ["exact", "adaptive"])
def test_a_method_that_was_asked_for_needs_no_explanation(method: str) -> None:
    result = simulate(scene("table1-viscous", method=method), 0.1)
    assert (result.method, result.notes) == (method, ())


def test_ticks_are_those_of_the_adaptive_solver_and_no_other_is_promised() -> None:
    assert Plant(scene("table1-viscous", method="adaptive"), seed=0).state.x_m == 0.12
    with pytest.raises(PlantError, match=r"solver.method = 'exact'.*set it to 'auto' or 'adaptive'"):
        Plant(scene("table1-viscous", method="exact"), seed=0)
