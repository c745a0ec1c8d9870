"""The Taylor series of the adaptive solver against the equations of motion and against steps of DOP853."""

from dataclasses import astuple
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from changed_scenes import KELVIN_VOIGT, changed

from plant_sim.jets import ROW
from plant_sim.kernels import jit
from plant_sim.parts.linkage import SliderCrank
from plant_sim.parts.parts import Parts
from plant_sim.plant import Plant
from plant_sim.scene import load_scene
from plant_sim.sensors.sensing import NO_SENSING
from plant_sim.simulation import initial_state
from plant_sim.solvers.adaptive.adaptive import advance_by, simulate
from plant_sim.solvers.adaptive.motion import derivative, flow_now
from plant_sim.solvers.adaptive.series import expand, series_step_s, state_after
from plant_sim.solvers.adaptive.state_layout import allocate
from plant_sim.solvers.bernstein import ORDER

SHAKEN = {
    "tilt_rad": 0.1,
    "harmonic": {"amplitude_m_s2": 0.5, "frequency_hz": 3.0, "phase_rad": 0.4},
    "shock": {"peak_m_s2": 3.0, "start_s": 0.25, "duration_s": 0.2},
}
WALK = {
    "axis": "forward",
    "pace": [{"at_s": 0.0, "stride_hz": 0.0}, {"at_s": 0.5, "stride_hz": 1.1}],
    "stumble": [{"at_s": 2.5}],
    "stance_share": 0.56,
}
WEARER = {"wearer": {"plate_kg": 1.0, "ankle_n_m": 5e3, "ankle_n_s_m": 20.0}}
PRESSED = {"stop": {**KELVIN_VOIGT, "position_m": 0.02}, "initial.x_m": 0.0201}
"""The striker stays in the stop."""
SCENES: dict[str, tuple[str, dict[str, Any]]] = {
    "viscous": ("table1-viscous", {}),
    "frictionless": ("table1-viscous", {"friction": {"law": "none"}, "stop": {"law": "none"}}),
    "coulomb": ("table1-coulomb", {"stop": KELVIN_VOIGT}),
    "coulomb-pressed": ("table1-coulomb", PRESSED),
    "stribeck": ("table1-stribeck", {}),
    "stribeck-linear": ("table1-stribeck", {"friction.delta": 1.0, **PRESSED}),
    "stuck": ("table1-coulomb", {"friction.mu": 5.0}),
    "tilted": ("table1-viscous", {"housing": {"tilt_rad": 0.1}}),
    "shaken": ("table1-viscous", {"housing": SHAKEN}),
    "walking": ("table1-walking", {"gait.stance_share": 0.56}),
    "worn": ("table1-viscous", {"housing": SHAKEN, **WEARER, **PRESSED}),
    "worn-motor": ("table1-motor-soft", WEARER),
    "motor": ("table1-motor-soft", {"stop": KELVIN_VOIGT}),
    "motor-pressed": ("table1-motor-soft", {"housing": SHAKEN, **PRESSED}),
    "motor-stuck": ("table1-motor-soft", {"motor.dry_n_m": 0.5}),
}
WITHOUT = {
    "rod": ("table1-viscous", {"drive.rod_m": 0.2}),
    "windings": ("table1-dq-motor", {}),
    "pressed": ("table1-viscous", {**PRESSED, "stop.law": "hunt-crossley"}),
    "steeper": ("table1-stribeck", {"friction.delta": 1.5}),
}
"""Scenes with parts of the kinds that have no series."""
T_S, H_S = 0.3, 5e-3
ENDLESS_M = 1e9
"""A rod of this length moves the piston as an endless one does, to 1e-12 m, and has no series."""


@jit
def _expanded(run, h_s):
    expand(run, flow_now(run), ORDER)
    state_after(run.memory[0], h_s, ORDER)


@jit
def _step_s(run):
    memory = run.memory[0]
    return series_step_s(run, flow_now(run), memory.all_scale, 1e-3, 1.0)[0]


@jit
def _slopes(run, tau_s):
    memory = run.memory[0]
    derivative(run.parts, flow_now(run), tau_s, memory.y if tau_s == 0.0 else memory.new, memory.slopes[0])


def module(base: str, changes: dict[str, Any], torque_n_m: float = 0.02) -> Any:
    """A module after a third of a second."""
    scene = load_scene(changed(base, {"sensors": None, **changes}))
    one = allocate(scene.parts(), initial_state(scene), 1e-10, 100, NO_SENSING)
    advance_by(one, torque_n_m, 0.0, T_S)
    return one


@pytest.mark.parametrize("name", SCENES)
def test_a_series_obeys_the_equations_of_motion(name: str) -> None:
    """Its slope is the derivative of all quantities all along a step."""
    one = module(*SCENES[name])
    memory = one.memory[0]
    used = memory.places[: memory.progress.used]
    memory.all_series[[*used, *range(ROW.sine, len(ROW))]] = np.nan  # shows what is read unset
    assert _step_s(one) > 0.0
    for h_s in (0.0, 0.3 * H_S, H_S):
        _expanded(one, h_s)
        _slopes(one, h_s)
        series = memory.all_series[used]
        slopes = (series[:, 1:] * np.arange(1, ORDER + 1) * h_s ** np.arange(ORDER)).sum(axis=1)
        assert slopes == pytest.approx(memory.slopes[0][used], rel=1e-12 if h_s == 0.0 else 1e-9, abs=1e-11)


