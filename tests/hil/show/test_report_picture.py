"""The report shows the run: pictures in SVG, a close-up of the cause, and bars that mean what they show."""

import re

import numpy as np
import pytest
from run_folder import V_M_S, make_run, write_run

from firmware_py.interface.enums import Fault
from hil.record.run_faults import RunFault
from hil.runs.verdict import finish
from hil.show.report.picture import BINS, Curve, Level, Picture, Plot, Span, Strip, extrema, path_of, shapes


def page_of(made_up, folder):
    finish(write_run(made_up, folder))
    return (folder / "report.html").read_text("utf-8")


def test_a_reduced_curve_keeps_its_extrema_and_its_order():
    t_s = np.arange(100_003) * 1e-3
    values = np.sin(t_s)
    values[[777, 50_000]] = 3.0, -4.0
    values[5] = np.nan
    short_s, short = extrema(t_s, values)
    assert len(short) <= 2 * BINS
    assert (short.max(), short.min()) == (3.0, -4.0)
    assert np.all(np.diff(short_s) > 0.0)
    assert extrema(t_s[:9], values[:9])[1].tolist() == np.delete(values[:9], 5).tolist()


def test_points_within_a_horizontal_line_are_left_out():
    assert path_of(np.arange(5.0), np.array([1.0, 1.0, 1.0, 1.0, 2.0])) == "0.0,1.0 3.0,1.0 4.0,2.0"
    assert path_of(np.zeros(0), np.zeros(0)) == ""


def test_levels_and_values_lie_within_their_plot_and_names_where_they_fit():
    curve = Curve(np.array([0.0, 1.0]), np.array([5.0, 5.0]), "truth", "")
    strip = Strip("mode", [Span(0.0, 0.02, "soft-start", 0xE69F00FF), Span(0.02, 1.0, "run", 0x009E73FF)])
    drawn = shapes(Picture("", (0.0, 1.0), [strip], [Plot("", [curve], [Level(9.0, "limit")])]))
    (plot,) = drawn["plots"]
    assert plot["top"] < plot["levels"][0][0] < plot["bottom"]
    assert [box["fits"] for box in drawn["strips"][0]["boxes"]] == [False, True]


def test_the_report_shows_modes_striker_impacts_speeds_and_torque(tmp_path):
    made_up = make_run()
    made_up.scenario["checks"] = [{"name": "impact_v_m_s", "low": V_M_S / 2.0, "high": 2.0}]
    text = page_of(made_up, tmp_path)
    assert text.count("<svg") == 1, "nothing failed: no close-up"
    titles = re.findall(r'class="title"[^>]*>([^<]+)', text)
    assert titles == [
        "Striker [m]",
        "Approach speed v⁻ [m/s]",
        "Crank speed [rad/s]",
        "Torque of the motor [N m]",
    ]
    assert {"soft-start", "run", "non-impact"} <= set(re.findall(r"<title>([^<]+)", text))
    assert text.count("<circle") == 2 * len(made_up.impacts["t_s"])
    assert "impact_v_m_s 0.4864 … 2" in text
    assert len(text) < 100_000


def test_a_latched_fault_has_a_close_up_with_its_quantity_and_limit(tmp_path):
    made_up = make_run()
    fault = RunFault("sensor-stuck", "plant", False, 4.0, None, "sensor-stuck (sensor striker)")
    made_up.run["faults"] = [fault._asdict()]
    made_up.firmware["outputs.fault"][4031:] = Fault.SENSOR_TIMEOUT
    ticks = np.arange(len(made_up.firmware["tick"]))
    made_up.firmware["state.gate.life.same_low"] = np.maximum(ticks - 4000, 0)
    text = page_of(made_up, tmp_path)
    assert text.count("<svg") == 2
    assert "Number of equal readings of the low range" in text
    assert "limit (bound of the build)" in text
    assert "32 ms after the injected fault sensor-stuck (sensor striker)." in text


@pytest.mark.parametrize(
    ("check", "plot"),
    [
        ({"name": "peak_force_n", "high": 100.0}, "Force on the stop [N]"),
        (
            {"name": "own", "expression": "max(abs(plant.v_m_s))", "high": 0.1, "unit": "m/s"},
            "plant.v_m_s [m/s]",
        ),
        ({"name": "regime", "equals": "lost"}, None),
    ],
)
def test_a_failed_check_has_a_close_up_with_its_limit(tmp_path, check, plot):
    made_up = make_run()
    made_up.scenario["checks"] = [check]
    text = page_of(made_up, tmp_path)
    assert text.count("<svg") == 2
    titles = re.findall(r'class="title"[^>]*>([^<]+)', text)
    assert (plot in titles) is (plot is not None)
    assert "The check " in text


def test_bars_grow_to_the_right_of_the_limit_if_met_and_to_the_left_if_not(tmp_path):
    made_up = make_run()
    made_up.scenario["checks"] = [
        {"name": "peak_force_n", "high": 500.0},
        {"name": "impact_count", "low": 0.0, "high": 1.0},
        {"name": "regime", "equals": "lost"},
    ]
    text = page_of(made_up, tmp_path)
    bars = re.findall(
        r'<span class="margin (\S+)"[^>]*><i style="(left|right):([\d.]+)%;width:([\d.]+)%', text
    )
    assert bars == [("failed", "right", "75", "25.0"), ("passed", "left", "25", "37.5")], "none for a text"
    assert "The line in each bar is the limit." in text


def test_a_run_that_missed_its_timing_says_so_in_one_sentence_beside_its_verdict(tmp_path):
    made_up = make_run()
    made_up.firmware["work_us"][:] = 600.0
    text = page_of(made_up, tmp_path)
    assert text.count('class="badge passed"') == 1
    assert 'class="badge"' not in text, "no second badge in red"
    assert text.count("did not meet its timing (not real-time), which the verdict does not judge") == 1
