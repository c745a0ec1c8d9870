"""Checks: two-sided, deaf to NaN, and strict about names."""

from types import SimpleNamespace

import pytest
from pydantic import ValidationError

from hil.judge.checks import Check
from hil.judge.evaluation import evaluate
from hil.record.run_traces import RunTraces


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
        (8.995, SCRIPT, False, True),
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
    of_hold = Check(name="regime", equals="impact", hold_may_end=may_end)
    of_run = Check(name="impact_count", equals=8)
    held, counted = evaluate([of_hold, of_run], figures(hold_end_s=hold_end_s), traces)
    assert (held.passed, counted.passed) == (passed, True)
    if not passed:
        assert held.reason == f"the hold ended at {hold_end_s:.2f} s, before the script ends it at " + (
            "9 s" if hold_end_s < 9.0 else "12 s"
        )
