"""Tolerances: which change of a figure counts as none, and which settings of a tolerance are refused."""

import math
import re

import pytest

from hil.judge.tolerance import ROUNDING, Tolerance, tolerance_of, tolerances_from
from hil.scenario.checks import size_of


@pytest.mark.parametrize(
    ("before", "after", "equal"),
    [
        (1.0, 1.0, True),
        (1.0, 1.1, True),
        (1.0, 1.2, False),
        (5, 5.1, True),
        (math.nan, math.nan, True),
        (math.nan, 1.0, False),
        (1.0, math.nan, False),
        (math.inf, math.inf, True),
        (math.inf, 1.0, False),
        ("impact", "impact", True),
        ("impact", "lost", False),
        ("impact", 1.0, False),
        (None, None, True),
        (None, 0.0, False),
        (True, True, True),
        (True, False, False),
        (True, 1.05, False),
    ],
)
def test_numbers_within_the_tolerance_are_equal_and_all_else_only_if_it_is_the_same(before, after, equal):
    assert Tolerance(0.15, 0.0).holds(before, after) is equal


def test_a_figure_has_its_own_tolerance_or_that_of_all_or_a_thousandth_of_its_requirements_limit():
    own, of_all = Tolerance(0.1, 0.0), Tolerance(0.2, 0.0)
    given = {"capture_s": own, "*": of_all}
    assert [tolerance_of(given, name) for name in ("capture_s", "regime")] == [own, of_all]
    assert size_of("speed.ripple") == 0.002
    assert tolerance_of({}, "speed.ripple") == pytest.approx((2e-6, ROUNDING.relative), rel=1e-12)
    assert size_of("held_s") == 0.0
    assert tolerance_of({}, "held_s") == ROUNDING


@pytest.mark.parametrize(
    ("before", "after", "equal"),
    [(1.0, 1.0 + 1e-10, True), (1.0, 1.0 + 1e-8, False), (0.0, 1e-13, True), (0.0, 1e-11, False)],
)
def test_without_a_tolerance_only_what_rounding_leaves_is_no_change(before, after, equal):
    assert tolerance_of({}, "held_s").holds(before, after) is equal


def test_settings_give_the_absolute_tolerance_and_the_relative_one_if_stated():
    assert tolerances_from(["a=0.1", "b=0,0.5", "*=2,0"], ["a", "b"]) == {
        "a": Tolerance(0.1, 0.0),
        "b": Tolerance(0.0, 0.5),
        "*": Tolerance(2.0, 0.0),
    }


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("a=", "two numbers from 0 on"),
        ("a", "two numbers from 0 on"),
        ("a=1,2,3", "two numbers from 0 on"),
        *((f"a={one}", "two numbers from 0 on") for one in ("-1", "nan", "inf", "x")),
        *((f"a=1,{one}", "two numbers from 0 on") for one in ("-1", "nan", "inf", "x")),
        ("other=1", "there is no figure other"),
    ],
)
def test_a_setting_that_is_no_tolerance_of_a_figure_is_refused_by_name(setting, message):
    with pytest.raises(ValueError, match=f"{re.escape(setting)}: .*{message}"):
        tolerances_from([setting], ["a"])
