"""A wearer behind the stop: a foot plate on the ankle, and what the wearer feels."""

import math
from typing import Any

import numpy as np
import pytest
from changed_scenes import HERTZ, changed
from scipy.integrate import solve_ivp

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


@pytest.mark.parametrize("tilt_rad", [-1.0, 0.3, 0.5 * math.pi])
def test_a_plate_starts_where_it_hangs(tilt_rad: float) -> None:
    """Without an impact the wearer feels the plate's weight, from the start on, and nothing else."""
    changes = {"stop": HERTZ | {"position_m": 0.4}, "housing.tilt_rad": tilt_rad}
    result = simulate(scene(changes), 1.0, samples_s=0.01)
    assert len(result.impacts.t_s) == 0
    assert result.samples is not None
    assert result.samples.felt_force_n == pytest.approx(-9.80665 * math.sin(tilt_rad), rel=1e-6)
    assert result.samples.x_m[0] == 0.12


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


@pytest.mark.parametrize("plate_kg", [0.5, 1.0, 1e4])
def test_the_contact_lasts_as_long_as_the_table_says(plate_kg: float) -> None:
    """An elastic contact of two free masses is half a period of the reduced mass on the pad."""
    tables = {
        "striker": {"mass_kg": 0.8, "spring_n_m": 1e-6, "rest_length_m": 0.0},
        "drive": {"model": "ideal", "amplitude_m": 0.0, "speed_rad_s": 0.0},
        "stop": {"law": "kelvin-voigt", "position_m": 0.1, "restitution": 1.0, "contact_s": 0.04},
        "wearer": {"plate_kg": plate_kg, "ankle_n_m": 1e-6, "ankle_n_s_m": 0.0},
        "initial": {"v_m_s": 1.0},
    }
    found = simulate(load_scene(tables), 0.3, samples_s=1e-4)
    assert found.samples is not None
    pressed_s = found.samples.t_s[found.samples.stop_force_n > 0.0]
    assert pressed_s[-1] - pressed_s[0] == pytest.approx(0.04, abs=2e-4)


@pytest.mark.parametrize(("amplitude_m", "phase_rad"), [(0.0, 0.0), (0.0, 1.5), (0.02, 0.0), (0.02, math.pi)])
def test_a_housing_swings_striker_and_plate_that_begin_side_by_side(
    amplitude_m: float, phase_rad: float
) -> None:
    """Both begin at rest at the relaxed spring; an elastic pad needs no events in scipy's equations."""
    ankle_n_per_m, ankle_n_s_m, plate_kg, b_n_s_m, turn_rad_s = 2e4, 100.0, 1.5, 0.2, 10.0
    tables = {
        "striker": {"mass_kg": 0.8, "spring_n_m": 70.0, "rest_length_m": 0.12},
        "drive": {"model": "ideal", "amplitude_m": amplitude_m, "speed_rad_s": turn_rad_s},
        "friction": {"law": "viscous", "b_n_s_m": b_n_s_m},
        "stop": {"law": "hunt-crossley", "position_m": 0.12, "restitution": 1.0, "contact_s": 0.01},
        "wearer": {"plate_kg": plate_kg, "ankle_n_m": ankle_n_per_m, "ankle_n_s_m": ankle_n_s_m},
        "housing": {"harmonic": {"amplitude_m_s2": 3.4, "frequency_hz": 1.0, "phase_rad": phase_rad}},
    }
    scene = load_scene(tables)
    stiffness = scene.parts().stop.stiffness_n_per_mn

    def slopes(t, state):
        x, v, p, u = state
        push = stiffness * max(x - p, 0.0) ** 1.5
        a_b = 3.4 * math.sin(2.0 * math.pi * t + phase_rad)
        spring = 70.0 * (amplitude_m * math.sin(turn_rad_s * t) - x)
        felt = ankle_n_per_m * p + ankle_n_s_m * u
        return v, (spring - b_n_s_m * v - push) / 0.8 - a_b, u, (push - felt) / plate_kg - a_b

    times_s = np.linspace(0.0, 0.3, 31)
    reference = solve_ivp(
        slopes, (0.0, 0.3), np.zeros(4), "DOP853", times_s, rtol=1e-11, atol=1e-14, max_step=1e-4
    )
    samples = simulate(scene, 0.3, samples_s=0.01).samples
    assert samples is not None
    assert samples.x_m == pytest.approx(0.12 + reference.y[0], abs=1e-7)
    assert samples.v_m_s == pytest.approx(reference.y[1], abs=1e-6)


@pytest.mark.parametrize("law", ["hunt-crossley", "kelvin-voigt"])
@pytest.mark.parametrize("worn", [{}, {"wearer": WEARER}])
@pytest.mark.parametrize(("before_s", "torque_n_m"), [(0.0, 0.2), (0.0, -0.2), (0.5, 0.2), (0.5, -0.2)])
def test_a_motor_sets_a_striker_in_motion_that_lies_on_a_pad_without_force(
    law: str, worn: dict[str, Any], before_s: float, torque_n_m: float
) -> None:
    """The pull of a crank that sets off grows with t², and so the striker's way with t⁴."""
    tables = {
        "striker": {"mass_kg": 0.8, "spring_n_m": 70.0, "rest_length_m": 0.12},
        "drive": {"model": "motor", "amplitude_m": 0.02},
        "stop": {"law": law, "position_m": 0.12, "restitution": 0.5, "contact_s": 0.01},
    }
    plant = Plant(load_scene(tables | worn), seed=1)
    plant.advance(0.0, before_s)
    assert plant.now.v_m_s == 0.0
    plant.advance(torque_n_m, 0.01)
    pull = 70.0 * 0.02 * (0.195 if torque_n_m > 0.0 else -0.195) / 5e-4 / 2.0  # N/s², less the dry loss
    expected_m_s = pull / 0.8 * 0.01**3 / 3.0
    if torque_n_m > 0.0:  # the pad yields
        assert 0.0 < plant.now.v_m_s < expected_m_s
    else:
        assert plant.now.v_m_s == pytest.approx(expected_m_s, rel=0.05)
        assert not plant.take_impacts()
    assert plant.energy.residual < 1e-9
