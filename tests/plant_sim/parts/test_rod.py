"""A finite connecting rod: its geometry, its load on the motor, and the sine as its limit."""

import math
from typing import Any

import numpy as np
import pytest
from changed_scenes import DELETE, changed
from scipy.optimize import brentq

from plant_sim.parts.linkage import Sine, SliderCrank, crank_torque_n_m, piston_m, sine_at
from plant_sim.plant import Plant
from plant_sim.result import Phase
from plant_sim.scene import Scene, SceneError, load_scene
from plant_sim.simulation import simulate

ROD = SliderCrank(0.06)
A = 0.02
ANGLES = np.linspace(-math.pi, math.pi, 41)


def scene(changes: dict[str, Any], name: str = "table1-viscous") -> Scene:
    return load_scene(changed(name, changes))


def test_crank_rod_and_piston_close_their_triangle() -> None:
    """The crank pin (A cos θ, A sin θ) is a rod's length from the piston at L + x_A on the axis."""
    for theta in ANGLES:
        pin = complex(A * math.sin(theta), A * math.cos(theta))
        assert abs(0.06 + piston_m(ROD, A, theta) - pin) == pytest.approx(0.06, rel=1e-14)
    assert piston_m(ROD, A, math.pi / 2.0) == pytest.approx(A, rel=1e-15)
    assert piston_m(ROD, A, -math.pi / 2.0) == pytest.approx(-A, rel=1e-15)
    assert piston_m(ROD, A, 0.0) == pytest.approx(-A * A / (2.0 * 0.06), rel=0.03)


def test_the_cranks_torque_is_the_work_of_the_pistons_force() -> None:
    """F dx_A = T dθ, by central differences."""
    for theta in ANGLES:
        step = 1e-5
        slope = (piston_m(ROD, A, theta + step) - piston_m(ROD, A, theta - step)) / (2.0 * step)
        assert crank_torque_n_m(ROD, 7.0, A, theta) == pytest.approx(7.0 * slope, abs=1e-9)


@pytest.mark.parametrize("linkage", [Sine(), ROD, SliderCrank(0.0201)])
def test_a_level_is_reached_at_its_angle(linkage: Sine | SliderCrank) -> None:
    for level in (-0.0199, -0.013, 0.0, 0.004, 0.0199):
        angle = brentq(lambda theta: piston_m(linkage, A, theta) - level, -math.pi / 2.0, math.pi / 2.0)  # noqa: B023
        assert math.asin(sine_at(linkage, A, level)) == pytest.approx(angle, abs=1e-9)
    for level in (-0.021, 0.021):
        assert abs(sine_at(linkage, A, level)) > 1.0


def test_a_long_rod_is_a_sine() -> None:
    """x_A differs by A² cos² θ / 2L at most, and so does, about, the motion."""
    free = {"stop.position_m": 0.4, "drive.ratio": 0.7}
    sine = simulate(scene(free), 5.0, samples_s=0.01).samples
    assert sine is not None
    assert np.max(sine.x_m) < 0.3
    away = []
    for rod_m in (0.1, 10.0, 1000.0):
        rod = simulate(scene({**free, "drive.rod_m": rod_m}), 5.0, samples_s=0.01).samples
        assert rod is not None
        away.append(float(np.max(np.abs(rod.x_m - sine.x_m))))
    assert 1e-4 < away[0] < 10.0 * A * A / (2.0 * 0.1)
    assert away[1] == pytest.approx(away[0] / 100.0, rel=0.3)
    assert away[2] == pytest.approx(away[0] / 10000.0, rel=0.3)


def test_a_striker_breaks_away_at_the_rods_angle() -> None:
    """c x_A(θ) = μ m g."""
    module = scene({"drive.rod_m": 0.045}, "table1-coulomb")
    level = 0.2 * 0.8 * 9.80665 / 70.0
    rod = SliderCrank(0.045)
    angle = brentq(lambda theta: piston_m(rod, 0.03, theta) - level, 0.0, math.pi / 2.0, xtol=1e-15)
    release_s = angle / module.parts().drive.omega_rad_s
    assert simulate(module, release_s - 1e-7).final.phase == Phase.STICK
    assert simulate(module, release_s + 1e-3).final.phase == Phase.FLIGHT


def test_the_motor_feels_the_rod() -> None:
    """A standing crank whose spring is stretched: J θ'' = −T_crank."""
    changes = {"drive.rod_m": 0.05, "initial.x_m": 0.13, "motor.dry_n_m": 0.0, "drive.phase_rad": 0.5}
    plant = Plant(scene({**changes, "sensors": DELETE}, "table1-motor-soft"), seed=1)
    plant.advance(0.0, 1e-6)
    force = 70.0 * (piston_m(SliderCrank(0.05), A, 0.5) + 0.12 - 0.13)
    torque = crank_torque_n_m(SliderCrank(0.05), force, A, 0.5)
    assert plant.state.omega_rad_s == pytest.approx(-torque / 5e-4 * 1e-6, rel=1e-4)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"drive.rod_m": 0.02}, "drive.rod_m = 0.02 is not longer than the crank"),
        ({"drive.rod_m": -1.0}, "drive.rod_m = -1.0 is not a number greater than 0"),
        ({"drive.rod_m": 0.1, "solver.method": "exact"}, "'exact' has no closed form for drive.rod_m"),
    ],
)
def test_what_makes_no_sense_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError, match=said):
        scene(changes)


def test_auto_takes_the_adaptive_solver() -> None:
    result = simulate(scene({"drive.rod_m": 0.1}), 1.0)
    assert result.method == "adaptive"
    assert "rod" in result.notes[0]
