"""Time stepping: first order, and robust in contact and stick."""

import numpy as np
import pytest
from exact_scenes import REST_M, module, start

from plant_sim.parts.friction import Coulomb, NoFriction, Stribeck, Viscous
from plant_sim.parts.stop import NoStop, RigidStop
from plant_sim.solvers.exact import exact
from tools.trade.peers.stepping import simulate

STEPS_S = np.array([4e-4, 2e-4, 1e-4, 5e-5, 2.5e-5, 1.25e-5])


@pytest.mark.parametrize(
    "parts",
    [
        module(0.02, 1.1, Viscous(0.2)),
        module(0.03, 1.1, Coulomb(0.15, 0.0)),
        module(0.02, 1.2, NoFriction()),
    ],
)
def test_impact_times_converge_at_first_order(parts) -> None:
    """Where in a step an impact falls is chance, so errors scatter: the trend over 32× counts."""
    truth = exact.simulate(parts, start(), 4.0).impacts.t_s[:4]
    errors = []
    for step_s in STEPS_S:
        times = simulate(parts, start(), 4.0, float(step_s)).impacts[0, :4]
        errors.append(np.abs(times - truth).max())
    order = np.polyfit(np.log(STEPS_S), np.log(errors), 1)[0]
    assert 0.75 < order < 1.4
    assert errors[-1] < 1e-4


def test_the_final_state_converges_to_the_exact_one() -> None:
    parts = module(0.02, 1.1, Viscous(0.2))
    truth = exact.simulate(parts, start(), 3.0).final
    errors = [abs(simulate(parts, start(), 3.0, float(h)).x_m - truth.x_m) for h in (1e-3, 1e-5)]
    assert errors[1] < 0.05 * errors[0] + 1e-6
    assert errors[1] < 1e-5


def test_smooth_motion_converges_at_second_order() -> None:
    parts = module(0.02, 1.3, Viscous(0.2), NoStop())
    truth = exact.simulate(parts, start(), 3.0).final.x_m
    errors = [abs(simulate(parts, start(), 3.0, h).x_m - truth) for h in (2e-3, 1e-3, 5e-4)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize("k", [0.0, 0.5, 0.9])
def test_a_preloaded_stop_holds_the_striker_at_rest(k) -> None:
    parts = module(0.02, 0.9, Viscous(0.2), RigidStop(REST_M - 0.03, k))
    run = simulate(parts, start(REST_M - 0.06), 20.0, 1e-3)
    assert 0.0 <= run.x_m - parts.stop.position_m < 5e-4  # way of half a step at the first impact's speed
    assert abs(run.v_m_s) < 5e-3
    assert k > 0.0 or run.impacts.shape[1] == 1


def test_stuck_for_ever() -> None:
    run = simulate(module(0.02, 1.0, Coulomb(0.3, 0.0)), start(), 20.0, 1e-3)
    assert (run.x_m, run.v_m_s) == (REST_M, 0.0)


def test_static_friction_of_stribeck_holds_what_sliding_friction_would_not() -> None:
    push = 70.0 * 0.02 / (0.8 * 9.80665)  # c A over m g
    held = simulate(module(0.02, 1.0, Stribeck(0.5 * push, 1.1 * push, 1e-3, 1.0, 0.0)), start(), 5.0, 1e-3)
    slid = simulate(module(0.02, 1.0, Stribeck(0.5 * push, 0.9 * push, 1e-3, 1.0, 0.0)), start(), 5.0, 1e-3)
    assert held.x_m == REST_M
    assert slid.x_m != REST_M
