"""Basins in numbers: shares, exponents and entropies against maps whose answers are known."""

import math

import numpy as np
import pytest

from tools.study import basin
from tools.study.cases import case


def test_a_straight_border_is_smooth() -> None:
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 300), np.linspace(0.0, 1.0, 300))
    numbers = basin.statistics(x + 0.37 * y > 0.7)
    assert numbers["uncertainty_exponent"] == pytest.approx(1.0, abs=0.02)
    low, high = numbers["uncertainty_exponent_bounds"]
    assert low <= numbers["uncertainty_exponent"] <= high
    assert numbers["border_entropy"] < math.log(2.0)


def test_a_fractal_border_is_not() -> None:
    # Middle-thirds Cantor set: dimension ln 2 / ln 3 across the border, so α = 1 − ln 2 / ln 3 = 0.369.
    size = 3**6
    line = np.zeros(size, dtype=bool)
    for level in range(1, 7):
        block = 3**level
        for start in range(0, size, block):
            middle = slice(start + block // 3, start + 2 * block // 3)
            line[middle] = level % 2 == 0
    lines = np.tile(line, (size, 1))
    numbers = basin.statistics(lines)
    assert numbers["uncertainty_exponent"] < 0.75


def test_random_cells_have_full_entropy() -> None:
    noise = np.random.default_rng(3).random((200, 200)) < 0.5
    entropy, border = basin.basin_entropy(noise)
    assert entropy == pytest.approx(math.log(2.0), abs=0.03)
    assert border == pytest.approx(entropy, abs=0.01)


def test_one_kind_alone_has_no_border() -> None:
    numbers = basin.statistics(np.ones((60, 60), dtype=bool))
    assert math.isnan(numbers["uncertainty_exponent"])
    assert numbers["basin_entropy"] == 0.0
    assert numbers["impact_fraction_bootstrap"] == [1.0, 1.0]


def test_planes_hold_what_their_axes_say() -> None:
    module = case("table1", "viscous")
    starts = basin.starts_of(module, "phase", 20)
    cycles, impacts = basin.piece(basin.Rows(module, 1.3, "phase", 20, 0, 20))
    y_m, crank = basin.axes(case("table1", "viscous"), "phase", 20)
    assert np.allclose(starts[:, 0].reshape(20, 20)[3], y_m)
    assert np.allclose(starts[:, 2].reshape(20, 20)[:, 5], crank)
    assert len(cycles) == 400
    assert min(cycles) > 0
    assert 0.4 < (np.array(impacts) > 0.0).mean() < 0.8
