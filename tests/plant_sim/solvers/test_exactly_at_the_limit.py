"""A pull of exactly what friction, dry loss or stop can hold is held, by every solver; only more moves it."""

import math
from typing import Any

import numpy as np
import pytest
from changed_scenes import changed

from plant_sim.parts.friction import set_off
from plant_sim.plant import Plant
from plant_sim.result import Phase
from plant_sim.scene import load_scene
from plant_sim.simulation import simulate
from plant_sim.solvers.cost import SolverError

METHODS = ["exact", "adaptive"]


@pytest.mark.parametrize(
    ("pull", "growth", "free", "on_stop"),
    [
        (2.0, 0.0, 0, 0),
        (-2.0, 0.0, 0, 0),
        (2.2, 0.0, 1, 0),
        (-2.2, 0.0, -1, -1),
        (1.95, 1.0, 1, 0),
        (1.95, -1.0, 0, 0),
        (-1.95, -1.0, -1, -1),
        (-1.95, 1.0, 0, 0),
        (1.8, 1.0, 0, 0),
        (-1.8, -1.0, 0, 0),
    ],
)
def test_a_body_at_rest_sets_off_beyond_the_limit_or_near_it_under_a_growing_pull(
    pull: float, growth: float, free: int, on_stop: int
) -> None:
    """The limit is 2, and near it is within 0.1."""
    assert set_off(pull, 2.0, 0.1, growth, is_on_stop=False) == free
    assert set_off(pull, 2.0, 0.1, growth, is_on_stop=True) == on_stop


BALANCED: dict[str, Any] = {
    "striker": {"mass_kg": 0.5, "spring_n_m": 64.0, "rest_length_m": 0.125, "gravity_m_s2": 8.0},
    "drive": {"model": "ideal", "amplitude_m": 1.0 / 64.0, "speed_rad_s": 0.0, "phase_rad": 0.5 * math.pi},
    "friction": {"law": "coulomb", "mu": 0.25},
    "stop": {"law": "rigid", "position_m": 0.1875, "restitution": 0.5},
}
"""c A = 1 N = μ m g, without a rounding."""


@pytest.mark.parametrize("torque_n_m", [0.005, -0.005])
def test_a_torque_equal_to_the_dry_loss_turns_nothing(torque_n_m: float) -> None:
    result = simulate(load_scene("table1-motor-soft"), 1.0, torque_n_m=torque_n_m)
    assert result.final.omega_rad_s == 0.0
    assert result.final.crank_rad == 0.0
    assert result.energy.friction_j == 0.0
    more = simulate(load_scene("table1-motor-soft"), 1.0, torque_n_m=torque_n_m * (1.0 + 1e-9))
    assert more.final.omega_rad_s * torque_n_m > 0.0


def test_ticks_of_a_torque_equal_to_the_dry_loss_turn_nothing() -> None:
    plant = Plant(load_scene("table1-motor-soft"), seed=1)
    for _ in range(100):
        plant.advance(0.005, 1e-3)
    assert plant.state.crank_rad == 0.0
    plant.advance(0.0051, 1e-3)
    assert plant.state.omega_rad_s == pytest.approx(0.0001 / 5e-4 * 1e-3, rel=1e-3)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("speed_rad_s", [0.0, 1.0, 20.0])
def test_a_spring_that_pulls_as_much_as_dry_friction_holds_moves_nothing(
    method: str, speed_rad_s: float
) -> None:
    """Whether the crank stands there, or the piston turns round there."""
    tables = BALANCED | {"solver": {"method": method}}
    tables["drive"] = BALANCED["drive"] | {"speed_rad_s": speed_rad_s}
    result = simulate(load_scene(tables), 10.0)
    assert (result.final.x_m, result.final.v_m_s) == (0.125, 0.0)
    assert result.final.phase == Phase.STICK
    assert result.energy.friction_j == 0.0


