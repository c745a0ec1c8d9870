"""The ends of the ranges for the adaptive solver: a stated accuracy, or a clear refusal."""

import math
from typing import Any

import numpy as np
import pytest
from changed_scenes import changed

from plant_sim.result import SimulationResult
from plant_sim.scene import load_scene
from plant_sim.simulation import simulate
from plant_sim.solvers.cost import SolverError

ADAPTIVE = {"solver.method": "adaptive"}
FALLING = {"initial.v_m_s": 0.7, "drive.ratio": 1.0}
"""Reaches the stop within a tenth of a second."""


def run(
    name: str, changes: dict[str, Any], until_s: float = 1.0, torque_n_m: float = 0.0
) -> SimulationResult:
    return simulate(load_scene(changed(name, changes)), until_s, torque_n_m=torque_n_m)


def agree(ours: SimulationResult, theirs: SimulationResult, tolerance: float) -> None:
    assert ours.impacts.t_s.size == theirs.impacts.t_s.size
    assert np.max(np.abs(ours.impacts.t_s - theirs.impacts.t_s), initial=0.0) < tolerance
    assert abs(ours.final.x_m - theirs.final.x_m) < tolerance


@pytest.mark.parametrize("law", ["hunt-crossley", "kelvin-voigt"])
@pytest.mark.parametrize("stiffness", [1e2, 1e4, 1e6, 1e9])
def test_stops_from_soft_to_hard(law: str, stiffness: float) -> None:
    """To 1e-8 m and s of a run a thousand times as accurate; the hard ones come near to the rigid stop."""
    stop = {"law": law, "position_m": 0.18, "restitution": 0.5, "stiffness": stiffness}
    changes = {**ADAPTIVE, **FALLING, "stop": stop}
    result = run("table1-viscous", changes)
    agree(result, run("table1-viscous", {**changes, "solver.accuracy": 1e-12}), 1e-8)
    assert result.energy.residual < 1e-8
    assert result.impacts.t_s.size >= 1
    if stiffness == 1e9:
        rigid = run("table1-viscous", FALLING)
        assert result.impacts.t_s[0] == pytest.approx(rigid.impacts.t_s[0], abs=1e-9)
        assert result.impacts.v_after_m_s[0] == pytest.approx(rigid.impacts.v_after_m_s[0], rel=1e-2)


@pytest.mark.parametrize("mass_kg", [1e-6, 1e3])
def test_light_and_heavy_strikers(mass_kg: float) -> None:
    """Ten free oscillations against the closed form; the damping scaled with the mass."""
    natural = math.sqrt(70.0 / mass_kg)
    changes = {
        "striker.mass_kg": mass_kg,
        "friction.b_n_s_m": 0.02 * mass_kg * natural,
        "initial.v_m_s": 0.05 * natural,
    }
    until_s = 20.0 * math.pi / natural
    truth = run("table1-viscous", changes, until_s)
    ours = run("table1-viscous", {**changes, **ADAPTIVE, "solver.accuracy": 1e-5}, until_s)
    assert truth.impacts.t_s.size > 5
    assert ours.impacts.t_s.size == truth.impacts.t_s.size
    assert abs(ours.final.x_m - truth.final.x_m) < 1e-4
    fine = run("table1-viscous", {**changes, **ADAPTIVE}, until_s)
    assert abs(fine.final.x_m - truth.final.x_m) < 1e-8
    assert fine.energy.residual < 1e-8


