"""Physical bounds on every key of a scene, and on the solvers' work."""

from typing import Any, get_args

import pytest
from test_scene import changed

from plant_sim import scene_tables
from plant_sim.quantities import quantity_of
from plant_sim.scene import SceneError, load_scene
from plant_sim.scene_tables import Table
from plant_sim.simulation import simulate
from plant_sim.solvers.exact import UnsupportedSceneError

TABLES = [
    thing for thing in vars(scene_tables).values() if isinstance(thing, type) and issubclass(thing, Table)
]


def number_keys() -> list[tuple[type[Table], str]]:
    return [
        (table, key)
        for table in TABLES
        for key, field in table.model_fields.items()
        if {float, int} & {field.annotation, *get_args(field.annotation)}
    ]


@pytest.mark.parametrize(("table", "key"), number_keys())
@pytest.mark.parametrize("value", [1e308, -1e308, 1e200])
def test_every_number_has_a_largest_size(table: type[Table], key: str, value: float) -> None:
    whole = table.model_fields[key].annotation is int
    with pytest.raises(ValueError, match=key):
        table.model_validate({key: int(value) if whole else value})


@pytest.mark.parametrize(("table", "key"), number_keys())
def test_a_number_that_is_above_0_has_a_smallest_size(table: type[Table], key: str) -> None:
    if not any(getattr(one, "gt", None) == 0.0 for one in table.model_fields[key].metadata):
        return  # 0 is allowed, and what is next to it does what 0 does
    with pytest.raises(ValueError, match=key):
        table.model_validate({key: 1e-308})


def test_each_bound_has_its_reason() -> None:
    for _, key in number_keys():
        assert quantity_of(key).reason


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"striker.mass_kg": 1e308}, "striker.mass_kg = 1e+308 is not a size from 1e-06 to 1e+06"),
        ({"striker.mass_kg": 1e-308}, "striker.mass_kg = 1e-308 is not a size from 1e-06 to 1e+06"),
        ({"striker.mass_kg": 1e-6, "striker.spring_n_m": 1e10}, "rad/s"),
        ({"drive.ratio": 1e6}, "rad/s"),
    ],
)
def test_a_scene_beyond_bounds_is_refused_with_the_key(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError) as refusal:
        load_scene(changed("table1-viscous", changes))
    assert said in str(refusal.value)


def test_a_run_of_too_many_steps_is_refused() -> None:
    scene = load_scene(
        changed("table1-viscous", {"solver": {"method": "stepping", "step_s": 1e-9}, "drive.ratio": 1.0})
    )
    with pytest.raises(UnsupportedSceneError, match=r"solver\.step_s"):
        simulate(scene, 10.0)