def test_each_kind_of_part_has_a_scene_with_a_series_or_has_none() -> None:
    modules = [module(*scene) for scene in SCENES.values()]
    without = [module(*scene) for scene in WITHOUT.values()]
    assert [_step_s(one) for one in without] == [0.0] * len(without)
    for slot, kinds in get_type_hints(Parts).items():
        seen = {type(getattr(one.parts, slot)) for one in modules + without}
        assert seen >= set(get_args(kinds)), slot


@pytest.mark.parametrize(
    ("base", "changes", "torque_n_m"),
    [
        ("table1-viscous", {"solver": {"method": "adaptive", "accuracy": 1e-11}}, 0.0),
        ("table1-coulomb", {"solver": {"method": "adaptive", "accuracy": 1e-11}}, 0.0),
        # The friction rises within a fiftieth of the striker's speed, where no term of e^−p showed it before.
        ("table1-stribeck", {"friction.v_s_m_s": 0.01, "solver.accuracy": 1e-11}, 0.0),
        ("table1-stribeck", {"friction.delta": 1.0, "solver.accuracy": 1e-11}, 0.0),
        ("table1-motor-soft", {"stop": KELVIN_VOIGT, "solver.accuracy": 1e-11}, 0.02),
        # The supply limits the torque from some 20 rad/s on, and then holds the speed.
        ("table1-motor-soft", {"stop": KELVIN_VOIGT, "motor.supply_v": 2.0, "solver.accuracy": 1e-11}, 0.05),
        ("table1-motor-soft", {"solver.accuracy": 1e-11}, 0.05),
        ("table1-viscous", {"stop": KELVIN_VOIGT, **WEARER, "solver.accuracy": 1e-11}, 0.0),
        ("table1-motor-soft", {"housing": SHAKEN, "solver.accuracy": 1e-11}, 0.05),
        # It starts to walk, trips, and recovers.
        ("table1-walking", {"gait": WALK, "solver.accuracy": 1e-11}, 0.05),
        # At its dry loss the crank halts and breaks away again.
        ("table1-motor-soft", {"stop": KELVIN_VOIGT, "motor.dry_n_m": 0.019, "solver.accuracy": 1e-11}, 0.02),
    ],
)
def test_a_run_by_series_ends_as_one_by_dop853(base: str, changes: dict[str, Any], torque_n_m: float) -> None:
    scene = load_scene(changed(base, {"sensors": None, **changes}))
    series, stages = (
        simulate(parts, initial_state(scene), 4.0, torque_n_m=torque_n_m, accuracy=scene.solver.accuracy)
        for parts in (scene.parts(), scene.parts()._replace(linkage=SliderCrank(ENDLESS_M)))
    )
    assert len(series.impacts.t_s) == len(stages.impacts.t_s)
    assert series.final.x_m == pytest.approx(stages.final.x_m, abs=2e-9)
    assert series.final.v_m_s == pytest.approx(stages.final.v_m_s, abs=2e-8)
    assert series.final.crank_rad == pytest.approx(stages.final.crank_rad, abs=1e-7)
    for ledger, wanted in zip(astuple(series.energy), astuple(stages.energy), strict=True):
        assert ledger == pytest.approx(wanted, abs=1e-8)


@pytest.mark.parametrize(
    "changes",
    [
        {"friction.v_s_m_s": 1e-6, "solver.accuracy": 1e-11},
        {"friction.v_s_m_s": 1e-4, "solver.accuracy": 1e-9, "sensors": {}},
    ],
)
def test_a_series_shows_the_fall_of_friction_in_every_third_term(changes: dict[str, Any]) -> None:
    """With δ = 2 a striker that sets off under a growing force has the terms t², t⁵, t⁸ … only."""
    scene = load_scene(changed("table1-stribeck", {"friction.delta": 2.0, **changes}))
    plant, parts = Plant(scene, seed=0), scene.parts()._replace(linkage=SliderCrank(ENDLESS_M))
    for _ in range(600):
        plant.advance(0.0, 1e-3)
    stages = simulate(parts, initial_state(scene), 0.6, accuracy=1e-14)
    assert plant.state.x_m == pytest.approx(stages.final.x_m, abs=1e-9)


@pytest.mark.parametrize("period_s", [1e-3, 0.05])
@pytest.mark.parametrize(
    ("base", "changes"),
    [
        ("table1-motor-soft", {"stop": KELVIN_VOIGT, "housing": SHAKEN}),
        ("table1-stribeck", {"friction.v_s_m_s": 0.01, "stop": KELVIN_VOIGT}),
    ],
)
def test_sensors_change_nothing_in_the_motion(base: str, changes: dict[str, Any], period_s: float) -> None:
    with_sensors, without = (
        Plant(load_scene(changed(base, {**changes, "sensors": sensors})), seed=0) for sensors in ({}, None)
    )
    for _ in range(round(2.0 / period_s)):
        for plant in (with_sensors, without):
            plant.advance(0.02, period_s)
        assert with_sensors.now == without.now


def test_sensors_read_the_same_at_the_end_of_long_steps_as_of_short_ones() -> None:
    scene = load_scene(
        changed("table1-motor-soft", {"stop": KELVIN_VOIGT, "housing": SHAKEN, "solver.accuracy": 1e-11})
    )
    often, rarely = Plant(scene, seed=0), Plant(scene, seed=0)
    for _ in range(40):
        rarely.advance(0.02, 0.05)
        for _ in range(50):
            often.advance(0.02, 1e-3)
        assert rarely.run.probe.readings == pytest.approx(often.run.probe.readings, abs=1e-5, rel=1e-8)