@pytest.mark.parametrize("v_s_m_s", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("accuracy", [1e-2, 1e-9])
def test_a_sharp_fall_of_friction(v_s_m_s: float, accuracy: float) -> None:
    """As v_s → 0 the striker slides with μ and sticks up to μ_s; a loose accuracy does not undo it."""
    changes = {**ADAPTIVE, "friction.v_s_m_s": v_s_m_s, "solver.accuracy": accuracy}
    result = run("table1-stribeck", changes, 3.0)
    fine = run("table1-stribeck", {**changes, "solver.accuracy": 1e-11}, 3.0)
    assert result.impacts.t_s.size == fine.impacts.t_s.size
    assert abs(result.final.x_m - fine.final.x_m) < 10.0 * accuracy
    assert result.energy.residual < max(10.0 * accuracy, 1e-8)


def test_a_fall_of_friction_beyond_rounding_is_refused() -> None:
    with pytest.raises(SolverError, match=r"friction\.v_s_m_s"):
        run("table1-stribeck", {**ADAPTIVE, "friction.v_s_m_s": 1e-14}, 3.0)


@pytest.mark.parametrize("delta", [0.1, 0.5, 2.0, 10.0])
def test_exponents_of_the_fall(delta: float) -> None:
    changes = {**ADAPTIVE, "friction.delta": delta}
    result = run("table1-stribeck", changes, 3.0)
    fine = run("table1-stribeck", {**changes, "solver.accuracy": 1e-11}, 3.0)
    agree(result, fine, 1e-7 if delta < 1.0 else 1e-8)  # below 1 the law has an infinite slope at rest
    assert result.energy.residual < 1e-8


@pytest.mark.parametrize("delta", [0.1, 1.0, 10.0])
def test_without_a_fall_it_is_dry_friction(delta: float) -> None:
    same = {"friction.mu": 0.2, "friction.mu_s": 0.2, "friction.delta": delta, **ADAPTIVE}
    agree(run("table1-stribeck", same, 3.0), run("table1-coulomb", {}, 3.0), 1e-8)


MOTOR = "table1-motor-soft"


def test_a_motor_too_weak_for_the_crank_stalls_against_the_spring() -> None:
    """Peak of c A² sin θ cos θ = 14 mN m and 5 mN m of dry loss: 12 mN m do not get round, 30 do."""
    still = {"striker.mass_kg": 1e6, "stop": {"law": "none"}}
    weak = run(MOTOR, still, 5.0, torque_n_m=0.012)
    strong = run(MOTOR, still, 5.0, torque_n_m=0.03)
    assert weak.final.omega_rad_s == 0.0
    assert weak.final.crank_rad < 0.5 * math.pi
    assert strong.final.omega_rad_s > 10.0


def test_the_striker_drives_the_motor_back() -> None:
    """A stretched spring turns a crank without torque: no work of the drive, energy only lost."""
    result = run(MOTOR, {"initial.x_m": 0.0, "drive.phase_rad": 0.5}, 5.0)
    assert result.energy.drive_work_j == 0.0
    assert result.energy.stored_change_j < -0.1
    assert result.energy.residual < 1e-8
    assert result.final.crank_rad != 0.5


@pytest.mark.parametrize("supply_v", [1e-3, 0.4, 2.0])
def test_a_sagging_supply_limits_speed(supply_v: float) -> None:
    """K_t ω does not pass the supply, however much torque is asked for."""
    free = {"motor.supply_v": supply_v, "motor.dry_n_m": 0.0, "drive.amplitude_m": 0.0}
    final = run(MOTOR, free, 20.0, torque_n_m=0.8).final
    kt, r, b = 0.08, 0.4, 1e-4
    assert final.omega_rad_s == pytest.approx(kt * supply_v / (kt * kt + r * b), rel=1e-6)


@pytest.mark.parametrize("scene", [MOTOR, "table1-dq-motor"])
@pytest.mark.parametrize("torque_n_m", [1e20, -1e300])
def test_a_torque_beyond_every_limit_is_the_largest_that_the_drive_gives(
    scene: str, torque_n_m: float
) -> None:
    """A rounding of the commanded torque would be larger than the dry loss, and would hold the crank."""
    most = run(scene, {}, 0.2, torque_n_m=math.copysign(1e3, torque_n_m)).final
    assert abs(most.omega_rad_s) > 10.0
    assert run(scene, {}, 0.2, torque_n_m=torque_n_m).final == most


@pytest.mark.parametrize("inertia_kg_m2", [1e-5, 1e-7])
def test_a_motor_almost_without_inertia(inertia_kg_m2: float) -> None:
    changes = {"motor.inertia_kg_m2": inertia_kg_m2, "stop.position_m": 1.0}
    result = run(MOTOR, changes, 0.5, torque_n_m=0.012)
    fine = run(MOTOR, {**changes, "solver.accuracy": 1e-12}, 0.5, torque_n_m=0.012)
    assert abs(result.final.x_m - fine.final.x_m) < 1e-8
    assert result.energy.residual < 1e-7
