"""The verdict on a run beside its checks: its reasons, its doubts, and the time of its first failure."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from run_folder import records

from hil.figures.moments import moment_of
from hil.figures.records import TrueImpact
from hil.figures.text import main_figures
from hil.judge.judge import judge
from hil.judge.verdict import CheckResult, FaultEffect, Verdict
from hil.record.formats import plain
from hil.record.run_faults import RunFault
from hil.record.run_traces import RunTraces

TICKS = records(t_s=[0.0, 0.5], tick=[0, 1])
WHOLE = RunTraces(outcome={"wall_s": 1.0})
CUT = "the run was cut short: it left no outcome.json"
NO_TRACES = ["plant left no readable trace", "firmware left no readable trace"]


@pytest.mark.parametrize(
    ("traces", "reasons"),
    [
        (RunTraces(), [CUT, *NO_TRACES]),
        (WHOLE, NO_TRACES),
        (replace(WHOLE, damage=("can.log is damaged",)), ["can.log is damaged", *NO_TRACES]),
        (RunTraces(outcome={"reasons": ["plant died"]}), ["plant died", *NO_TRACES]),
        (
            replace(WHOLE, run={"firmware": "mine.py:tick"}),
            [
                NO_TRACES[0],
                f"{NO_TRACES[1]}: an own controller's is made from the FirmwareHeartbeat that it sends",
            ],
        ),
        # A log of a real bench has no traces of ours, and a run that the host cut need not have them.
        (replace(WHOLE, run={"clock": "imported"}), []),
        (RunTraces(outcome={"cut_s": 2.0}), []),
    ],
)
def test_a_run_fails_by_what_it_lost_whatever_its_checks_say(traces, reasons):
    verdict = judge(traces, Path("mine"))
    assert (list(verdict.reasons), verdict.folder) == (reasons, Path("mine"))
    assert verdict.verdict is (Verdict.FAILED if reasons else Verdict.NOT_JUDGED)


def fault(acted):
    return RunFault("kick", "plant", False, 2.0, 2.0, "kick", acted)._asdict()


REFUSED = {"sent": 9, "unsent": 3, "first_unsent_ns": 3_500_000_000, "refusal": "queue full"}
LATER = REFUSED | {"unsent": 4, "first_unsent_ns": 4_500_000_000, "refusal": "bus-off"}
BY_BUS = "the bus refused 7 frames of the run's nodes, the first at 2.50 s: queue full"


@pytest.mark.parametrize(
    ("run", "doubts"),
    [
        ({"faults": [fault(None), fault(1)]}, ()),
        (
            {"faults": [fault(1), fault(0)]},
            ("the injected fault 'kick' at 2 s acted on nothing, and so shows nothing",),
        ),
        ({"nodes": {"plant": LATER, "firmware": REFUSED}, "t0_ns": 1_000_000_000}, (BY_BUS,)),
        ({"nodes": {"plant": {"sent": 9, "unsent": 0, "first_unsent_ns": None}}, "t0_ns": 0}, ()),
    ],
)
def test_a_fault_that_acted_on_nothing_and_refused_frames_make_a_run_doubtful(run, doubts):
    traces = RunTraces(
        run={"clock": "imported", **run}, outcome={"not_judged": ["the host was busy"], "wall_s": 1.0}
    )
    verdict = judge(traces, Path())
    assert verdict.doubts == ("the host was busy", *doubts)
    assert verdict.faults == tuple(FaultEffect("kick", 2.0, one["acted"]) for one in run.get("faults", []))
    # A run that fails needs no doubts.
    assert judge(replace(traces, damage=("plant.trace is damaged",)), Path()).doubts == ()


IMPACTS = records(
    t_s=[1.0, 2.0, 2.5, 3.0, 4.0],
    v_m_s=[1.0, 0.04, 0.8, 0.9, 3.0],
    peak_force_n=[90.0, 5.0, 150.0, 200.0, np.nan],
)
REPORTED = records(
    t_s=[0.0, 1.01, 3.004, 4.01, 5.0, 6.0],
    outputs__impact=[0, 1, 0, 1, 1, 0],
    outputs__impact_speed_m_s=[0.0, 0.7, 0.0, 2.9, 1.0, 0.0],
    outputs__fault=[0, 0, 0, 0, 9, 3],
    work_us=[np.nan, 7.0, 1.0, 9.0, 8.0, 1.0],
    wake_latency_us=[4.0, 1.0, 1.0, 1.0, 1.0, 1.0],
)
WORN = {"scene": {"wearer": {}}}
PLANT = records(t_s=[0.0, 1.0, 2.0], felt_force_n=[0.0, 9.0, 1.0])
FIGURES = SimpleNamespace(
    duration_s=10.0,
    hold_start_s=2.5,
    hold_end_s=7.5,
    gait=SimpleNamespace(end_s=6.5),
    safe_state=SimpleNamespace(at_s=8.5),
)


@pytest.mark.parametrize(
    ("name", "moment_s"),
    [
        ("detector.recall", 3.0),  # the one at 2 s is too weak, and no tick came after that at 2.5 s
        ("detector.precision", 5.0),
        ("detector.speed_rmse_m_s", 1.0),  # 0.3 m/s off, at 4 s 0.1 m/s
        ("fault", 5.0),
        ("peak_force_n", 3.0),
        ("felt.peak_n", 1.0),
        ("largest_v_m_s", 4.0),
        ("tick_us.p99", 4.01),
        ("wake_us.p50", 0.0),
        ("gait.end", 6.5),
        ("safe_state.impacts_after", 8.5),
        ("motor_torque_after_stop_n_m", 8.5),
        ("regime", 7.5),
        ("estimate.x_rmse_m", 7.5),
        ("capture_s", 2.5),
        ("largest_v_on_the_way_m_s", 2.5),
        ("bus_load", 10.0),
    ],
)
def test_a_failed_check_has_the_time_that_explains_it(name, moment_s):
    traces = RunTraces(plant=PLANT, firmware=REPORTED, impacts=IMPACTS, scenario=WORN)
    assert moment_of(name, traces, FIGURES) == moment_s


@pytest.mark.parametrize(
    "name",
    [
        "detector.recall",
        "detector.precision",
        "detector.speed_rmse_m_s",
        "fault",
        "peak_force_n",
        "felt.peak_n",
    ],
)
def test_a_failed_check_that_nothing_explains_has_the_end_of_the_run(name):
    quiet = REPORTED[:1]
    traces = RunTraces(plant=PLANT, firmware=quiet, impacts=IMPACTS[3:][:0])
    assert moment_of(name, traces, FIGURES) == 10.0


def test_a_report_in_the_last_ticks_is_no_false_alarm_yet():
    reported = records(
        t_s=[0.0, 5.998, 6.0], outputs__impact=[0, 1, 0], outputs__impact_speed_m_s=[0.0, 1.0, 0.0]
    )
    traces = RunTraces(plant=PLANT, firmware=reported, impacts=IMPACTS)
    assert moment_of("detector.precision", traces, FIGURES) == 10.0


def test_the_first_failure_is_the_earliest_of_the_failed_checks():
    checks = [
        {"name": "impact_count", "low": 9},
        {"name": "largest_v_m_s", "high": 1.0},
        {"name": "ticks", "low": 0},
    ]
    impacts = records(t_s=[0.25], v_m_s=[3.0], impulse_n_s=[1.0], peak_force_n=[9.0])
    verdict = judge(RunTraces(impacts=impacts, scenario={"checks": checks}), Path())
    assert {one.verdict for one in verdict.checks} == {Verdict.FAILED}
    assert verdict.first_failure_s == 0.0  # a run without a tick has lasted 0 s
    assert judge(WHOLE, Path()).first_failure_s is None


def test_the_main_figures_are_those_that_a_run_has_in_units_for_people():
    figures = judge(RunTraces(), Path()).figures
    assert [label for label, *_ in main_figures(figures)] == ["clock, bus", "duration"]
    known = replace(
        figures,
        ticks=5,
        overruns=3,
        baseline_overruns=2,
        held_s=0.031,
        real_time=False,
        bus_load=0.25,
        regime_estimated="impact",
        impacts_reported=4,
        impacts=(TrueImpact(1.0, 0.7), TrueImpact(2.0, 0.8), TrueImpact(3.0, 0.9)),
        gait=replace(figures.gait, in_window=0.75),
        estimate=replace(figures.estimate, x_rmse_m=1e-3, v_rmse_m_s=2e-2),
        detector=replace(figures.detector, recall=0.5, precision=0.625),
        speed=replace(figures.speed, ripple=0.125),
        log=replace(figures.log, frames_lost=7, frames_unsent=2),
    )
    shown = {label: (value, unit) for label, value, unit in main_figures(known)}
    del shown["clock, bus"], shown["duration"]
    assert shown == {
        "regime reported": ("impact", ""),
        "impacts reported": (4, ""),
        "last approach speed": (0.9, "m/s"),
        "strides with a pulse in the window": (75.0, "%"),
        "position error, RMS": (1.0, "mm"),
        "velocity error, RMS": (20.0, "mm/s"),
        "impacts detected": (50.0, "%"),
        "detections that are impacts": (62.5, "%"),
        "speed ripple": (12.5, "%"),
        "skipped ticks": (3, ""),
        "skipped by a bare sleep loop": (2, ""),
        "held up by the host": (31.0, "ms"),
        "met its timing": ("no; the verdict does not judge the timing", ""),
        "frames that nodes could not send": (2, ""),
        "bus load, lost frames left out": (25.0, "%"),
    }
    better = replace(known, real_time=True, impact_count=9, log=replace(known.log, frames_lost=0))
    shown = {label: value for label, value, _ in main_figures(better)}
    assert (shown["met its timing"], shown["bus load"]) == ("yes", 25.0)
    assert (shown["impacts"], "impacts reported" in shown) == (9, False)


def test_figures_in_json_are_finite_unless_asked_for_as_they_are():
    values = {"some": [np.float64(math.inf), (math.nan, -0.5)], 1: np.array([True]), "path": Path("a/b")}
    assert plain(values) == {"some": [None, [None, -0.5]], "1": [True], "path": "a/b"}
    assert plain([math.inf, 2.0, 3], finite=False) == [math.inf, 2.0, 3]


@pytest.mark.parametrize(
    ("share", "percent"), [(None, None), (0.254, 25), (1.5, 100), (-0.2, -20), (-7.0, -100)]
)
def test_a_margin_in_percent_ends_at_100_on_both_sides(share, percent):
    result = CheckResult("peak_force_n", Verdict.PASSED, 1.0, "N", "≤ 2", margin_share=share)
    assert result.margin_percent == percent