@pytest.mark.parametrize("method", METHODS)
def test_a_spring_that_pulls_more_than_dry_friction_holds_moves_the_striker(method: str) -> None:
    tables = BALANCED | {"solver": {"method": method}}
    tables["friction"] = {"law": "coulomb", "mu": 0.25 * (1.0 - 1e-6)}
    assert simulate(load_scene(tables), 10.0).final.x_m > 0.125


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("phase_rad", [0.0, 2.0])
def test_a_striker_laid_against_the_stop_without_force_stays_there(method: str, phase_rad: float) -> None:
    """Whichever way the crank turns the piston, whose stroke is 0."""
    changes = {
        "stop.position_m": 0.12,
        "drive.amplitude_m": 0.0,
        "drive.phase_rad": phase_rad,
        "drive.ratio": 0.01,
        "solver": {"method": method},
    }
    result = simulate(load_scene(changed("table1-viscous", changes)), 10.0)
    assert result.final.x_m == 0.12
    assert result.final.phase == Phase.REST_ON_STOP
    assert result.impacts.t_s.size == 0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("speed_rad_s", [0.0, 1.0, 20.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_guide_tilted_by_the_angle_of_friction_holds_the_striker(
    method: str, speed_rad_s: float, side: float
) -> None:
    """tan α = μ: gravity pulls along the guide as much as friction holds, to rounding."""
    tables = BALANCED | {"solver": {"method": method}, "housing": {"tilt_rad": side * math.atan(0.25)}}
    tables["drive"] = BALANCED["drive"] | {"amplitude_m": 0.0, "speed_rad_s": speed_rad_s}
    final = simulate(load_scene(tables), 10.0).final
    assert final.x_m == pytest.approx(0.125, abs=1e-15)
    assert final.v_m_s == 0.0
    assert final.phase == Phase.STICK
    tables["housing"] = {"tilt_rad": side * (math.atan(0.25) + 1e-6)}
    assert simulate(load_scene(tables), 1e-3).final.phase == Phase.FLIGHT


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("speed_rad_s", [0.0, 1.0, 20.0])
@pytest.mark.parametrize("amplitude_m", [1.0 / 64.0, 0.01])
def test_a_striker_rests_on_the_stop_while_the_pull_falls_to_nothing_and_rises_again(
    method: str, speed_rad_s: float, amplitude_m: float
) -> None:
    """The piston turns round just where the spring no longer presses."""
    tables = BALANCED | {"solver": {"method": method}, "friction": {"law": "none"}}
    tables["drive"] = BALANCED["drive"] | {"speed_rad_s": speed_rad_s, "amplitude_m": amplitude_m}
    tables["stop"] = {"law": "rigid", "position_m": 0.125 - amplitude_m, "restitution": 0.5}
    tables["initial"] = {"x_m": 0.125 - amplitude_m}
    result = simulate(load_scene(tables), 10.0)
    assert result.final.x_m == 0.125 - amplitude_m
    assert result.impacts.t_s.size == 0


SOFT_STOPS = ["hunt-crossley", "kelvin-voigt"]


@pytest.mark.parametrize("law", SOFT_STOPS)
@pytest.mark.parametrize("speed_rad_s", [1.0, 20.0])
def test_a_striker_that_friction_just_holds_at_a_pad_does_not_press_it(law: str, speed_rad_s: float) -> None:
    stop = {"law": law, "position_m": 0.125, "restitution": 0.5, "contact_s": 0.01}
    tables = BALANCED | {"stop": stop, "drive": BALANCED["drive"] | {"speed_rad_s": speed_rad_s}}
    result = simulate(load_scene(tables), 3.0)
    assert result.final.x_m == 0.125
    assert result.impacts.t_s.size == 0


@pytest.mark.parametrize(
    ("law", "method"),
    [*((law, "adaptive") for law in SOFT_STOPS), *(("rigid", method) for method in METHODS)],
)
def test_a_striker_at_the_stop_leaves_it_where_the_pull_passes_zero(law: str, method: str) -> None:
    """sin π is not 0 in doubles: the spring still presses, by less than its rounding."""
    more = {"contact_s": 0.01} if law in SOFT_STOPS else {}
    tables = BALANCED | {"friction": {"law": "viscous", "b_n_s_m": 0.2}, "solver": {"method": method}}
    tables["stop"] = {"law": law, "position_m": 0.125, "restitution": 0.5, **more}
    ways_m = []
    for phase_rad in np.array([0.0, 1e-16, 1e-12, -1e-12, 1e-9, -1e-9]) + math.pi:
        tables["drive"] = BALANCED["drive"] | {"speed_rad_s": 20.0, "phase_rad": phase_rad}
        result = simulate(load_scene(tables), 0.1)
        assert result.impacts.t_s.size == 0
        ways_m.append(result.final.x_m - 0.125)
    assert ways_m[0] < -1e-3
    assert ways_m == pytest.approx([ways_m[0]] * 6, abs=1e-9)


@pytest.mark.parametrize("scene", ["table1-motor-soft", "table1-dq-motor"])
@pytest.mark.parametrize("torque_n_m", [1e20, -1e300])
def test_a_torque_beyond_every_limit_is_the_largest_that_the_drive_gives(
    scene: str, torque_n_m: float
) -> None:
    """A rounding of the commanded torque would be larger than the dry loss, and would hold the crank."""
    most, beyond = (
        simulate(load_scene(scene), 0.2, torque_n_m=one).final
        for one in (math.copysign(1e3, torque_n_m), torque_n_m)
    )
    assert abs(most.omega_rad_s) > 10.0
    assert beyond == most


@pytest.mark.parametrize("torque_n_m", [0.005, -0.005])
def test_a_current_that_approaches_the_dry_loss_for_ever_turns_nothing(torque_n_m: float) -> None:
    """The crank carries no load, and the current loop's rounding passes the loss again and again."""
    scene = load_scene(changed("table1-dq-motor", {"drive.amplitude_m": 0.0, "initial.v_m_s": 1.0}))
    result = simulate(scene, 2.0, torque_n_m=torque_n_m)
    assert result.final.omega_rad_s == 0.0
    assert result.final.crank_rad == 0.0
    assert simulate(scene, 2.0, torque_n_m=torque_n_m * (1.0 + 1e-6)).final.omega_rad_s * torque_n_m > 0.0


@pytest.mark.parametrize("delta", [0.3, 0.5, 2.0])
def test_a_striker_leaves_a_rigid_stop_however_steep_friction_falls(delta: float) -> None:
    """The spring pulls it off while the piston is behind, and throws it back."""
    friction = {"law": "stribeck", "mu": 0.0, "mu_s": 0.05, "v_s_m_s": 0.01, "delta": delta}
    drive = {"model": "ideal", "amplitude_m": 0.02, "speed_rad_s": 3.0}
    tables = BALANCED | {"friction": friction, "drive": drive, "initial": {"x_m": 0.125}}
    tables["stop"] = {"law": "rigid", "position_m": 0.125, "restitution": 0.1}
    result = simulate(load_scene(tables), 6.0, samples_s=0.01)
    assert result.samples is not None
    assert np.min(result.samples.x_m) < 0.11
    assert result.energy.residual < 1e-7
    assert result.impacts.v_m_s[0] > 0.01


def test_chatter_that_does_not_die_out_names_the_restitution_where_friction_does_not_fall() -> None:
    friction = {"law": "stribeck", "mu": 0.0, "mu_s": 0.0, "v_s_m_s": 0.1, "delta": 2.0}
    tables = BALANCED | {"friction": friction, "initial": {"x_m": 0.125 - 1e-13}}
    tables["stop"] = {"law": "rigid", "position_m": 0.125, "restitution": 1.0}
    tables["striker"] = BALANCED["striker"] | {"spring_n_m": 1e4}
    with pytest.raises(SolverError, match=r"lower stop\.restitution"):
        simulate(load_scene(tables), 10.0)
