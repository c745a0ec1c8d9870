"""Checks: two-sided, deaf to NaN, and strict about names."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError

from hil.figures.gaps import Gap
from hil.judge.evaluation import evaluate, margin, margin_in, margin_share
from hil.judge.verdict import Verdict
from hil.record.run_traces import RunTraces
from hil.scenario.checks import Bounds, Check, checks_of, requirements


def figures(**values):
    ticked = SimpleNamespace(ticks=1)
    known = {"regime": "impact", "real_time": True, "impact_count": 8, "peak_force_n": 250.0}
    known |= {"hold_start_s": 1.0, "hold_end_s": 9.0}
    return SimpleNamespace(
        log=SimpleNamespace(frames_lost=0),
        gaps=(),
        loops=SimpleNamespace(plant=ticked, firmware=ticked),
        **{**known, **values},
    )


@pytest.mark.parametrize(
    ("check", "value", "passed"),
    [
        ({"low": 200.0, "high": 300.0}, 250.0, True),
        ({"low": 200.0, "high": 300.0}, 200.0, True),
        ({"low": 200.0, "high": 300.0}, 300.0, True),
        ({"low": 200.0, "high": 300.0}, 199.9, False),
        ({"low": 200.0, "high": 300.0}, 300.1, False),
        ({"low": 0.0}, 250.0, True),
        ({"high": 0.0}, 250.0, False),
        ({"low": 0.0}, float("nan"), False),
        ({"high": 0.0}, float("nan"), False),
        ({"low": 0.0}, float("inf"), False),
        ({"low": 0.0}, None, False),
        ({"low": 250.0, "high": 250.0}, 250.0, True),
        ({"equals": 250}, 250.0, True),
        ({"equals": 250.0}, float("nan"), False),
        ({"equals": 250.0}, None, False),
    ],
)
def test_bounds(check, value, passed):
    (result,) = evaluate([Check(name="peak_force_n", **check)], figures(peak_force_n=value))
    assert result.passed is passed
    assert (result.name, result.unit) == ("peak_force_n", "N")


@pytest.mark.parametrize(
    ("name", "equals", "passed"),
    [
        ("regime", "impact", True),
        ("regime", "lost", False),
        ("real_time", True, True),
        ("real_time", False, False),
        ("real_time", 1, False),
        ("impact_count", 8, True),
        ("impact_count", True, False),
    ],
)
def test_equality(name, equals, passed):
    (result,) = evaluate([Check(name=name, equals=equals)], figures())
    assert result.passed is passed


@pytest.mark.parametrize(
    ("check", "message"),
    [
        ({"name": "detector.recal", "low": 0.9}, r"did you mean detector\.recall"),
        ({"name": "detector", "low": 0.9}, "names no figure"),
        ({"name": "impacts", "low": 1.0}, "names no figure"),
        ({"name": "regime"}, "give low, high or both, or equals"),
        ({"name": "regime", "equals": "impact", "low": 1.0}, "give low, high or both, or equals"),
        ({"name": "peak_force_n", "low": 2.0, "high": 1.0}, "cannot pass"),
        ({"name": "fault", "equals": 5}, "cannot pass: the figure is a text"),
        ({"name": "fault", "high": 5.0}, "cannot pass: the figure is a text"),
        ({"name": "impact_count", "equals": "zero"}, "cannot pass: the figure is a number"),
        ({"name": "mine", "expression": "max(plant.x_m)", "equals": "x"}, "the figure is a number"),
        ({"name": "peak_force_n", "low": float("nan")}, "finite"),
        ({"name": "peak_force_n", "high": 1.0, "unit": "kN"}, "the figure is in 'N'"),
        ({"name": "peak_force_n", "high": 1.0, "tolerance": 1.0}, "tolerance"),
        ({"name": "peak_force_n", "high": "1.0"}, "valid number"),
    ],
)
def test_a_check_that_means_nothing_is_refused(check, message):
    with pytest.raises(ValidationError, match=message):
        Check(**check)


def test_limits_read_as_people_write_them():
    limits = [
        Check(name="peak_force_n", low=1.0, high=2.5).limit,
        Check(name="peak_force_n", high=1e-3).limit,
        Check(name="real_time", equals=True).limit,
    ]
    assert limits == ["1 … 2.5", "≤ 0.001", "= true"]


SCRIPT = {"commands": [{"at_s": 0.5, "request": "run"}, {"at_s": 9.0, "request": "idle"}], "duration_s": 12.0}


@pytest.mark.parametrize(
    ("hold_end_s", "script", "may_end", "passed"),
    [
        (9.0, SCRIPT, False, True),
        (9.0 - 0.01, SCRIPT, False, True),
        (8.98, SCRIPT, False, False),
        (6.0, SCRIPT, True, True),
        (12.0, SCRIPT | {"commands": SCRIPT["commands"][:1]}, False, True),
        (11.9, SCRIPT | {"commands": SCRIPT["commands"][:1]}, False, False),
        (11.9, {}, False, True),
    ],
)
def test_a_check_of_the_hold_covers_it_to_the_end_that_the_script_gives(hold_end_s, script, may_end, passed):
    """A module that stops by itself has held nothing from then on, whatever it held until then."""
    traces = RunTraces(run={}, scenario={"script": script})
    of_hold = Check(name="regime", equals="impact", **({"hold_may_end": True} if may_end else {}))
    of_run = Check(name="impact_count", equals=8)
    held, counted = evaluate([of_hold, of_run], figures(hold_end_s=hold_end_s), traces)
    assert (held.passed, counted.passed) == (passed, True)
    if not passed:
        assert held.reason == f"the hold ended at {hold_end_s:.2f} s, before the script ends it at " + (
            "9 s" if hold_end_s < 9.0 else "12 s"
        )


@pytest.mark.parametrize(
    ("limits", "value", "share"),
    [
        ({"low": 2.0, "high": 6.0}, 3.0, 0.5),
        ({"low": 2.0, "high": 6.0}, 1.0, -0.5),
        ({"low": -4.0, "high": 4.0}, -1.0, 0.75),
        ({"low": 4.0, "high": 4.0}, 4.0, None),
        # A lower limit of 0 is none.
        ({"low": 0.0, "high": 4.0}, 1.0, 0.75),
        ({"low": 0.0, "high": 0.5}, 0.125, 0.75),
        ({"low": 0.0, "high": 0.0}, 0.0, None),
        ({"low": 0.0}, 1.0, None),
        # The other end of a share is 1; a value above 1 is no share.
        ({"low": 0.99}, 0.995, 0.5),
        ({"low": 0.75}, 1.0, 1.0),
        ({"low": 0.75}, 1.5, 1.0),
        ({"low": 1.0}, 1.0, 0.0),
        ({"low": 50.0}, 75.0, 0.5),
        ({"low": -0.5}, 0.0, 1.0),
        ({"high": 4.0}, 1.0, 0.75),
        ({"high": -2.0}, -3.0, 0.5),
        ({"high": 0.0}, 0.0, None),
        ({"low": 2.0}, math.nan, None),
        ({"low": 2.0}, None, None),
        ({"equals": 8}, 8, None),
    ],
)
def test_a_margin_is_a_share_of_the_room_within_the_limits(limits, value, share):
    found = margin_share(Check(name="peak_force_n", **limits), value)
    assert found == (None if share is None else pytest.approx(share))


def test_an_unequal_value_has_no_margin_and_an_equal_one_is_at_its_limit():
    check = Check(name="impact_count", equals=8)
    assert (margin(check, 8), margin(check, 9)) == (0.0, -math.inf)
    assert margin_in(Bounds(), 1.0) == -math.inf  # without a limit nothing passes


def test_a_value_meets_a_requirement_up_to_its_limit_unless_the_check_is_not_judged():
    check = Check(name="peak_force_n", high=200.0, required=Bounds(high=250.0))
    of_run = figures(peak_force_n=250.0)
    (judged,) = evaluate([check], of_run)
    assert (judged.verdict, judged.meets_requirement) == (Verdict.FAILED, True)
    of_run.gaps = [Gap(1.0, 1.1, "plant")]
    (doubted,) = evaluate([check], of_run)
    assert (doubted.verdict, doubted.meets_requirement) == (Verdict.NOT_JUDGED, None)


def test_a_check_stays_as_it_was_read_and_a_scenario_has_500_of_them_at_most():
    table = {"name": "peak_force_n", "high": 1.0}
    checks = checks_of({"checks": [table] * 500})
    assert len(checks) == 500
    for one, name in ((checks[0], "high"), (requirements()["P-01"], "text")):
        with pytest.raises(ValidationError, match="frozen"):
            setattr(one, name, 2.0)
    with pytest.raises(ValueError, match="it has 501 checks; wanted 500 at most"):
        checks_of({"checks": [table] * 501})


@pytest.mark.parametrize(
    ("window", "duration_s", "value"),
    [
        ({}, 10.0, 9.0),  # the whole run
        ({"from_s": 0.0, "to_s": 5.0}, 10.0, 9.0),
        ({"from_s": 2.0}, 10.0, 7.0),
        ({"to_s": 10.0}, 10.0 - 0.01, 9.0),  # some ticks early
        ({"to_s": 10.0}, 9.98, None),
        ({"from_s": 20.0, "to_s": 30.0}, 10.0, None),
    ],
)
def test_a_run_that_ends_within_an_own_figures_window_does_not_have_the_figure(window, duration_s, value):
    t_s = np.arange(0.0, duration_s, 0.5)
    records = np.zeros(len(t_s), [("t_s", float), ("x_m", float)])
    records["t_s"], records["x_m"] = t_s, np.maximum(9.0 - t_s, 0.0)
    ticks = np.zeros(1, [("t_s", float)])
    check = Check(name="mine", expression="max(plant.x_m)", high=99.0, **window)
    (result,) = evaluate([check], figures(duration_s=duration_s), RunTraces(records, ticks))
    assert (result.value, result.passed) == (value, value is not None)
