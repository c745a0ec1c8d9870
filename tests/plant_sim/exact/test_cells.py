"""Cells of a flight: their linear step against 40 digits, and what they prove against the motion itself."""

import math

import mpmath
import numpy as np
import pytest
from exact_reference import Mpmath, Reference
from exact_scenes import NATURAL_RAD_S, REST_M, module, start
from hypothesis import given, settings
from hypothesis import strategies as st

from plant_sim.parts.friction import Coulomb, Viscous
from plant_sim.parts.stop import NoStop, RigidStop
from plant_sim.solvers.exact.cells import Place, bends_below, doubt, onward
from plant_sim.solvers.exact.exact import simulate
from plant_sim.solvers.exact.oscillator import oscillator
from plant_sim.solvers.exact.roots import guess_between, near_root

GAP_M = 0.06


def _oscillator(ratio: float, damping_ratio: float):
    parts = module(
        0.02, ratio, Viscous(2.0 * damping_ratio * math.sqrt(0.8 * 70.0)), RigidStop(REST_M + GAP_M, 0.5)
    )
    return parts, oscillator(parts.striker, parts.drive, parts.friction, parts.stop)


@pytest.mark.parametrize("damping_ratio", [0.0, 0.01, 0.2])
@pytest.mark.parametrize("ratio", [0.0, 0.3, 1.0 - 1e-9, 1.0, 1.3, 30.0, 1e3])
def test_thirty_cells_are_the_motion_of_forty_digits(ratio, damping_ratio):
    parts, o = _oscillator(ratio, damping_ratio)
    with mpmath.workdps(40):
        motion = Reference(parts, Mpmath)._flight(mpmath.mpf(-0.03), mpmath.mpf(0.4), mpmath.mpf(1.0), 0)
        place = Place(-0.03, 0.4, 0.0, 0.02 * math.sin(1.0), 0.02 * math.cos(1.0))
        for cell in range(1, 31):
            place = onward(o.cells, place)
            y, v = motion(cell * mpmath.mpf(o.cells.span_s))
            blur = doubt(o.cells, place.z_m, place.v_m_s, o.natural_rad_s)
            assert abs(place.z_m - float(y)) < 0.3 * blur.blur_m
            assert abs(place.v_m_s - float(v)) < 0.3 * blur.blur_m_s
    angle = 1.0 + 30.0 * o.cells.span_s * o.drive_rad_s
    assert place.sin_m == pytest.approx(0.02 * math.sin(angle), abs=1e-14 * max(1.0, angle))
    assert place.cos_m == pytest.approx(0.02 * math.cos(angle), abs=1e-14 * max(1.0, angle))


@settings(max_examples=200, derandomize=True)
@given(
    ratio=st.floats(0.0, 30.0),
    damping_ratio=st.floats(0.0, 0.25),
    y_m=st.floats(-0.2, 0.2),
    v_m_s=st.floats(-3.0, 3.0),
    crank_rad=st.floats(0.0, 6.28),
)
def test_a_motion_is_nowhere_further_from_its_cubic_than_is_doubted(
    ratio, damping_ratio, y_m, v_m_s, crank_rad
):
    """Place and speed within a cell, by the closed form, less the cubics through both of its ends."""
    parts, o = _oscillator(ratio, damping_ratio)
    h, free = o.cells.span_s, parts._replace(stop=NoStop())
    t_s = np.linspace(0.0, h, 41)
    run = simulate(free, start(REST_M + y_m, v_m_s, crank_rad), h, t_s).samples
    y, v = run.x_m - REST_M, run.v_m_s
    a = -2.0 * o.decay_1_s * v - o.stiffness_1_s2 * (y - 0.02 * np.sin(run.crank_rad))
    doubts = doubt(o.cells, y_m, v_m_s, o.natural_rad_s)
    u = t_s / h
    middle = 3.0 * u * (1.0 - u) ** 2 + 3.0 * u**2 * (1.0 - u)  # B₁ + B₂
    for g, slope, doubted, blur in (
        (y, v, doubts.place_m, doubts.blur_m),
        (v, a, doubts.speed_m_s, doubts.blur_m_s),
    ):
        b = (g[0], g[0] + slope[0] * h / 3.0, g[-1] - slope[-1] * h / 3.0, g[-1])
        cubic = b[0] * (1 - u) ** 3 + 3 * b[1] * u * (1 - u) ** 2 + 3 * b[2] * u**2 * (1 - u) + b[3] * u**3
        assert np.all(np.abs(g - cubic) <= doubted * middle + blur)
    assert doubts.place_m > 0.0 or ratio == y_m == v_m_s == 0.0


