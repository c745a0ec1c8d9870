"""Physical bounds on every key of a scene, and on the solvers' work."""

from typing import Any

import pytest
from changed_scenes import changed

from plant_sim.plant import Plant
from plant_sim.scene import Scene, SceneError, load_scene, scene_names
from plant_sim.simulation import simulate
from plant_sim.solvers.cost import ALLOWANCE, SolverError, debt
from plant_sim.tables.quantities import quantity_of
from plant_sim.tables.table import Table, tables_in

NUMBERS: list[tuple[type[Table], str]] = [
    (table, key)
    for table in tables_in(Scene)
    for key, field in table.model_fields.items()
    if field.annotation is int or quantity_of(field).unit or quantity_of(field) in field.metadata
]


def test_every_number_has_a_largest_size() -> None:
    for table, key in NUMBERS:
        whole = table.model_fields[key].annotation is int
        for value in (1e308, -1e308, 1e200):
            with pytest.raises(ValueError, match=key):
                table.model_validate({key: int(value) if whole else value})
    assert len(NUMBERS) > 80


def test_a_number_that_is_not_below_0_has_a_smallest_size() -> None:
    """Where the striker is, or which way it goes, 1e-308 is as good as 0."""
    positive = [
        (table, key)
        for table, key in NUMBERS
        if any(
            0.0 in (getattr(one, "gt", None), getattr(one, "ge", None))
            for one in table.model_fields[key].metadata
        )
    ]
    for table, key in positive:
        with pytest.raises(ValueError, match=key):
            table.model_validate({key: 1e-308})
    assert len(positive) > 40


def test_a_number_without_a_quantity_is_no_key() -> None:
    with pytest.raises(TypeError, match=r"Bare\.mu_s is a float without a quantity"):
        type("Bare", (Table,), {"__annotations__": {"mu_s": float | None}})


def test_the_unit_is_that_of_the_field_whatever_its_name_ends_in() -> None:
    """μ_s is no duration."""
    scene = load_scene(changed("table1-stribeck", {"friction.mu_s": 1e8}))
    assert scene.friction.mu_s == 1e8


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"striker.mass_kg": 1e308}, "striker.mass_kg = 1e+308 is not a size from 1e-06 to 1e+06"),
        ({"striker.mass_kg": 1e-308}, "striker.mass_kg = 1e-308 is not a size from 1e-06 to 1e+06"),
        ({"drive.ratio": 1e-308}, "drive.ratio = 1e-308 is not a size from 1e-15 to 1e+09"),
        ({"striker.mass_kg": 1e-6, "striker.spring_n_m": 1e10}, "rad/s"),
        ({"drive.ratio": 1e6}, "rad/s"),
    ],
)
def test_a_scene_beyond_bounds_is_refused_with_the_key(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError) as refusal:
        load_scene(changed("table1-viscous", changes))
    assert said in str(refusal.value)


def test_a_striker_at_rest_on_its_stop_stays_there() -> None:
    """The motor stands, the spring is relaxed and the stop just touched: nothing happens, at little cost."""
    result = simulate(load_scene(changed("table1-motor-soft", {"stop.position_m": 0.12})), 1.0)
    assert (result.final.x_m, result.final.v_m_s) == (0.12, 0.0)
    assert result.impacts.t_s.size == 0


def test_a_striker_is_pushed_out_of_a_stop_that_it_begins_in() -> None:
    scene = load_scene(changed("table1-motor-soft", {"stop.position_m": 0.1199}))
    assert simulate(scene, 1.0).final.x_m < 0.12
    deep = simulate(load_scene(changed("table1-motor-soft", {"stop.position_m": 0.1})), 1.0)
    assert (deep.impacts.t_s[0], deep.energy.residual) == (0.0, pytest.approx(0.0, abs=1e-9))


CREEPING = {"stop.position_m": 0.1, "stop.restitution": 1e-5}
"""20 mm inside a stop that gives hardly anything back: the striker creeps out."""


def test_work_without_end_names_the_stop() -> None:
    with pytest.raises(SolverError, match=r"stop\.contact_s.*initial\.x_m"):
        simulate(load_scene(changed("table1-motor-soft", CREEPING)), 1.0)


def for_a_second(plant: Plant) -> None:
    for _ in range(1000):
        plant.advance(0.0, 1e-3)


def test_the_bound_holds_over_a_run_in_ticks_however_short_they_are() -> None:
    plant = Plant(load_scene(changed("table1-motor-soft", CREEPING)), seed=0)
    with pytest.raises(SolverError, match=r"stop\.contact_s.*initial\.x_m"):
        for_a_second(plant)


def test_short_ticks_of_a_slow_module_cost_nothing() -> None:
    plant = Plant(load_scene(changed("table1-viscous", {"striker.mass_kg": 1e5})), seed=0)
    for _ in range(2000):
        plant.advance(0.0, 1e-7)
    assert plant._memory.progress.debt == 0.0


def test_a_burst_of_work_is_paid_for_by_later_time() -> None:
    assert debt(debt(0.0, 500.0, 0.01), 1.0, 10.0) == 0.0
    assert debt(0.0, 500.0, 0.01) == 400.0


def test_no_scene_of_the_repository_comes_near_the_bound() -> None:
    for name in scene_names():
        plant = Plant(load_scene(name), seed=0)
        most = 0.0
        for _ in range(3000):
            plant.advance(0.05, 1e-3)
            most = max(most, float(plant._memory.progress.debt))
        assert most < 1e-3 * ALLOWANCE, name
