"""A plant that is changed or kicked from outside, mid-run."""

import dataclasses
import math

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


def residual(plant: Plant) -> float:
    energy = plant.energy
    terms = (energy.drive_work_j, energy.stored_change_j, energy.friction_j, energy.impact_loss_j)
    return abs(terms[0] - sum(terms[1:])) / sum(map(abs, terms))


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
    assert residual(plant) < 1e-6


def test_a_softer_spring_swings_at_its_own_frequency() -> None:
    plant = Plant(SCENE, seed=1)
    parts = plant.parts
    plant.replace_parts(parts._replace(striker=parts.striker._replace(spring_n_per_m=35.0)))
    plant.kick(-0.03)  # so little that the crank's dry friction holds it
    crossings, last = [], plant.state.v_m_s
    for tick in range(4000):
        plant.advance(0.0, 1e-3)
        if last < 0.0 <= plant.state.v_m_s:
            crossings.append(tick)
        last = plant.state.v_m_s
    period_s = (crossings[-1] - crossings[0]) / (len(crossings) - 1) * 1e-3
    damping = 0.2 / (2.0 * 0.8)
    assert period_s == pytest.approx(2.0 * math.pi / math.sqrt(35.0 / 0.8 - damping**2), rel=2e-3)


@pytest.mark.parametrize("by_m", [-0.01, 0.01])
def test_a_stop_that_moves_leaves_the_striker_where_it_is(by_m: float) -> None:
    plant = swinging(700)
    before = plant.state
    parts = plant.parts
    stop = parts.stop
    assert hasattr(stop, "position_m")
    plant.replace_parts(parts._replace(stop=stop._replace(position_m=stop.position_m + by_m)))
    assert plant.state.x_m == pytest.approx(before.x_m, abs=1e-15)
    plant.kick(1.5)
    last_x_m, touched_x_m = plant.state.x_m, []
    for _ in range(1000):
        plant.advance(0.06, 1e-3)
        if plant.now.stop_force_n > 0.0 and not touched_x_m:
            touched_x_m = [last_x_m, plant.state.x_m]
        last_x_m = plant.state.x_m
    assert touched_x_m[0] <= stop.position_m + by_m <= touched_x_m[1]
    assert residual(plant) < 1e-6


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
    assert residual(plant) < 1e-6


def test_other_kinds_of_parts_and_numbers_that_are_none_are_refused() -> None:
    plant = swinging(1)
    with pytest.raises(PlantError, match="RigidStop"):
        plant.replace_parts(plant.parts._replace(stop=RigidStop(0.18, 0.5)))
    with pytest.raises(PlantError, match="change_m_s = nan"):
        plant.kick(math.nan)


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
