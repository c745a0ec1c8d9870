"""A plant that is changed or kicked from outside, mid-run."""

import dataclasses
import math
import re

import pytest

from plant_sim.parts.stop import RigidStop
from plant_sim.plant import Plant, PlantError
from plant_sim.result import Phase
from plant_sim.scene import load_scene

SCENE = load_scene("table1-motor-soft")


def swinging(ticks: int) -> Plant:
    plant = Plant(SCENE, seed=1)
    for _ in range(ticks):
        plant.advance(0.06, 1e-3)
    return plant


def test_a_kick_changes_the_velocity_and_nothing_else() -> None:
    plant = swinging(700)
    before = plant.state
    plant.kick(0.25)
    after = plant.state
    assert after.v_m_s - before.v_m_s == pytest.approx(0.25, abs=1e-12)
    assert dataclasses.replace(after, v_m_s=before.v_m_s) == before
    felt_m_s = 0.0
    for _ in range(20):
        reading = plant.sense().striker_high_m_s2 - plant.now.accel_m_s2
        felt_m_s += reading * 1e-3
        plant.advance(0.06, 1e-3)
    assert felt_m_s == pytest.approx(0.25, abs=0.05)
    plant.advance(0.06, 0.5)
    assert plant.energy.residual < 1e-6


def test_a_change_in_the_middle_of_a_contact_goes_on_with_it() -> None:
    plant = swinging(1)
    plant.kick(1.0)
    while plant.now.stop_force_n == 0.0:
        plant.advance(0.0, 1e-3)
    parts = plant.parts
    plant.replace_parts(parts._replace(striker=parts.striker._replace(spring_n_per_m=77.0)))
    plant.kick(0.01)
    plant.advance(0.0, 0.1)
    assert len(plant.take_impacts()) == 1
    assert plant.energy.residual < 1e-6


def on_a_pad(x_m: float, v_m_s: float) -> Plant:
    """A striker at a pad of 10 ms, which its spring presses it into a little."""
    scene = load_scene(
        {
            "striker": {"mass_kg": 0.8, "spring_n_m": 70.0, "rest_length_m": 0.12},
            "drive": {"model": "ideal", "amplitude_m": 0.0, "speed_rad_s": 0.0},
            "friction": {"law": "viscous", "b_n_s_m": 0.2},
            "stop": {"law": "hunt-crossley", "position_m": 0.115, "restitution": 0.5, "contact_s": 0.01},
            "initial": {"x_m": x_m, "v_m_s": v_m_s},
        }
    )
    return Plant(scene, seed=1)


def peak_and_rebound(plant: Plant) -> tuple[float, float]:
    """The largest force of a pad, N, and the striker's fastest return, m/s, in 40 ms."""
    forces_n, speeds_m_s = [], []
    for _ in range(400):
        plant.advance(0.0, 1e-4)
        forces_n.append(plant.now.stop_force_n)
        speeds_m_s.append(plant.now.v_m_s)
    return max(forces_n), -min(speeds_m_s)


def test_a_kick_at_rest_in_a_pad_is_an_impact_of_its_speed() -> None:
    """The damping of the contact follows the kick, and not the slow touch-down before it."""
    for kick_m_s in (0.3, 1.0, 3.0):
        kicked = on_a_pad(0.11, 0.0)
        kicked.advance(0.0, 5.0)
        assert kicked.state.phase == Phase.CONTACT
        kicked.kick(kick_m_s)
        kicked_to = peak_and_rebound(kicked)
        assert kicked_to == pytest.approx(peak_and_rebound(on_a_pad(0.115, kick_m_s)), rel=0.1)
        assert kicked_to[1] == pytest.approx(0.5 * kick_m_s, rel=0.1)


def test_a_pad_that_moves_into_a_striker_at_rest_throws_it_back() -> None:
    plant = on_a_pad(0.11, 0.0)
    plant.advance(0.0, 5.0)
    plant.replace_parts(plant.parts._replace(stop=plant.parts.stop._replace(position_m=0.11)))
    plant.advance(0.0, 0.1)
    assert plant.now.v_m_s < -0.1
    assert plant.energy.residual < 1e-6


def test_other_kinds_of_parts_and_numbers_that_are_none_are_refused() -> None:
    plant = swinging(1)
    with pytest.raises(PlantError, match="RigidStop"):
        plant.replace_parts(plant.parts._replace(stop=RigidStop(0.18, 0.5)))
    for change_m_s in (math.nan, 1e300, -1e4):
        with pytest.raises(PlantError, match=f"change_m_s = {re.escape(str(change_m_s))}"):
            plant.kick(change_m_s)


def in_the_pad(mu: float, restitution: float) -> tuple[Plant, float]:
    """A plant whose striker has come to rest in a pad that the spring presses it into; its last touch, s."""
    scene = load_scene(
        {
            "striker": {"mass_kg": 0.8, "spring_n_m": 70.0, "rest_length_m": 0.12},
            "drive": {"model": "ideal", "amplitude_m": 0.0, "speed_rad_s": 0.0},
            "friction": {"law": "coulomb", "mu": mu},
            "stop": {"law": "kelvin-voigt", "position_m": 0.11, "restitution": restitution, "stiffness": 1e3},
            "initial": {"x_m": 0.1, "v_m_s": 0.8},
        }
    )
    plant, touched_s, before_m = Plant(scene, seed=1), math.nan, 0.1
    for _ in range(3000):
        plant.advance(0.0, 1e-3)
        if before_m <= 0.11 < plant.state.x_m:
            touched_s = plant.t_s
        before_m = plant.state.x_m
    assert before_m > 0.11
    assert abs(plant.state.v_m_s) < 1e-12
    return plant, touched_s


def test_a_pad_that_is_pressed_again_before_it_is_cleared_is_one_contact() -> None:
    """A strongly damped one lets go of the striker early, and the coupling spring presses it in again."""
    plant, _ = in_the_pad(mu=0.01, restitution=0.1)
    assert plant.take_impacts() == []


@pytest.mark.parametrize(("mu", "restitution"), [(0.05, 0.5), (0.01, 0.1)])
def test_a_kick_of_a_striker_at_rest_in_a_pad_keeps_its_impact(mu: float, restitution: float) -> None:
    plant, touched_s = in_the_pad(mu, restitution)
    assert plant.state.phase == (Phase.STICK if restitution == 0.5 else Phase.CONTACT)
    plant.take_impacts()
    plant.kick(0.1)
    plant.advance(0.0, 0.5)
    assert plant.take_impacts() == []
    plant.kick(-1.0)
    plant.advance(0.0, 0.05)
    (impact,) = plant.take_impacts()
    assert impact.t_s == pytest.approx(touched_s, abs=1.001e-3)
    assert impact.v_after_m_s < 0.0 < impact.v_m_s
    assert plant.state.x_m < 0.11
