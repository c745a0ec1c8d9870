"""A wearer behind the stop: a foot plate on the ankle, and what the wearer feels."""

import math
from typing import Any

import numpy as np
import pytest
from changed_scenes import HERTZ, changed

from plant_sim.parts.stop import RigidStop
from plant_sim.plant import Plant
from plant_sim.scene import Scene, SceneError, load_scene
from plant_sim.simulation import initial_state, simulate
from plant_sim.solvers.exact import exact

# A foot of a kilogram; an ankle of 100 N m/rad and 1 N m s/rad at a lever of 0.1 m.
WEARER = {"plate_kg": 1.0, "ankle_n_m": 1e4, "ankle_n_s_m": 100.0}


def scene(changes: dict[str, Any], name: str = "table1-viscous") -> Scene:
    return load_scene(changed(name, {"wearer": WEARER, **changes}))


def test_a_stiff_ankle_is_a_fixed_stop() -> None:
    fixed = simulate(load_scene(changed("table1-viscous", {"drive.ratio": 1.0, "stop": HERTZ})), 3.0)
    away = []
    for stiffness in (1e6, 1e7, 1e8):
        wearer = {"plate_kg": 1.0, "ankle_n_m": stiffness, "ankle_n_s_m": 2.0 * math.sqrt(stiffness)}
        worn = simulate(scene({"drive.ratio": 1.0, "stop": HERTZ, "wearer": wearer}), 3.0)
        assert worn.impacts.t_s.size == fixed.impacts.t_s.size
        away.append(abs(worn.impacts.peak_force_n[0] / fixed.impacts.peak_force_n[0] - 1.0))
    assert away[0] > 3.0 * away[1] > 9.0 * away[2]
    assert away[2] < 1e-3
    assert worn.peak_felt_force_n == pytest.approx(np.max(worn.impacts.peak_force_n), rel=0.02)


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


def test_the_wearers_compliance_shares_the_impact() -> None:
    """The first impact, equally fast: the softer the ankle, the less is felt of it."""
    start = {"drive.ratio": 1.1, "stop": HERTZ, "initial.x_m": 0.179, "initial.v_m_s": 0.7}
    bare = simulate(load_scene(changed("table1-viscous", start)), 0.3)
    assert bare.peak_felt_force_n is None
    felt = []
    for stiffness in (1e5, 1e4, 1e3):
        wearer = {"plate_kg": 1.0, "ankle_n_m": stiffness, "ankle_n_s_m": 0.2 * math.sqrt(stiffness)}
        felt.append(simulate(scene({**start, "wearer": wearer}), 0.3).peak_felt_force_n)
    assert felt[0] == pytest.approx(bare.impacts.peak_force_n[0], rel=0.3)
    assert felt[0] > 1.5 * felt[1] > 3.0 * felt[2] > 0.0


def test_solvers_without_a_form_for_it_refuse_it() -> None:
    parts = scene({"stop": HERTZ}).parts()
    start = initial_state(scene({"stop": HERTZ}))
    with pytest.raises(exact.UnsupportedSceneError, match="no wearer alone"):
        exact.simulate(parts._replace(stop=RigidStop(0.18, 0.5)), start, 1.0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, "wearer is given while stop.law = 'rigid'; a wearer feels a force, which only a soft stop has"),
        ({"stop": {"law": "none"}}, "wearer is given while stop.law = 'none'"),
        ({"stop": HERTZ, "friction": {"law": "coulomb", "mu": 0.1}}, "wearer is given while friction.law"),
        ({"stop": HERTZ, "wearer": {"plate_kg": 1.0}}, "wearer.ankle_n_m is missing; give the ankle's"),
        (
            {"stop": HERTZ, "wearer": {**WEARER, "plate_kg": 0.0}},
            "wearer.plate_kg = 0.0 is not a number greater than 0",
        ),
        ({"stop": HERTZ, "wearer": {**WEARER, "foot_kg": 1.0}}, "wearer.foot_kg = 1.0 is not a known key"),
    ],
)
def test_what_makes_no_sense_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError, match=said):
        scene(changes)


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
