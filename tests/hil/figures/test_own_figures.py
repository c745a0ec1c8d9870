"""Figures of one's own: against closed forms, on the instants that they say, and refused before a run."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError

from hil.figures.hold import Window
from hil.figures.own import ExpressionError, own_figure
from hil.judge.evaluation import evaluate
from hil.record.run_traces import RunTraces
from hil.scenario.checks import Check

WHOLE = Window(0.0, 100.0)
TICKED = SimpleNamespace(ticks=1)
LOG = SimpleNamespace(
    log=SimpleNamespace(frames_lost=0), gaps=(), loops=SimpleNamespace(plant=TICKED, firmware=TICKED)
)


def plant(t_s, **columns):
    records = np.zeros(len(t_s), [("t_s", "<f8"), *((name, "<f8") for name in columns)])
    records["t_s"] = t_s
    for name, values in columns.items():
        records[name] = values
    return records


def firmware(t_s, values):
    records = np.zeros(len(t_s), [("t_s", "<f8"), ("outputs.torque_n_m", "<f8"), ("outputs.mode", "<i8")])
    records["t_s"], records["outputs.torque_n_m"] = t_s, values
    return records


@pytest.mark.parametrize("damping", [0.2, 0.5, 0.7])
def test_a_step_response_has_the_overshoot_of_its_closed_form(damping):
    t_s = np.arange(80_000) * 1e-3
    omega_d = math.sqrt(1.0 - damping**2)
    envelope = np.exp(-damping * t_s) / omega_d
    response = 1.0 - envelope * np.sin(omega_d * t_s + math.acos(damping))
    records = plant(t_s + 3.0, omega_rad_s=5.0 + 2.0 * response)
    idle = firmware(t_s + 3.0, 0.0)
    overshoot = own_figure("overshoot(plant.omega_rad_s)", WHOLE, records, idle)
    assert overshoot == pytest.approx(100.0 * math.exp(-math.pi * damping / omega_d), abs=0.05)
    settling_s = own_figure("settling_s(plant.omega_rad_s)", WHOLE, records, idle)
    outside = t_s[np.abs(response - 1.0) > 0.02][-1]
    assert settling_s == pytest.approx(outside, abs=0.003)


def test_a_first_order_rise_takes_ln_9_time_constants():
    t_s = np.arange(10_000) * 1e-3
    records = plant(t_s, omega_rad_s=1.0 - np.exp(-t_s / 0.5))
    rise_s = own_figure("rise_s(plant.omega_rad_s)", WHOLE, records, firmware(t_s, 0.0))
    assert rise_s == pytest.approx(0.5 * math.log(9.0), abs=2e-3)


def test_the_final_value_of_a_step_is_that_of_the_last_tenth_of_the_window():
    """It overshoots for most of the time, and its last sample is wrong."""
    t_s = np.arange(100) * 1e-2
    x_m = np.select([t_s < 0.005, t_s < 0.295, t_s < 0.895, t_s < 0.985], [0.0, 0.1, 1.2, 1.0], 0.5)
    found = own_figure("overshoot(plant.x_m)", WHOLE, plant(t_s, x_m=x_m), firmware(t_s, 0.0))
    assert found == pytest.approx(20.0)
    step = plant(t_s + 2.0, x_m=np.where(t_s < 0.295, 0.0, 1.0))
    assert own_figure("settling_s(plant.x_m)", WHOLE, step, firmware(t_s, 0.0)) == pytest.approx(
        0.3, abs=2e-3
    )


def test_signals_of_the_firmware_are_those_of_its_newest_tick():
    t_s = np.arange(6) * 1.0
    held = firmware([0.5, 1.5, 3.5], [10.0, 20.0, 30.0])  # two ticks were skipped
    own = own_figure(
        "max(abs(firmware.outputs.torque_n_m - plant.x_m))", Window(1.0, 6.0), plant(t_s, x_m=t_s), held
    )
    assert own == 26.0
    expected = [10.0, 20.0, 20.0, 30.0, 30.0]
    found = own_figure("mean(firmware.outputs.torque_n_m)", Window(1.0, 6.0), plant(t_s, x_m=t_s), held)
    assert found == pytest.approx(np.mean(expected))


def test_a_window_has_its_begin_and_not_its_end():
    t_s = np.arange(10) * 1.0
    records, idle = plant(t_s, x_m=t_s), firmware(t_s, 0.0)
    assert own_figure("first(plant.x_m)", Window(2.0, 5.0), records, idle) == 2.0
    assert own_figure("last(plant.x_m)", Window(2.0, 5.0), records, idle) == 4.0
    with pytest.raises(ExpressionError, match=r"nothing was recorded from 20 s to 50 s: .* from 0 s to 9 s"):
        own_figure("last(plant.x_m)", Window(20.0, 50.0), records, idle)


def test_a_signal_of_the_firmware_before_its_first_tick_is_named_as_the_reason():
    t_s = np.arange(6) * 1.0
    for first_s in (0.5, 1.5):
        late = firmware([first_s, 2.5], [10.0, 20.0])
        with pytest.raises(ExpressionError, match=rf"gives nan; .* before its first tick at {first_s} s"):
            own_figure("mean(firmware.outputs.torque_n_m)", WHOLE, plant(t_s, x_m=t_s), late)


@pytest.mark.parametrize(
    ("expression", "first_tick_s"),
    [("max((plant.x_m + 1) / 0)", 1.5), ("max(firmware.outputs.torque_n_m / 0)", 0.0)],
)
def test_a_figure_that_is_not_finite_has_no_such_reason_without_such_a_signal(expression, first_tick_s):
    t_s = np.arange(6) * 1.0
    with pytest.raises(ExpressionError, match=r"gives inf$"):
        own_figure(expression, WHOLE, plant(t_s, x_m=t_s), firmware([first_tick_s, 2.5], [10.0, 20.0]))


@pytest.mark.parametrize(("instants", "ticks"), [(0, 1), (1, 0), (0, 0)])
def test_without_a_tick_of_both_nodes_there_is_no_figure(instants, ticks):
    records, idle = plant([0.0], x_m=[3.0]), firmware([0.0], 0.0)
    with pytest.raises(ExpressionError, match="recorded no tick"):
        own_figure("max(plant.x_m)", WHOLE, records[:instants], idle[:ticks])
    assert own_figure("max(plant.x_m)", WHOLE, records, idle) == 3.0


@pytest.mark.parametrize(
    "expression",
    [f"{name}(plant.omega_rad_s)" for name in ("rise_s", "settling_s", "overshoot")]
    + ["max(firmware.state.gait.phase)"],
)
def test_what_some_run_can_work_out_is_accepted(expression):
    assert Check(name="mine", expression=expression, high=1.0).expression == expression


@pytest.mark.parametrize(
    ("expression", "said"),
    [
        ("max(plant.omega)", r"no signal plant.omega; did you mean omega_rad_s"),
        (
            "max(firmware.outputs.torque)",
            r"no signal .*torque; did you mean outputs.torque_n_m",
        ),
        ("plant.omega_rad_s", r"is a signal; make a number of it, by min, max"),
        ("max(firmware.state.estimator)", r"cannot be worked out"),
        ("max(plant.x_m", r"cannot be worked out: .*never closed"),
        ("largest(plant.x_m)", r"'largest' is not defined; functions are min"),
        ("open('/etc/hostname')", r"'open' is not defined"),
        ("plant.__class__", r"cannot be worked out"),
        ("'word'", r"\"'word'\" is not allowed; wanted numbers"),
        ("max(3.0)", r"max is a function of a signal; got a number"),
        ("max(plant.x_m, 2.0)", r"is not allowed"),
        ("max(plant.x_m[0])", r"'plant.x_m\[0\]' is not allowed"),
        ("max(plant.x_m).real", r"a dot only stands in the name of a signal"),
        ("max(plant)", r"no signal plant; `vibrohil inspect RUN --table plant` lists"),
        ("lambda: 1", r"is not allowed"),
        ("+".join(["1"] * 200), r"more than 100 operations within one another"),
        ("1" * 1001, r"it has 1001 characters; wanted 1000 at most"),
        ("(" * 400, r"cannot be worked out"),
        ("1\x002", r"cannot be worked out"),
        ("1 < 2", r"'1 < 2' names no signal"),
    ],
)
def test_what_no_run_could_work_out_is_refused_before_it(expression, said):
    with pytest.raises(ValidationError, match=said):
        Check(name="mine", expression=expression, high=1.0)


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("2**10 + 7 // 2 - 7 % 4 * -1 / +2", 1024 + 3 + 1.5),
        ("max(plant.x_m) ** 0.5", 2.0),
        ("mean(plant.x_m > 1.5)", 0.6),
        ("sqrt(16) + abs(-1) + pi", 5.0 + math.pi),
        ("rms(plant.x_m - 1)", math.sqrt(15 / 5)),
        ("max(plant.x_m)".rjust(1000), 4.0),
    ],
)
def test_an_expression_gives_what_python_would(expression, value):
    t_s = np.arange(5) * 1.0
    assert own_figure(expression, WHOLE, plant(t_s, x_m=t_s), firmware(t_s, 0.0)) == pytest.approx(value)


@pytest.mark.parametrize(
    ("opening", "closing"), [("-", ""), ("abs(", ")"), ("1+(", ")"), ("(", "+1)"), ("1<(", ")")]
)
def test_a_hundred_operations_within_one_another_are_worked_out_and_one_more_is_refused(opening, closing):
    t_s = np.arange(2) * 1.0
    records, idle = plant(t_s, x_m=t_s), firmware(t_s, 0.0)
    assert math.isfinite(own_figure(f"{opening * 100}1{closing * 100}", WHOLE, records, idle))
    with pytest.raises(ExpressionError, match="more than 100 operations"):
        own_figure(f"{opening * 101}1{closing * 101}", WHOLE, records, idle)


@pytest.mark.parametrize("expression", ["(((9**9999)**9999)**9999)", "9" * 999, "-1e308 * 10", "(-8) ** 0.5"])
def test_powers_and_numbers_without_bound_take_no_time_and_give_no_figure(expression):
    t_s = np.arange(5) * 1.0
    with pytest.raises(ExpressionError, match=r"gives (-?inf|nan)"):
        own_figure(expression, WHOLE, plant(t_s, x_m=t_s), firmware(t_s, 0.0))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"name": "speed.ripple", "expression": "max(plant.x_m)"}, "a run has such a figure already"),
        ({"name": "speed.ripple", "from_s": 1.0}, "has a window but no expression"),
        ({"name": "mine", "expression": "max(plant.x_m)", "from_s": 2.0, "to_s": 2.0}, "is not before to_s"),
    ],
)
def test_a_check_is_of_the_run_s_figures_or_of_one_s_own(given, said):
    with pytest.raises(ValidationError, match=said):
        Check(**given, high=1.0)


@pytest.mark.parametrize(
    "compared", ["x > 3", "x >= 3", "3 < x", "3 <= x", "0 * x < -1", "(x > 3) - (x < 0)"]
)
def test_a_comparison_with_what_is_not_known_is_neither_true_nor_false(compared):
    """A limit that a signal never exceeds must not pass where the signal has no value."""
    records = plant([0.0, 1.0, 2.0], x_m=[1.0, math.nan, 2.0])
    expression = f"max({compared.replace('x', 'plant.x_m')})"
    with pytest.raises(ExpressionError, match="gives nan"):
        own_figure(expression, WHOLE, records, firmware([0.0], 0.0))
    assert own_figure(expression, Window(2.0, 3.0), records, firmware([0.0], 0.0)) == 0.0


def test_own_figures_are_checked_like_others_and_never_pass_when_missing():
    t_s = np.arange(10) * 1e-3
    traces = RunTraces(plant(t_s, x_m=t_s), firmware(t_s, 0.0))
    check = Check(name="farthest", expression="1e3 * max(plant.x_m)", high=9.5, unit="mm")
    (result,) = evaluate([check], LOG, traces)
    assert (result.passed, result.unit, result.limit) == (True, "mm", "\u2264 9.5")
    assert result.value == pytest.approx(9.0)
    (missing,) = evaluate([check], LOG)
    assert (missing.passed, missing.value) == (False, None)
