"""Which solver a scene is given, and that the choice keeps its word."""

import math

import numpy as np
import pytest
from changed_scenes import changed

from plant_sim.methods import STEPPING_COSTS, choose
from plant_sim.scene import Scene, SceneError, load_scene
from plant_sim.simulation import initial_state, simulate
from plant_sim.solvers import stepping
from plant_sim.solvers.adaptive import adaptive

DRY = "table1-stribeck"


def scene(name: str, **solver: object) -> Scene:
    return load_scene(changed(name, {f"solver.{key}": value for key, value in solver.items()}))


@pytest.mark.parametrize(
    ("name", "accuracy", "method"),
    [
        ("table1-viscous", 1e-9, "exact"),
        ("table1-viscous", 1e-2, "exact"),
        ("table1-coulomb", 1e-13, "exact"),
        (DRY, 1e-9, "adaptive"),
        (DRY, 1e-3, "adaptive"),
        (DRY, 1e-2, "stepping"),
        ("table1-motor-soft", 1e-2, "adaptive"),
    ],
)
def test_auto_takes_the_cheapest_method_that_is_accurate_enough(
    name: str, accuracy: float, method: str
) -> None:
    module = scene(name, accuracy=accuracy)
    assert choose(module, module.parts()).method == method


@pytest.mark.parametrize("accuracy", [1e-9, 1e-2])
def test_a_result_says_what_was_taken(accuracy: float) -> None:
    module = scene(DRY, accuracy=accuracy)
    result = simulate(module, 1.0)
    assert result.method == choose(module, module.parts()).method
    assert any(note.startswith(f"auto took {result.method}") for note in result.notes)


def test_a_method_that_was_asked_for_needs_no_explanation() -> None:
    assert simulate(scene(DRY, method="adaptive"), 1.0).notes == ()


def test_stepping_steps_as_the_scene_says() -> None:
    module = scene(DRY, method="stepping", step_s=1e-3)
    result = simulate(module, 2.0)
    same = stepping.simulate(module.parts(), initial_state(module), 2.0, 1e-3)
    assert result.method == "stepping"
    assert np.array_equal(result.impacts.t_s, same.impacts.t_s)
    assert result.final == same.final


@pytest.mark.parametrize("accuracy", [1e-2, 1e-3, 1e-4, 1e-5])
def test_stepping_finds_the_step_for_an_accuracy(accuracy: float) -> None:
    """Period by period, each from the true state."""
    module = scene(DRY, method="stepping", accuracy=accuracy)
    parts, start = module.parts(), initial_state(module)
    step_s = choose(module, parts).step_s
    assert step_s is not None
    period_s = 2.0 * math.pi / parts.drive.omega_rad_s
    grid = period_s * np.arange(9)
    truth = adaptive.simulate(parts, start, grid[-1], grid, accuracy=1e-12).samples
    assert truth is not None
    errors = []
    for n in range(8):
        state = type(start)(
            0.0, truth.x_m[n], truth.v_m_s[n], truth.crank_rad[n], parts.drive.omega_rad_s, start.phase
        )
        final = stepping.simulate(parts, state, period_s, step_s).final
        errors += [
            abs(final.x_m - truth.x_m[n + 1]),
            abs(final.v_m_s - truth.v_m_s[n + 1]) / module.natural_rad_s,
        ]
    assert 1e-3 * accuracy < max(errors) < accuracy


def test_a_finer_step_costs_more_and_errs_less() -> None:
    steps, errors, costs = zip(*STEPPING_COSTS, strict=True)
    assert list(steps) == sorted(steps, reverse=True)
    assert list(errors) == sorted(errors, reverse=True)
    assert list(costs) == sorted(costs)


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        (DRY, {"solver.step_s": 1e-3}, "solver.step_s = 0.001 is given while solver.method = 'auto'"),
        (
            "table1-motor-soft",
            {"solver.method": "stepping"},
            "solver.method = 'stepping' has no drive.model = 'motor' and no stop.law = 'hunt-crossley'",
        ),
        (DRY, {"solver.method": "stepping", "solver.step_s": 0.0}, "solver.step_s = 0.0 is not a number"),
    ],
)
def test_what_a_method_cannot_do_is_refused(name: str, changes: dict[str, object], said: str) -> None:
    with pytest.raises(SceneError) as refusal:
        load_scene(changed(name, changes))
    assert str(refusal.value).startswith(said)
