"""The stepping solver: first order, robust in contact and stick, energies balanced."""

import numpy as np
import pytest
from exact_scenes import REST_M, module, start

from plant_sim.parts.friction import Coulomb, NoFriction, Stribeck, Viscous
from plant_sim.parts.stop import HuntCrossley, NoStop, RigidStop
from plant_sim.result import Phase
from plant_sim.solvers.exact import exact
from plant_sim.solvers.exact.exact import UnsupportedSceneError
from plant_sim.solvers.stepping import simulate

STEPS_S = np.array([4e-4, 2e-4, 1e-4, 5e-5, 2.5e-5, 1.25e-5])


@pytest.mark.parametrize(
    "parts",
    [
        module(0.02, 1.1, Viscous(0.2)),
        module(0.03, 1.1, Coulomb(0.15, 0.0)),
        module(0.02, 1.2, NoFriction()),
    ],
)
def test_impact_times_converge_at_first_order(parts):
    """Where in a step an impact falls is chance, so errors scatter: the trend over 32× counts."""
    truth = exact.simulate(parts, start(), 4.0).impacts.t_s[:4]
    errors = []
    for step_s in STEPS_S:
        times = simulate(parts, start(), 4.0, float(step_s)).impacts.t_s[:4]
        errors.append(np.abs(times - truth).max())
    order = np.polyfit(np.log(STEPS_S), np.log(errors), 1)[0]
    assert 0.75 < order < 1.4
    assert errors[-1] < 1e-4


def test_the_final_state_converges_to_the_exact_one():
    parts = module(0.02, 1.1, Viscous(0.2))
    truth = exact.simulate(parts, start(), 3.0).final
    errors = [abs(simulate(parts, start(), 3.0, float(h)).final.x_m - truth.x_m) for h in (1e-3, 1e-5)]
    assert errors[1] < 0.05 * errors[0] + 1e-6
    assert errors[1] < 1e-5


def test_smooth_motion_converges_at_second_order():
    parts = module(0.02, 1.3, Viscous(0.2), NoStop())
    truth = exact.simulate(parts, start(), 3.0).final.x_m
    errors = [abs(simulate(parts, start(), 3.0, h).final.x_m - truth) for h in (2e-3, 1e-3, 5e-4)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize("k", [0.0, 0.5, 0.9])
def test_a_preloaded_stop_holds_the_striker_at_rest(k):
    parts = module(0.02, 0.9, Viscous(0.2), RigidStop(REST_M - 0.03, k))
    final = simulate(parts, start(REST_M - 0.06), 20.0, 1e-3).final
    assert 0.0 <= final.x_m - parts.stop.position_m < 5e-4  # way of half a step at the first impact's speed
    assert abs(final.v_m_s) < 5e-3


def test_a_plastic_stop_is_rest():
    parts = module(0.02, 0.9, Viscous(0.2), RigidStop(REST_M - 0.03, 0.0))
    result = simulate(parts, start(REST_M - 0.06), 20.0, 1e-3)
    assert result.final.phase == Phase.REST_ON_STOP
    assert len(result.impacts.t_s) == 1


def test_stuck_for_ever():
    result = simulate(module(0.02, 1.0, Coulomb(0.3, 0.0)), start(), 20.0, 1e-3)
    assert result.final.phase == Phase.STICK
    assert result.final.x_m == REST_M
    assert result.energy.friction_j == 0.0


def test_static_friction_of_stribeck_holds_what_sliding_friction_would_not():
    push = 70.0 * 0.02 / (0.8 * 9.80665)  # c A over m g
    held = simulate(module(0.02, 1.0, Stribeck(0.5 * push, 1.1 * push, 1e-3, 1.0, 0.0)), start(), 5.0, 1e-3)
    slid = simulate(module(0.02, 1.0, Stribeck(0.5 * push, 0.9 * push, 1e-3, 1.0, 0.0)), start(), 5.0, 1e-3)
    assert held.final.x_m == REST_M
    assert slid.energy.friction_j > 0.0


@pytest.mark.parametrize("friction", [NoFriction(), Viscous(0.2), Coulomb(0.15, 0.1)])
def test_the_energies_of_every_step_balance(friction):
    result = simulate(module(0.03, 1.1, friction), start(), 10.0, 1e-3)
    assert result.energy.residual < 1e-12
    truth = exact.simulate(module(0.03, 1.1, friction), start(), 10.0).energy
    fine = simulate(module(0.03, 1.1, friction), start(), 10.0, 1e-5).energy
    assert fine.drive_work_j == pytest.approx(truth.drive_work_j, rel=5e-3)
    assert fine.impact_loss_j == pytest.approx(truth.impact_loss_j, rel=5e-3)
    assert fine.friction_j == pytest.approx(truth.friction_j, rel=5e-3)


def test_samples_and_an_end_between_steps():
    parts = module(0.02, 1.3, Viscous(0.2))
    t_s = np.array([0.0, 0.10005, 0.25, 0.7071])
    samples = simulate(parts, start(), 0.7071, 1e-4, t_s).samples
    truth = exact.simulate(parts, start(), 0.7071, t_s).samples
    assert samples.x_m == pytest.approx(truth.x_m, abs=1e-6)
    assert samples.v_m_s == pytest.approx(truth.v_m_s, abs=1e-5)
    assert samples.crank_rad == pytest.approx(truth.crank_rad, abs=1e-12)
    assert simulate(parts, start(), 0.0, 1e-4, t_s[:1]).samples.x_m[0] == REST_M


@pytest.mark.parametrize("step_s", [0.0, -1e-3, float("nan"), float("inf")])
def test_a_step_that_is_none_is_refused(step_s):
    with pytest.raises(UnsupportedSceneError, match="step"):
        simulate(module(0.02, 1.0, NoFriction()), start(), 1.0, step_s)


def test_soft_stops_are_refused():
    parts = module(0.02, 1.0, NoFriction())._replace(stop=HuntCrossley(0.18, 1e6, 1.5, 0.5))
    with pytest.raises(UnsupportedSceneError, match="adaptive"):
        simulate(parts, start(), 1.0, 1e-3)
