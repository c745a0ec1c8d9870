"""The scalar helpers: stated results for every float, the same bits interpreted and compiled."""

import math
import struct
from itertools import product

import numpy as np
import pytest
from compiled_calls import as_compiled

from firmware_py.core.numbers import TAU, at_least, clamp, fraction, round_down, wrap_pi, wrap_two_pi

EVERY_KIND = (0.0, -0.0, 1e-20, -1e-20, 3.0, -3.0, math.pi, -math.pi, TAU, -TAU, 1e3, -1e5, 1e9, -1e9)
TOO_LARGE = (math.nan, math.inf, -math.inf, 1.1e9, -1.1e9, 1e19, -1e19, 1e300, -1e300)
FUNCTIONS = (wrap_pi, wrap_two_pi, fraction)


def test_angles_on_the_circle() -> None:
    near_seams = [
        k * math.pi + side * d for k in range(-9, 10) for d in (0.0, 1e-16, 1e-9) for side in (-1, 1)
    ]
    for angle in [*np.linspace(-20.0, 20.0, 401), *near_seams, *np.geomspace(1.0, 1e9, 500)]:
        for value in (float(angle), -float(angle)):
            assert -math.pi < wrap_pi(value) <= math.pi
            assert 0.0 <= wrap_two_pi(value) < TAU
            assert 0.0 <= fraction(value) < 1.0
            assert math.cos(wrap_pi(value)) == pytest.approx(math.cos(value), abs=3e-7)
            assert math.sin(wrap_two_pi(value)) == pytest.approx(math.sin(value), abs=3e-7)
    assert wrap_pi(math.pi) == wrap_pi(-math.pi) == math.pi
    assert wrap_two_pi(-1e-20) == fraction(-1e-20) == 0.0


def test_a_floor_without_integers_is_the_floor() -> None:
    whole = [float(number) for number in (0, 1, 2, 3, 1_000, 999_999_999, 1_000_000_000)]
    edges = [math.nextafter(number, number + side) for number in whole for side in (-1, 0, 1)]
    for value in [*edges, *np.linspace(-3.0, 3.0, 121), *np.geomspace(1e-300, 1e9, 200)]:
        for signed in (float(value), -float(value)):
            assert math.copysign(1.0, round_down(0.0 * signed)) == 1.0
            assert round_down(signed) == math.floor(signed), signed


def test_what_is_no_angle_is_zero() -> None:
    for value in TOO_LARGE:
        assert [function(value) for function in FUNCTIONS] == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("value", "limit", "clamped"),
    [
        (3.0, 2.0, 2.0),
        (-3.0, 2.0, -2.0),
        (1.5, 2.0, 1.5),
        (math.inf, 2.0, 2.0),
        (-math.inf, 2.0, -2.0),
        (math.nan, 2.0, 0.0),
        (1.0, math.nan, 0.0),
        (1.0, -2.0, 0.0),
        (math.inf, math.inf, 0.0),
        (1.0, 0.0, 0.0),
    ],
)
def test_a_clamp_fails_safe(value: float, limit: float, clamped: float) -> None:
    assert clamp(value, limit) == clamped


def test_a_floor_holds_for_nan() -> None:
    assert at_least(math.nan, 1.0) == at_least(-3.0, 1.0) == 1.0
    assert at_least(3.0, 1.0) == 3.0


def test_interpreted_and_compiled_give_the_same_bits() -> None:
    values = EVERY_KIND + TOO_LARGE
    cases = [(function, [(value,) for value in values]) for function in FUNCTIONS]
    cases.append((clamp, list(product(values, values))))
    for function, arguments in cases:
        compiled = as_compiled(function)
        for one in arguments:
            assert struct.pack("<d", compiled(*one)) == struct.pack("<d", function(*one)), (function, one)