@settings(max_examples=300, derandomize=True)
@given(
    g=st.floats(-1.0, 0.0),
    slope=st.floats(-5.0, 5.0),
    end=st.floats(-1.0, 0.0),
    end_slope=st.floats(-5.0, 5.0),
    slack=st.floats(0.0, 1.0),
)
def test_a_cubic_found_to_stay_below_does_so_by_its_slack(g, slope, end, end_slope, slack):
    u = np.linspace(0.0, 1.0, 101)[1:-1]
    rise = end - g
    cubic = g + u * slope + u**2 * (3 * rise - 2 * slope - end_slope) + u**3 * (slope + end_slope - 2 * rise)
    if (g, slope) != (0.0, 0.0) and bends_below(g, slope, end, end_slope, 1.0, slack):
        assert np.all(cubic + slack * 3.0 * u * (1.0 - u) < 0.0)


def test_a_level_guard_stays_below_if_it_lies_below_by_its_slack():
    assert bends_below(-0.2, 0.0, -0.3, 0.0, 1.0, 0.1)
    assert not bends_below(-0.2, 0.0, -0.05, 0.0, 1.0, 0.1)
    assert not bends_below(-0.2, 0.5, -0.3, 0.0, 1.0, 0.1)  # it rises to −0.03 at a third
    assert not bends_below(-0.3, 0.0, -0.2, -0.5, 1.0, 0.1)


@settings(max_examples=300, derandomize=True)
@given(end=st.floats(-1.0, -1e-6), end_slope=st.floats(-5.0, 5.0), slack=st.floats(0.0, 0.1))
def test_a_guard_from_rest_stays_below_by_all_of_its_slack(end, end_slope, slack):
    """What the fourth derivative may add is 2 E B₂ at most."""
    u = np.linspace(0.0, 1.0, 101)[1:-1]
    cubic = u**2 * (3 * end - end_slope) + u**3 * (end_slope - 2 * end)
    if bends_below(0.0, 0.0, end, end_slope, 1.0, slack):
        assert np.all(cubic + 6.0 * slack * u**2 * (1.0 - u) ** 2 < 0.0)
    assert bends_below(0.0, 0.0, -0.3, -0.3, 1.0, 0.0)
    assert not bends_below(0.0, 0.0, -0.3, -0.3, 1.0, 0.1)


def test_a_damped_striker_has_no_cells():
    _, o = _oscillator(1.0, 0.26)
    assert o.cells.span_s == 0.0
    assert _oscillator(1.0, 0.24)[1].cells.span_s > 0.0


@settings(max_examples=200, derandomize=True)
@given(
    root=st.floats(0.05, 0.95),
    slope=st.floats(0.5, 2.0),
    bend=st.floats(-0.4, 0.4),
    third=st.floats(-0.3, 0.3),
)
def test_guess_and_series_find_a_cubics_root(root, slope, bend, third):
    def value(s):
        return slope * (s - root) + bend * (s - root) ** 2 + third * (s - root) ** 3

    def rate(s):
        return slope + 2.0 * bend * (s - root) + 3.0 * third * (s - root) ** 2

    if rate(0.0) > 0.1 and rate(1.0) > 0.1 and value(0.0) < 0.0 < value(1.0):
        s = guess_between(value(0.0), rate(0.0), value(1.0), rate(1.0), 1.0)
        assert abs(s - root) < 0.05
    near = root + 2e-4
    rest = near_root(value(near), rate(near), 2.0 * bend + 6.0 * third * 2e-4, 6.0 * third, 0.0)
    assert rest == pytest.approx(-2e-4, abs=1e-15)


@pytest.mark.parametrize("friction", [Viscous(0.2), Coulomb(0.02, 0.0)])
@pytest.mark.parametrize("cut", [1e-12, 1e-6, 1e-3, 0.3])
def test_a_stop_at_a_cells_border_is_hit_where_the_uncut_motion_passes(friction, cut):
    """Stops a hair before and after each cell's border: the impact is where the free motion reaches them."""
    free = module(0.02, 1.2, friction, NoStop(), rest_m=0.0)
    o = oscillator(free.striker, free.drive, friction, RigidStop(GAP_M, 0.5))
    initial = start(-0.05, 0.5, 0.4)
    for border in range(1, 4):
        for side in (-1.0, 1.0):
            t_s = o.cells.span_s * border + side * cut / NATURAL_RAD_S
            there = simulate(free, initial, t_s, np.array([t_s])).samples
            if there.v_m_s[0] < 0.05:
                continue
            parts = free._replace(stop=RigidStop(float(there.x_m[0]), 0.5))
            impact = simulate(parts, initial, t_s + 0.01).impacts
            assert impact.t_s[0] == pytest.approx(t_s, abs=1e-14)
            assert impact.v_m_s[0] == pytest.approx(there.v_m_s[0], rel=1e-13)
