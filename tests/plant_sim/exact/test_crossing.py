"""The proof that a span of a flight is clear, against polynomials and against the motion itself."""

import math

import numpy as np
import pytest
from exact_scenes import NATURAL_RAD_S, REST_M, module, start
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from plant_sim.kernels import jit
from plant_sim.kinds import kernel_parts
from plant_sim.parts.friction import Coulomb, Viscous
from plant_sim.parts.stop import NoStop, RigidStop
from plant_sim.solvers.bernstein import NO_ROOT, new_scratch
from plant_sim.solvers.exact import crossing
from plant_sim.solvers.exact.crossing import Guard, high_derivative_bounds, near_root
from plant_sim.solvers.exact.exact import simulate
from plant_sim.solvers.exact.oscillator import flow, launch, oscillator, point

GAP_M = 0.06


def guard_of(polynomial: Polynomial, s: float) -> Guard:
    return Guard(*(float(polynomial.deriv(k)(s)) if k else float(polynomial(s)) for k in range(5)))


coefficients = st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8)


@jit
def _first_root(start, end, doubt):
    return crossing._first_root(start, end, 1.0, doubt, new_scratch())


@settings(max_examples=500, derandomize=True)
@given(coefficients=coefficients, lowered=st.floats(0.0, 4.0), doubt=st.floats(0.0, 1.0))
def test_a_guard_has_no_root_before_the_one_that_is_doubted(coefficients, lowered, doubt):
    """Of degree 7, and with as much of an eighth as the doubt allows."""
    guard = Polynomial([-abs(coefficients[0]) - lowered, *coefficients[1:]])
    first = _first_root(guard_of(guard, 0.0), guard_of(guard, 1.0), doubt)
    clear = min(first * (1.0 - 1.1 * crossing.ROOT_SHARE), 1.0)
    s = np.linspace(0.0, clear, 201)[1:-1]
    assert np.all(guard(s) + 70.0 * doubt * s**4 * (1.0 - s) ** 4 < 1e-14)
    if first <= 1.0:  # and that one is a root of the polynomial above
        above = guard + doubt * 35.0 * Polynomial([0.0, 1.0, -1.0]) ** 3
        assert above(first) > -1e-12
        assert above(first * (1.0 - 1.1 * crossing.ROOT_SHARE)) < 1e-12


@pytest.mark.parametrize("zeros", [1, 2, 3])
def test_a_root_at_the_start_is_none(zeros):
    leaving = Polynomial([0.0] * zeros + [-1.0])
    assert _first_root(guard_of(leaving, 0.0), guard_of(leaving, 1.0), 1e-3) == NO_ROOT
    bounce = Polynomial([0.0] * zeros + [-0.4, 1.0])
    assert _first_root(guard_of(bounce, 0.0), guard_of(bounce, 1.0), 0.0) == pytest.approx(
        0.4, rel=crossing.ROOT_SHARE
    )


@jit
def _derivatives(parts, y_m, v_m_s, crank_rad, span_s, out):
    """The bounds, then y, v and three more derivatives on a grid."""
    o = oscillator(parts)
    flight = launch(o, y_m, v_m_s, math.sin(crank_rad), math.cos(crank_rad), 0.0)
    bounds = high_derivative_bounds(o, point(o, flight, 0.0, y_m, v_m_s, 0.0, 1.0), span_s)
    for i in range(out.shape[0]):
        h = span_s * i / (out.shape[0] - 1)
        p = point(o, flight, h, *flow(o, flight, h))
        w2, drag, square = o.stiffness_1_s2, 2.0 * o.decay_1_s, o.drive_rad_s * o.drive_rad_s
        before, here, piston, after = p.v_m_s, p.a_m_s2, o.drive_rad_s * p.piston_cos_m, -square * p.piston_m
        for order in range(3, 10):
            before, here = here, -drag * here - w2 * (before - piston)
            piston, after = after, -square * piston
            out[i, order] = here
    return bounds


@settings(max_examples=200, derandomize=True)
@given(
    ratio=st.floats(0.0, 30.0),
    damping_ratio=st.one_of(st.floats(0.0, 0.25), st.floats(0.25, 100.0)),
    y_m=st.floats(-0.2, 0.2),
    v_m_s=st.floats(-3.0, 3.0),
    crank_rad=st.floats(0.0, 6.28),
    span_rad=st.floats(0.01, 3.2),
)
def test_no_high_derivative_exceeds_its_bound(ratio, damping_ratio, y_m, v_m_s, crank_rad, span_rad):
    friction = Viscous(2.0 * damping_ratio * math.sqrt(0.8 * 70.0))
    parts = module(0.02, ratio, friction, RigidStop(REST_M + GAP_M, 0.5))
    derivatives = np.zeros((60, 10))
    span_s = span_rad / NATURAL_RAD_S
    bounds = _derivatives(kernel_parts(parts), y_m, v_m_s, crank_rad, span_s, derivatives)
    largest = np.abs(derivatives).max(axis=0)
    # the last digits of a derivative that cancels are none
    noise = 1e-12 * (max(1.0, ratio, 2.0 * damping_ratio) * NATURAL_RAD_S) ** np.array([8, 9])
    assert np.all(largest[8:] <= np.array(bounds) * (1.0 + 1e-9) + noise)


@jit
def _near_root(guard):
    return near_root(guard)


@given(st.floats(0.5, 2.0), st.floats(-0.4, 0.4), st.floats(-0.3, 0.3))
@settings(max_examples=200, derandomize=True)
def test_a_series_finds_a_near_root(slope, bend, third):
    cubic = Polynomial([0.0, slope, bend, third])
    assert _near_root(guard_of(cubic, 2e-4)) == pytest.approx(-2e-4, abs=1e-15)


@pytest.mark.parametrize("friction", [Viscous(0.2), Coulomb(0.02, 0.0)])
@pytest.mark.parametrize("cut", [1e-12, 1e-6, 1e-3, 0.3])
def test_a_stop_at_a_spans_end_is_hit_where_the_uncut_motion_passes(friction, cut):
    """Stops a hair before and after the end of a span: the impact is where the free motion reaches them."""
    free = module(0.02, 1.2, friction, NoStop(), rest_m=0.0)
    o = oscillator(kernel_parts(free._replace(stop=RigidStop(GAP_M, 0.5))))
    initial = start(-0.05, 0.5, 0.4)
    reached = 0
    for share in (0.2, 0.4, 0.6, 1.0):
        for side in (-1.0, 1.0):
            t_s = o.span_s * share + side * cut / NATURAL_RAD_S
            there = simulate(free, initial, t_s, np.array([t_s])).samples
            if there.v_m_s[0] < 0.05:
                continue
            reached += 1
            parts = free._replace(stop=RigidStop(float(there.x_m[0]), 0.5))
            impact = simulate(parts, initial, t_s + 0.01).impacts
            assert impact.t_s[0] == pytest.approx(t_s, abs=1e-14)
            assert impact.v_m_s[0] == pytest.approx(there.v_m_s[0], rel=1e-13)
    assert reached > 0
