"""A finite connecting rod: its geometry, the torque of its force, and where it reaches a level."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from plant_sim.parts.linkage import Sine, SliderCrank, crank_torque_n_m, piston_m, sine_at

ROD = SliderCrank(0.06)
A = 0.02
ANGLES = np.linspace(-math.pi, math.pi, 41)


def test_crank_rod_and_piston_close_their_triangle() -> None:
    """The crank pin (A cos θ, A sin θ) is a rod's length from the piston at L + x_A on the axis."""
    for theta in ANGLES:
        pin = complex(A * math.sin(theta), A * math.cos(theta))
        assert abs(0.06 + piston_m(ROD, A, theta) - pin) == pytest.approx(0.06, rel=1e-14)
    assert piston_m(ROD, A, math.pi / 2.0) == pytest.approx(A, rel=1e-15)
    assert piston_m(ROD, A, -math.pi / 2.0) == pytest.approx(-A, rel=1e-15)
    assert piston_m(ROD, A, 0.0) == pytest.approx(-A * A / (2.0 * 0.06), rel=0.03)


def test_the_cranks_torque_is_the_work_of_the_pistons_force() -> None:
    """F dx_A = T dθ, by central differences."""
    for theta in ANGLES:
        step = 1e-5
        slope = (piston_m(ROD, A, theta + step) - piston_m(ROD, A, theta - step)) / (2.0 * step)
        assert crank_torque_n_m(ROD, 7.0, A, theta) == pytest.approx(7.0 * slope, abs=1e-9)


@pytest.mark.parametrize("linkage", [Sine(), ROD, SliderCrank(0.0201)])
def test_a_level_is_reached_at_its_angle(linkage: Sine | SliderCrank) -> None:
    for level in (-0.0199, -0.013, 0.0, 0.004, 0.0199):
        angle = brentq(lambda theta: piston_m(linkage, A, theta) - level, -math.pi / 2.0, math.pi / 2.0)  # noqa: B023
        assert math.asin(sine_at(linkage, A, level)) == pytest.approx(angle, abs=1e-9)
    for level in (-0.021, 0.021):
        assert abs(sine_at(linkage, A, level)) > 1.0
