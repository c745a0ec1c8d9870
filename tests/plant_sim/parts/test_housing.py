"""A tilted and a moving housing: closed forms, the other solver and the accelerometers."""

import math
from typing import Any

import numpy as np
import pytest
from changed_scenes import TILT, changed
from scipy.integrate import solve_ivp

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


@pytest.mark.parametrize("shock_s", [1e-3, 5e-3, 3e-2])
def test_a_shock_at_rest_in_a_pad_meets_the_damping_of_its_speed(shock_s: float) -> None:
    """A shock of 1 m/s, however long it takes; the slow touch-down before it would damp a thousand times."""
    peak_m_s2 = -1.0 * math.pi / (2.0 * shock_s)
    scene = load_scene(
        {
            "striker": {"mass_kg": 0.8, "spring_n_m": 70.0, "rest_length_m": 0.12},
            "drive": {"model": "ideal", "amplitude_m": 0.0, "speed_rad_s": 0.0},
            "friction": {"law": "viscous", "b_n_s_m": 0.2},
            "stop": {"law": "hunt-crossley", "position_m": 0.115, "restitution": 0.5, "contact_s": 0.01},
            "initial": {"x_m": 0.11},
            "housing": {"shock": {"peak_m_s2": peak_m_s2, "start_s": 5.0, "duration_s": shock_s}},
        }
    )
    stop = scene.parts().stop
    pressed_m = (70.0 * 0.005 / stop.stiffness_n_per_mn) ** (1.0 / 1.5)
    resting_j = stop.stiffness_n_per_mn * pressed_m**2.5 / 2.5
    damping_s_m = stop.dissipation / math.sqrt(1.0 + 2.0 * resting_j / 0.8)

    def push_n(depth, v):
        return stop.stiffness_n_per_mn * max(depth, 0.0) ** 1.5 * max(1.0 + damping_s_m * v, 0.0)

    def slopes(t, state):
        depth, v = state
        a_b = peak_m_s2 * math.sin(math.pi * t / shock_s) if t < shock_s else 0.0
        return v, (70.0 * (0.005 - depth) - 0.2 * v - push_n(depth, v)) / 0.8 - a_b

    times_s = np.arange(1, 401) * 1e-4
    reference = solve_ivp(
        slopes, (0.0, 0.0401), [pressed_m, 0.0], "DOP853", times_s, rtol=1e-10, atol=1e-13, max_step=1e-4
    )
    plant = Plant(scene, seed=1)
    plant.advance(0.0, 5.0)
    seen = []
    for _ in times_s:
        plant.advance(0.0, 1e-4)
        seen.append((plant.now.stop_force_n, plant.now.v_m_s))
    forces_n, speeds_m_s = np.array(seen).T
    expected_n = [push_n(*state) for state in reference.y.T]
    assert forces_n == pytest.approx(np.array(expected_n), abs=1e-3 * max(expected_n))
    assert speeds_m_s == pytest.approx(reference.y[1], abs=1e-4)
    assert plant.energy.residual < 1e-6
