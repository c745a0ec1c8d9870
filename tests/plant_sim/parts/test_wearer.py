"""A wearer behind the stop: a foot plate on the ankle, and what the wearer feels."""

import math
from typing import Any

import pytest
from changed_scenes import HERTZ, changed

from plant_sim.parts.stop import RigidStop
from plant_sim.plant import Plant
from plant_sim.scene import Scene, load_scene
from plant_sim.simulation import initial_state, simulate
from plant_sim.solvers.exact import exact

# A foot of a kilogram; an ankle of 100 N m/rad and 1 N m s/rad at a lever of 0.1 m.
WEARER = {"plate_kg": 1.0, "ankle_n_m": 1e4, "ankle_n_s_m": 100.0}


def scene(changes: dict[str, Any], name: str = "table1-viscous") -> Scene:
    return load_scene(changed(name, {"wearer": WEARER, **changes}))


def test_a_impact_is_shared_out_by_momentum() -> None:
    """A loose plate, no spring to speak of: m v⁻ = m v + m_f p', and k of the relative velocities."""
    changes = {
        "stop": {**HERTZ, "contact_s": 0.002},
        "wearer": {"plate_kg": 1.6, "ankle_n_m": 1e-3, "ankle_n_s_m": 0.0},
        "striker.spring_n_m": 1e-6,
        "friction.b_n_s_m": 0.0,
        "drive.amplitude_m": 0.0,
        "initial.x_m": 0.179,
        "initial.v_m_s": 0.9,
    }
    result = simulate(scene(changes), 0.01)
    (impulse,) = result.impacts.impulse_n_s
    reduced = 0.8 * 1.6 / 2.4
    k = -result.impacts.v_after_m_s[0] / result.impacts.v_m_s[0]
    # Hunt–Crossley's k depends on the dissipation alone, whatever the mass.
    assert k == pytest.approx(0.5, rel=1e-6)
    assert impulse == pytest.approx(reduced * 1.5 * 0.9, rel=1e-6)
    assert result.final.v_m_s == pytest.approx(0.9 - impulse / 0.8, abs=1e-8)
    assert result.energy.impact_loss_j == pytest.approx(0.5 * reduced * 0.81 * 0.75, rel=1e-6)


def test_a_tilted_plate_hangs_in_its_ankle() -> None:
    """k_a p = −m_f g sin α: what the wearer feels is the plate's weight, once it has come to rest."""
    changes = {
        "stop": HERTZ,
        "housing.tilt_rad": 0.3,
        "drive.amplitude_m": 0.0,
        "friction.b_n_s_m": 20.0,
    }
    plant = Plant(scene(changes), seed=1)
    for _ in range(40):
        plant.advance(0.0, 0.5)
    assert plant.now.felt_force_n == pytest.approx(-9.80665 * math.sin(0.3), rel=1e-6)
    assert plant.peak_felt_force_n is not None
    assert plant.peak_felt_force_n > abs(plant.now.felt_force_n)


def test_solvers_without_a_form_for_it_refuse_it() -> None:
    parts = scene({"stop": HERTZ}).parts()
    start = initial_state(scene({"stop": HERTZ}))
    with pytest.raises(exact.UnsupportedSceneError, match="no wearer; this scene has Ankle"):
        exact.simulate(parts._replace(stop=RigidStop(0.18, 0.5)), start, 1.0)


def test_the_restitution_is_that_of_striker_and_plate() -> None:
    """Two free masses: the pad's damping gives the restitution asked for, whoever's foot is behind it."""
    tables = {
        "striker": {"mass_kg": 0.8, "spring_n_m": 1e-6, "rest_length_m": 0.0},
        "drive": {"model": "ideal", "amplitude_m": 0.0, "speed_rad_s": 0.0},
        "stop": {"law": "kelvin-voigt", "position_m": 0.1, "restitution": 0.5, "contact_s": 0.01},
        "wearer": {"plate_kg": 0.5, "ankle_n_m": 1e-6, "ankle_n_s_m": 0.0},
        "initial": {"v_m_s": 1.0},
    }
    impacts = simulate(load_scene(tables), 0.3).impacts
    assert -impacts.v_after_m_s[0] / impacts.v_m_s[0] == pytest.approx(0.5, rel=1e-5)
