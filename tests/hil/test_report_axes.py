"""The axes that a report's plots are drawn on."""

from xml.etree import ElementTree

import numpy as np
import pytest

from hil.show.report.axes import Axes, path, steps
from hil.show.report.canvas import Figure


def words(figure: Figure) -> list[str]:
    return ["".join(one.itertext()) for one in ElementTree.fromstring(figure.svg()).iter() if one.text]


@pytest.mark.parametrize(
    ("low", "high", "most", "values", "decimals"),
    [
        (0.0, 1.0, 5, [0.0, 0.2, 0.4, 0.6, 0.8, 1.0], 1),
        (0.0, 33.0, 4, [0.0, 10.0, 20.0, 30.0], 0),
        (0.86, 0.94, 4, [0.86, 0.88, 0.9, 0.92, 0.94], 2),
        (-1.0, 1.3, 10, [-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0, 1.25], 2),
        (1e6, 1.5e6, 3, [1e6, 1.2e6, 1.4e6], 0),
        (-1e-9, 1e-9, 4, [-1e-9, -5e-10, 0.0, 5e-10, 1e-9], 10),
    ],
)
def test_ticks_are_round_numbers_within_the_scale(low, high, most, values, decimals):
    found, needed = steps(low, high, most)
    assert found == pytest.approx(values, abs=1e-15)
    assert needed == decimals


def test_a_curve_is_broken_where_it_is_not_finite_and_equal_points_are_one():
    x = np.array([0.0, 1.0, 1.01, 2.0, 3.0, 4.0])
    y = np.array([0.0, 5.0, 5.01, np.nan, 5.0, 6.0])
    assert path(x, y) == "M0 0L1 5M3 5L4 6"


def test_what_is_drawn_lies_within_the_axes():
    figure = Figure("one", 400, 200)
    (axes,) = figure.beside(1)
    axes.curve([0.0, 10.0], [-1.0, 1.0], "#123456", "a & b")
    axes.legend = "upper left"
    drawn = ElementTree.fromstring(figure.svg())
    line = next(one for one in drawn.iter() if "#123456" in one.get("style", "") and "L" in one.get("d", ""))
    (x0, y0), (x1, y1) = (map(float, end.split()) for end in line.get("d", "")[1:].split("L"))
    assert axes.left < x0 < x1 < axes.left + axes.width
    assert axes.top < y1 < y0 < axes.top + axes.height
    assert "a & b" in words(figure)
    assert {"−1.0", "0.0", "1.0"} <= set(words(figure))


def test_stacked_axes_have_one_scale_of_x_whose_numbers_stand_once():
    figure = Figure("two", 400, 300)
    above, below = figure.stacked(1.0, 1.0)
    above.curve([0.0, 4.0], [0.0, 1.0], "red")
    below.curve([6.0, 10.0], [20.0, 21.0], "red")
    assert words(figure).count("10.0") == 1
    assert above.top + above.height < below.top


def test_logarithmic_scales_number_decades_and_leave_out_what_they_cannot_show():
    axes = Axes(0, 0, 300, 200)
    axes.x.is_log = True
    axes.curve([0.0, 0.5, 2000.0], [1.0, 2.0, 3.0], "red")
    low, high = axes.x.range()
    assert (low, high) == pytest.approx((0.5 / 4000.0**0.12, 2000.0 * 4000.0**0.12))
    figure = Figure("log", 300, 200)
    figure.axes.append(axes)
    assert {"1", "10", "100", "1000"} <= set(words(figure))


def test_bars_stand_on_those_below():
    axes = Axes(0, 0, 100, 100)
    axes.y.from_zero = True
    axes.bars(np.array([2, 0]), np.array([0.0, 1.0, 2.0]), "green")
    axes.bars(np.array([1, 3]), np.array([0.0, 1.0, 2.0]), "red", below=np.array([2, 0]))
    assert axes.y.range() == pytest.approx((0.0, 3.15))


@pytest.mark.parametrize("values", [[], [np.nan], [5.0], [0.0]])
def test_no_spread_is_no_error(values):
    figure = Figure("flat", 300, 200)
    (axes,) = figure.beside(1)
    axes.curve(values, values, "red")
    axes.points(values, values, "red")
    ElementTree.fromstring(figure.svg())
