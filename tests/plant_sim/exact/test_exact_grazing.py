"""Grazing: an overshoot of 1e-12 m is an impact, a miss by 1e-12 m is none."""

import mpmath
import numpy as np
import pytest
from exact_reference import Mpmath, Reference
from exact_scenes import module, start
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from plant_sim.parts.friction import Coulomb, NoFriction, Viscous
from plant_sim.parts.stop import NoStop, RigidStop
from plant_sim.solvers.exact.exact import simulate

FOUND_M = 1e-12


def _highest_turn(parts, initial, until_s: float) -> tuple[float, float]:
    """Time and place of the highest turning point without a stop, by Newton's method on 40 digits."""
    t_s = np.linspace(0.0, until_s, 40_001)
    x_m = simulate(parts, initial, until_s, t_s).samples.x_m
    turns = 1 + np.flatnonzero((x_m[1:-1] >= x_m[:-2]) & (x_m[1:-1] > x_m[2:]))
    near = t_s[turns[np.argmax(x_m[turns])]]
    with mpmath.workdps(40):
        motion = Reference(parts, Mpmath)._flight(
            mpmath.mpf(initial.x_m), mpmath.mpf(initial.v_m_s), mpmath.mpf(initial.crank_rad), 0
        )
        turn_s = mpmath.findroot(lambda t: motion(t)[1], (near, near + 1e-6))
        return float(turn_s), float(motion(turn_s)[0])


@settings(max_examples=40, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(
    ratio=st.one_of(st.floats(0.2, 3.0), st.floats(0.999, 1.001)),
    b_n_s_m=st.sampled_from([0.0, 0.05, 0.2, 1.0]),
    amplitude_m=st.floats(0.005, 0.04),
    v_m_s=st.floats(-0.5, 0.5),
    crank_rad=st.floats(0.0, 6.28),
)
def test_the_highest_point_of_a_motion_is_found_and_not_invented(
    ratio, b_n_s_m, amplitude_m, v_m_s, crank_rad
):
    free = module(amplitude_m, ratio, Viscous(b_n_s_m), NoStop(), rest_m=0.0)
    initial = start(-0.03, v_m_s, crank_rad)
    peak_s, peak_m = _highest_turn(free, initial, 8.0)
    until_s = peak_s + 0.002  # what comes later may be higher
    touching = free._replace(stop=RigidStop(peak_m - FOUND_M, 0.5))
    missing = free._replace(stop=RigidStop(peak_m + FOUND_M, 0.5))
    touched = simulate(touching, initial, until_s).impacts
    assert len(simulate(missing, initial, until_s).impacts.t_s) == 0
    assert len(touched.t_s) >= 1
    there = simulate(free, initial, until_s, touched.t_s[:1]).samples
    assert there.x_m[0] == pytest.approx(peak_m - FOUND_M, abs=1e-15)
    assert 0.0 < touched.v_m_s[0] < 1e-4


@pytest.mark.parametrize("friction", [NoFriction(), Viscous(0.2), Coulomb(0.02, 0.0)])
@pytest.mark.parametrize("overshoot_m", [1e-3, 1e-6, 1e-9, 1e-12, -1e-12, -1e-9, -1e-6])
def test_a_first_swing_that_just_reaches_the_stop(friction, overshoot_m):
    """The swing's top by 40 digits; friction is dry in one case, where the turn and the touch coincide."""
    parts = module(0.02, 1.2, friction, NoStop(), rest_m=0.0)
    initial = start(-0.05, 0.3, 0.4)
    with mpmath.workdps(40):
        direction = 1 if isinstance(friction, Coulomb) else 0
        motion = Reference(parts, Mpmath)._flight(
            mpmath.mpf(-0.05), mpmath.mpf(0.3), mpmath.mpf(0.4), direction
        )
        top_s = mpmath.findroot(lambda t: motion(t)[1], 0.3)
        top_m = float(motion(top_s)[0])
    with_stop = parts._replace(stop=RigidStop(top_m - overshoot_m, 0.5))
    impacts = simulate(with_stop, initial, float(top_s) + 0.02).impacts
    if overshoot_m > 0.0:
        assert len(impacts.t_s) >= 1
        assert impacts.v_m_s[0] == pytest.approx(np.sqrt(2.0 * 6.0 * overshoot_m), rel=0.5)
        assert abs(impacts.t_s[0] - float(top_s)) < 2.0 * np.sqrt(overshoot_m)
    else:
        assert len(impacts.t_s) == 0


def test_a_long_gap_without_events_ends_at_the_right_impact():
    """Slow beating just off resonance: hundreds of swings stay clear before one reaches it."""
    parts = module(0.0005, 1.0 + 1.0 / 150.0, NoFriction(), rest_m=0.0, stop=RigidStop(0.06, 0.5))
    with mpmath.workdps(40):
        impact = Reference(parts, Mpmath).run(0.0, 0.0, 0.0, until_s=200.0, most=1)[0]
    impacts = simulate(parts, start(0.0), 200.0).impacts
    assert float(impact.t_s) > 20.0
    assert abs(impacts.t_s[0] - float(impact.t_s)) < 1e-13
