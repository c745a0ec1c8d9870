"""The package as a library: its public names, the numbers it takes, and what it says of others."""

import math
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from changed_scenes import changed

import plant_sim
from plant_sim import Plant, SceneError, load_scene, simulate
from plant_sim.parts.striker import Striker
from plant_sim.plant import PlantError
from plant_sim.result import Samples
from plant_sim.simulation import SimulationError

VISCOUS = load_scene("table1-viscous")


def test_the_package_hands_out_its_public_names() -> None:
    assert plant_sim.simulate is simulate
    with pytest.raises(AttributeError, match=r"plant_sim has no simulator; its names are .*simulate"):
        plant_sim.simulator  # type: ignore[attr-defined]  # noqa: B018  # that is the test


@pytest.mark.parametrize("number", [int, np.int64, np.float64, np.float32, np.uint8])
def test_any_real_number_is_a_time_and_a_spacing(number: Any) -> None:
    result = simulate(VISCOUS, number(10), samples_s=number(2))
    same = simulate(VISCOUS, 10.0, samples_s=2.0)
    assert result.final == same.final
    assert result.samples is not None
    assert same.samples is not None
    assert np.array_equal(result.samples.x_m, same.samples.x_m)


READINGS = [field.name for field in fields(Samples) if field.name != "t_s"]


@pytest.mark.parametrize(
    ("scene", "changes", "torque_n_m"),
    [
        ("table1-motor-soft", {"initial": {"x_m": 0.17, "v_m_s": 0.9}}, 0.05),
        ("table1-dq-motor", {"initial": {"x_m": 0.17, "v_m_s": 0.9}}, 0.05),
        ("table1-viscous", {"drive.ratio": 1.0, "solver.method": "adaptive"}, 0.0),
    ],
)
def test_samples_hold_every_reading_of_a_plant_at_those_times(
    scene: str, changes: dict[str, Any], torque_n_m: float
) -> None:
    one = load_scene(scene).with_({"solver.accuracy": 1e-11, "sensors": None, **changes})
    samples = simulate(one, 1.5, torque_n_m, samples_s=0.01).samples
    assert samples is not None
    plant = Plant(one, seed=0)
    for index in range(len(samples.t_s)):
        for name in READINGS:
            wanted, scale = getattr(plant.now, name), max(1.0, np.abs(getattr(samples, name)).max())
            if index > 0:  # at the start the plant does not know its torque yet
                assert getattr(samples, name)[index] == pytest.approx(wanted, abs=1e-6 * scale), name
        plant.advance(torque_n_m, 0.01)
    assert np.ptp(samples.accel_m_s2) > 1.0
    if torque_n_m != 0.0:
        assert np.ptp(samples.omega_rad_s) > 1.0
        assert samples.current_a[-1] == pytest.approx(torque_n_m / 0.08, rel=0.1)
        assert samples.stop_force_n.max() > 0.0


def test_both_solvers_sample_alike() -> None:
    changes = {"drive.ratio": 1.0, "solver.accuracy": 1e-11}
    exact, adaptive = (
        simulate(VISCOUS.with_({**changes, "solver.method": method}), 3.0, samples_s=0.01).samples
        for method in ("exact", "adaptive")
    )
    for name in READINGS:
        assert getattr(exact, name) == pytest.approx(getattr(adaptive, name), abs=1e-7), name


def test_a_whole_number_does_not_round_later_ones() -> None:
    simulate(VISCOUS, 10)
    assert simulate(VISCOUS, 10.7).final.t_s == 10.7


def test_numpy_scalars_are_numbers_in_a_scene() -> None:
    changes = {
        "striker.mass_kg": np.float32(0.5),
        "striker.spring_n_m": np.int64(70),
        "solver": {"accuracy": np.float64(1e-9)},
    }
    parts = load_scene(changed("table1-viscous", changes)).parts()
    assert parts.striker.mass_kg == 0.5
    assert parts.striker.spring_n_per_m == 70.0
    assert type(parts.striker.mass_kg) is type(parts.striker.spring_n_per_m) is float


def test_ticks_take_any_real_number() -> None:
    plants = (
        Plant(load_scene("table1-motor-soft"), seed=np.int64(1)),
        Plant(load_scene("table1-motor-soft"), 1),
    )
    for torque_n_m, dt_s in ((np.float32(0.0625), np.float64(1e-3)), (1, np.float64(0.5)), (0, 1)):
        plants[0].advance(torque_n_m, dt_s)
        plants[1].advance(float(torque_n_m), float(dt_s))
    assert plants[0].state == plants[1].state


