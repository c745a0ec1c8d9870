"""A tilted and a moving housing: closed forms, the other solver and the accelerometers."""

import math
from typing import Any

import pytest
from changed_scenes import TILT, changed

from plant_sim.plant import Plant
from plant_sim.result import MotionState, Phase
from plant_sim.scene import Scene, load_scene
from plant_sim.simulation import simulate
from plant_sim.solvers.adaptive import adaptive

G = 9.80665
QUIET = {"noise_m_s2_rthz": 0.0, "bias_m_s2": 0.0, "count_m_s2": 1e-9, "range_m_s2": 1e5}
SENSORS = {"striker_low": {**QUIET, "bandwidth_hz": 150.0}, "striker_high": QUIET, "housing": QUIET}


def scene(changes: dict[str, Any], name: str = "table1-viscous") -> Scene:
    return load_scene(changed(name, changes))


@pytest.mark.parametrize("method", ["adaptive", "exact"])
def test_a_tilted_striker_comes_to_rest_where_the_spring_carries_it(method: str) -> None:
    """x = l0 − m g sin α / c, and at first it falls by −g sin α."""
    changes = {**TILT, "drive.amplitude_m": 0.0, "friction.b_n_s_m": 20.0, "solver.method": method}
    result = simulate(scene(changes), 60.0)
    assert result.method == method
    assert result.final.x_m == pytest.approx(0.12 - 0.8 * G * math.sin(0.2) / 70.0, abs=1e-12)
    # All that gravity gave is in the spring or rubbed off.
    drop = 0.8 * G * math.sin(0.2)
    assert result.energy.housing_work_j == pytest.approx(drop * drop / 70.0, rel=1e-9)
    assert result.energy.stored_change_j == pytest.approx(0.5 * drop * drop / 70.0, rel=1e-9)


@pytest.mark.parametrize("into_s", [0.0, 0.05])
def test_a_shock_begins_and_ends_at_a_time_that_is_off_by_a_rounding(into_s: float) -> None:
    """After a day a step that ends where a shock begins or ends may end a rounding before."""
    start_s = 86400.03
    shock = {"peak_m_s2": 30.0, "start_s": start_s, "duration_s": 0.05}
    parts = scene({"housing.shock": shock, "solver.method": "adaptive"}).parts()
    finals = []
    for time_s in (start_s + into_s, math.nextafter(start_s + into_s, 0.0)):
        start = MotionState(time_s, 0.12, 0.0, 0.0, 1.0, Phase.FLIGHT)
        finals.append(adaptive.simulate(parts, start, time_s + 0.1).final)
    assert finals[1].v_m_s == pytest.approx(finals[0].v_m_s, abs=1e-8)


def test_a_striker_rests_on_the_stop_until_the_housing_falls_away() -> None:
    """Pressed by c (l0 − x_stop) = 0.7 N; a_b = â sin ω t lifts it off where m â sin ω t reaches that."""
    changes = {
        "stop.position_m": 0.11,
        "initial.x_m": 0.11,
        "drive.amplitude_m": 0.0,
        "housing.harmonic": {"amplitude_m_s2": 2.0, "frequency_hz": 0.5},
        "solver.method": "adaptive",
    }
    release_s = math.asin(0.7 / (0.8 * 2.0)) / math.pi
    assert simulate(scene(changes), release_s - 1e-6).final.phase == Phase.REST_ON_STOP
    gone = simulate(scene(changes), release_s + 1e-3).final
    assert gone.phase == Phase.FLIGHT
    jerk = 2.0 * math.pi * math.cos(math.pi * release_s)
    assert gone.x_m - 0.11 == pytest.approx(-jerk * 1e-9 / 6.0, rel=1e-2)


def test_a_tilted_module_at_rest_reads_gravity_at_once() -> None:
    changes = {
        **TILT,
        "sensors": SENSORS,
        "drive.amplitude_m": 0.0,
        "friction": {"law": "coulomb", "mu": 0.5},
    }
    plant = Plant(scene(changes), seed=1)
    for _ in range(3):
        reading = plant.sense()
        for value in (reading.striker_low_m_s2, reading.striker_high_m_s2, reading.housing_m_s2):
            assert value == pytest.approx(G * math.sin(0.2), abs=1e-8)
        plant.advance(0.0, 1e-3)
    assert plant.state.phase == Phase.STICK