def test_whole_numbers_in_parts_do_not_round_later_ones() -> None:
    """Parts are compiled for their declared types, whatever kind of number came first."""
    scene = load_scene("table1-motor-soft")
    whole = scene.parts()._replace(striker=Striker(1, 70, 0, 10))
    plants = Plant(scene, 1, whole), Plant(scene, 1, whole._replace(striker=Striker(1.0, 70.0, 0.0, 10.0)))
    for plant in plants:
        plant.replace_parts(whole._replace(striker=Striker(0.5, 70.5, 0.0, 10.0)))
        plant.advance(0.1, 1.0)
    assert plants[0].state == plants[1].state


@pytest.mark.parametrize(
    ("until_s", "spacing_s", "count"),
    [(0.3, 0.1, 4), (1.0, 0.1, 11), (0.7, 0.1, 8), (1.0, 0.3, 5), (1.0, 2.0, 2), (7.0, 0.07, 101)],
)
def test_each_sample_is_given_once(until_s: float, spacing_s: float, count: int) -> None:
    samples = simulate(VISCOUS, until_s, samples_s=spacing_s).samples
    assert samples is not None
    assert samples.t_s.size == count
    assert samples.t_s[-1] == until_s
    assert np.all(np.diff(samples.t_s) > 1e-9)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"until_s": "10"}, "until_s = '10': wanted a positive, finite time to run to, in s"),
        ({"until_s": None}, "until_s = None"),
        ({"until_s": True}, "until_s = True"),
        ({"until_s": 1j}, "until_s = 1j"),
        ({"until_s": 10**400}, "until_s = 1000"),
        ({"until_s": 1.0, "torque_n_m": -(10**400)}, "torque_n_m = -1000"),
        ({"until_s": np.array([1.0, 2.0])}, r"until_s = array"),
        ({"until_s": 1.0, "torque_n_m": "much"}, "torque_n_m = 'much': wanted a finite motor torque"),
        ({"until_s": 1.0, "samples_s": 0}, "samples_s = 0: wanted a positive, finite spacing"),
        ({"until_s": 1.0, "samples_s": 1e-12}, "samples_s = 1e-12 requests 1e[+]12 samples"),
    ],
)
def test_what_is_no_such_number_is_refused_in_a_sentence(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(SimulationError, match=said):
        simulate(VISCOUS, **arguments)


def test_what_is_no_scene_is_refused_in_a_sentence() -> None:
    with pytest.raises(
        SceneError, match="scene = 'table1-viscous': wanted a Scene; make one with load_scene"
    ):
        simulate("table1-viscous", 1.0)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="wanted a Scene"):
        Plant({}, seed=1)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="scene = 3: wanted a scene's name, the path of a TOML file, or its"):
        load_scene(3)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="cannot be read"):
        load_scene(Path("nowhere.toml"))


@pytest.mark.parametrize("seed", [-1, 0.5, "1", None, math.nan])
def test_what_is_no_seed_is_refused_in_a_sentence(seed: Any) -> None:
    with pytest.raises(PlantError, match="wanted a whole number of at least 0"):
        Plant(VISCOUS, seed=seed)


def test_a_torque_may_be_a_function_of_time_that_is_held_for_a_tick() -> None:
    scene = load_scene("table1-motor-soft")
    plant = Plant(scene, seed=1)
    for tick in range(300):
        plant.advance(0.1 * math.sin(0.02 * tick), 1e-3)
    final = simulate(scene, 0.3, lambda t_s: 0.1 * math.sin(20.0 * t_s)).final
    assert final.omega_rad_s == pytest.approx(plant.state.omega_rad_s, rel=1e-7)
    assert final.x_m == pytest.approx(plant.state.x_m, abs=1e-9)
    with pytest.raises(SimulationError, match=r"torque_n_m\(0.0\) = nan: wanted a finite motor torque"):
        simulate(scene, 0.3, lambda t_s: math.nan)
    with pytest.raises(SimulationError, match="is given for an ideal drive, which takes none"):
        simulate(VISCOUS, 0.3, lambda t_s: 0.0)
