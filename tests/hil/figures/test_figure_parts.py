"""The parts of a run's figures: timing, forces, energy, detections, each on a few records."""

from dataclasses import asdict, is_dataclass, replace

import numpy as np
import pytest
from run_folder import HOLD_S, OMEGA_RAD_S, STOP_S, T_S, make_run, records, traces_of

from firmware_py.interface.enums import Mode, Regime
from hil.figures import figures as parts
from hil.figures import records as figure_records
from hil.figures.figures import figures_from
from hil.figures.hold import Window
from hil.figures.records import (
    EstimateFigures,
    FeltFigures,
    LogFigures,
    LoopFigures,
    Loops,
    MemoryFigures,
    SpeedFigures,
    Spread,
)
from hil.record.rrd.rates import SLOW_TICKS
from hil.record.run_traces import NO_RECORDS, RunTraces
from hil.timing.pacemaker import Hold


def test_quantiles_and_rms_are_those_of_the_values_that_there_are():
    assert parts.spread(np.arange(101.0)) == Spread(50.0, 99.0, 100.0)
    assert parts.spread(np.array([np.nan, 4.0])) == Spread(4.0, 4.0, 4.0)
    assert parts.spread(np.array([np.nan])) == Spread(None, None, None)
    assert (parts.rms(np.array([3.0, -5.0])), parts.rms(np.zeros(0))) == (pytest.approx(17.0**0.5), None)


LOOP = records(
    tick=[2, 3, 4, 7, 8],
    work_us=[0.0, 100.0, 501.0, 300.0, 200.0],
    wake_latency_us=[0.0, 500.0, 500.0005, 0.5, 20.0],
)


@pytest.mark.parametrize(("is_from_bus", "overruns"), [(False, 4), (True, 2)])
def test_a_loops_timing_is_that_of_its_ticks(is_from_bus, overruns):
    """Of periods of 1 ms two ticks are missing from 5 ms on, and two before the first, which a bus lacks."""
    found = parts.loop_figures(LOOP, 1e-3, is_from_bus)
    assert (found.ticks, found.overruns, found.late_wakeups, found.long_work) == (5, overruns, 1, 1)
    assert (found.longest_hold_ms, found.longest_hold_at_s) == pytest.approx((2.0, 5e-3))
    assert (found.work_us.p50, found.work_us.max) == (250.0, 501.0)
    assert (found.wake_us.p50, found.wake_us.max) == (260.0, 500.0005)
    measured = records(**{name: LOOP[name] for name in LOOP.dtype.names}, cpu_us=[0, 500, 501, 502, 9])
    assert parts.loop_figures(measured, 1e-3, is_from_bus).long_work == 2
    empty = parts.loop_figures(LOOP[:0], 1e-3, is_from_bus)
    assert (empty.ticks, empty.overruns, empty.longest_hold_ms) == (0, 0, None)
    one = parts.loop_figures(LOOP[:1], 1e-3, is_from_bus)
    assert (one.ticks, one.longest_hold_ms, one.longest_hold_at_s) == (1, None, None)


@pytest.mark.parametrize(
    ("run", "imported", "overruns"),
    [({}, False, (4, 4)), ({"firmware": "mine.py:tick"}, False, (4, 2)), ({}, True, (2, 2))],
)
def test_ticks_before_the_first_heartbeat_are_not_known_of_an_own_controller(run, imported, overruns):
    found = parts.both_loops(RunTraces(plant=LOOP, firmware=LOOP, run=run), 1e-3, imported)
    assert (found.plant.overruns, found.firmware.overruns) == overruns


GOOD = LoopFigures(990, 10, 0, 0, 2.9, 1.0, Spread(9.0, 500.0, 900.0), Spread(1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    ("changes", "baseline", "uml", "held_ms", "met"),
    [
        # 1,000 ticks were due: one may be missing or long, besides twice those of a bare loop; in UML ten.
        ({}, 5, False, (), True),
        ({}, 4, False, (), False),
        ({"overruns": 1, "ticks": 999}, None, False, (), True),
        ({"overruns": 2, "ticks": 998}, None, False, (), False),
        ({}, 0, True, (), True),
        ({"overruns": 11, "ticks": 989}, 0, True, (), False),
        ({"long_work": 1}, 5, False, (), True),
        ({"long_work": 2}, 5, False, (), False),
        # Each tick held counts as missing, and a stall of 3 ms is too long.
        ({"overruns": 0, "ticks": 1000}, 0, False, (0.6, 0.7), True),
        ({"overruns": 0, "ticks": 1000}, 0, False, (1.1, 1.1), False),
        ({}, 9, False, (2.9,), True),
        ({}, 9, False, (3.0,), False),
        ({"longest_hold_ms": 3.0}, 5, False, (), False),
        ({"longest_hold_ms": None}, 5, False, (), True),
        ({"work_us": Spread(9.0, 500.1, 900.0)}, 5, False, (), False),
        ({"work_us": Spread(None, None, None)}, 5, False, (), False),
        ({"ticks": 0, "overruns": 0}, 5, False, (), False),
    ],
)
def test_a_run_has_met_its_timing_if_both_loops_have(changes, baseline, uml, held_ms, met):
    loop = replace(GOOD, **changes)
    quiet = replace(GOOD, overruns=0, ticks=1000)
    for loops in (Loops(loop, quiet), Loops(quiet, loop)):
        assert parts.has_met_timing(loops, baseline, uml, held_ms) is met


@pytest.mark.parametrize(
    ("located_n", "sampled_n", "peak_n"),
    [
        ([90.0, 200.0], [0.0, 150.0], 200.0),
        ([90.0, np.nan], [0.0, 150.0, np.nan], 150.0),
        ([np.nan], [0.0, 150.0], None),  # a rigid stop
        ([], [0.0, 3.0], 3.0),
        ([], [], None),
    ],
)
def test_the_peak_force_is_the_largest_in_an_impact_or_between_them(located_n, sampled_n, peak_n):
    plant, impacts = records(stop_force_n=sampled_n), records(peak_force_n=located_n)
    assert parts.peak_force(plant, impacts) == peak_n


@pytest.mark.parametrize(
    ("turns", "peaks"),
    [
        ([0.3, 0.7, 1.1, 1.5, 1.9, 2.3, 2.7, 3.1], [5.0, 7.0]),
        ([0.3, 0.7, 1.1, 1.5, 1.9, 2.3], [5.0]),
        ([0.3, 0.7, 1.1, 1.5], []),
        ([0.2, 0.6], []),
    ],
)
def test_the_peaks_of_the_whole_turns_leave_out_the_parts_of_turns(turns, peaks):
    values = np.array([9.0, 1.0, 2.0, 4.0, 5.0, 7.0, 3.0, 9.0])[: len(turns)]
    assert parts.peaks_by_turn(2.0 * np.pi * (np.array(turns) % 1.0), values).tolist() == peaks


def test_a_single_whole_turn_in_the_second_half_of_the_hold_has_its_felt_peak():
    turns, force_n = [0.3, 0.7, 1.1, 1.5, 1.9, 2.3], [9.0, 1.0, 2.0, -4.0, 3.0, 7.0]
    plant = records(t_s=range(6), crank_rad=2.0 * np.pi * np.mod(turns, 1.0), felt_force_n=force_n)
    worn = RunTraces(plant=plant, scenario={"scene": {"wearer": {}}})
    assert parts.felt_figures(worn, Window(-5.0, 5.0)) == FeltFigures(9.0, 4.0, 4.0)
    assert parts.felt_figures(replace(worn, plant=plant[:0]), None) == FeltFigures(None, None, None)


def test_what_is_left_of_the_energy_is_a_share_of_what_was_exchanged():
    names = ("drive_work_j", "stored_j", "friction_j", "impact_loss_j", "housing_work_j", "ankle_j")
    of_the_end = dict(zip(names, (20.0, 2.0, 5.0, 4.0, 6.0, 3.0), strict=True))
    ticks = [
        0,
        SLOW_TICKS,
        2 * SLOW_TICKS,
        3 * SLOW_TICKS,
        3 * SLOW_TICKS + 1,
    ]  # the log has all but the last

    def plant(at_end):
        between = {name: (9.0 * k**2, 7.0 - k) for k, name in enumerate(names)}
        return records(tick=ticks, **{one: [1.0, *between[one], 1.0 + at_end[one], 99.0] for one in names})

    assert parts.energy_residual(plant(of_the_end)) == pytest.approx(12.0 / 40.0)
    millijoules = {name: 1e-3 * value for name, value in of_the_end.items()}
    assert parts.energy_residual(plant(millijoules)) == pytest.approx(12.0 / 40.0)
    assert parts.energy_residual(plant(dict.fromkeys(names, 0.0))) == 0.0
    assert parts.energy_residual(plant(of_the_end)[:0]) is None


def test_the_growth_of_memory_is_the_largest_of_the_nodes_and_the_recorders_in_a_minute():
    outcome = {
        "memory_growth_mb": {"plant": 1.0, "firmware": 2.0, "recorder": 6.0},
        "memory_watched_s": 120.0,
    }
    assert parts.memory_figures(outcome) == MemoryFigures(2.0, 3.0)
    assert parts.memory_figures({}) == MemoryFigures(None, None)


SENT = {
    "plant": {"sent": 30, "unsent": 0},
    "firmware": {"sent": 20, "unsent": 4},
    "firmware-again": {"sent": 5, "unsent": 1},  # restarted
    "operator": {"sent": 2, "unsent": 0},
}


@pytest.mark.parametrize(
    ("bus", "recorded", "lost", "foreign"),
    [
        # 57 frames were sent, of which 5 were refused and 3 counted as lost.
        ("local", 49, 3, 0),
        ("local", 47, 5, 0),
        ("vcan", 37, 15, 0),
        ("local", 52, 3, 3),
        ("socketcan:can0", 47, 3, 0),
    ],
)
def test_frames_of_the_runs_own_bus_that_nobody_has_recorded_or_counted_are_lost(
    bus, recorded, lost, foreign
):
    """A recorder that ends too early knows of no loss; on another bus, frames may never have left a node."""
    nodes = {**SENT, "recorder": {"frames": recorded, "lost": 3}}
    run = {"bus": bus, "nodes": nodes, "counts_losses": True}
    assert parts.log_figures(RunTraces(run=run), "real") == LogFigures(lost, foreign, 5)
    bridged = RunTraces(run=run | {"bridge": {"unsent": 2}, "counts_losses": False})
    assert parts.log_figures(bridged, "real") == LogFigures(None, None, 7)


@pytest.mark.parametrize(
    ("clock", "run", "errors", "found"),
    [
        ("real", {}, {}, (None, None, None)),
        ("real", {"nodes": {"recorder": {"frames": 9, "lost": 2}}}, {}, (None, None, None)),
        (
            "real",
            {"nodes": {"recorder": {"frames": 9, "lost": 2}}, "counts_losses": True},
            {},
            (2, None, None),
        ),
        ("lockstep", {}, {}, (0, None, 0)),
        ("lockstep", {}, {"unsent": [1, 2, 4]}, (0, None, 4)),
        ("lockstep", {}, {"destroyed": [17]}, (0, None, None)),  # of an earlier version
    ],
)
def test_what_is_not_counted_of_the_frames_is_unknown_in_real_time_and_none_in_lockstep(
    clock, run, errors, found
):
    bus_errors = records(**errors) if errors else NO_RECORDS
    assert parts.log_figures(RunTraces(run=run, bus_errors=bus_errors), clock) == LogFigures(*found)


def test_figures_of_the_hold_are_those_of_its_ticks():
    made_up = make_run()
    t_s = made_up.firmware["t_s"]
    made_up.firmware["state.estimator.nis"] = np.where(t_s < HOLD_S, 9.0, 1.5)
    made_up.firmware["outputs.regime"][t_s >= STOP_S] = Regime.LOST
    made_up.firmware["outputs.regime"][np.flatnonzero(t_s < STOP_S)[-1]] = Regime.CHATTERING
    made_up.firmware["outputs.mode"][-1] = Mode.FAULT
    made_up.firmware["outputs.target_omega_rad_s"] = np.full(len(t_s), 0.5 * OMEGA_RAD_S)
    late = made_up.plant["t_s"] >= 0.5 * (HOLD_S + STOP_S) - 1e-9
    made_up.plant["omega_rad_s"] = np.where(late, made_up.plant["omega_rad_s"], 3.0)
    made_up.plant["omega_rad_s"][5000] *= 1.02
    made_up.impacts["v_m_s"][:2] = 7.0, 8.0  # just before the hold, and in its first tick
    made_up.impacts["t_s"][:2] = HOLD_S - 0.01, HOLD_S + T_S / 2
    del made_up.outcome["wall_s"], made_up.run["kernel_can"]
    found = figures_from(traces_of(made_up))
    assert found.estimate.nis_mean == pytest.approx(1.5)
    assert (found.regime_estimated, found.final_mode) == ("chattering", "fault")
    assert found.speed.error == pytest.approx(1.0, abs=1e-4)
    assert found.speed.ripple == pytest.approx(0.01, rel=1e-3)
    assert (found.largest_v_m_s, found.largest_v_on_the_way_m_s) == (8.0, 7.0)
    assert found.realtime_factor is None
    assert not found.kernel_can
    for still in (made_up.firmware["outputs.target_omega_rad_s"], made_up.plant["omega_rad_s"]):
        before = still.copy()
        still[:] = 0.0
        assert figures_from(traces_of(made_up)).speed == SpeedFigures(None, None, None)
        still[:] = before


def test_a_hold_of_one_tick_has_a_speed_and_one_without_truth_neither_speed_nor_estimate():
    plant = records(tick=[5], t_s=[5.0], omega_rad_s=[10.0], x_m=[0.1], v_m_s=[0.0])
    signals = ("outputs.target_omega_rad_s", "state.estimator.x_m", "state.estimator.nis")
    firmware = records(tick=[5], t_s=[5.0], **{name: [8.0] for name in signals})
    hold = Window(5.0, 5.0)
    assert parts.speed_figures(plant, firmware, hold) == SpeedFigures(10.0, 0.25, 0.0)
    assert parts.speed_figures(plant[:0], firmware, hold) == SpeedFigures(None, None, None)
    assert parts.estimate_figures(plant[:0], firmware, hold) == EstimateFigures(None, None, None, None)


@pytest.mark.parametrize(("whole_s", "met"), [(0.002998, True), (0.003, False)])
def test_a_run_that_was_held_for_3_ms_has_not_met_its_timing(whole_s, met):
    made_up = make_run()
    made_up.outcome["holds"] = [asdict(Hold(1.0, "plant", whole_s, 0.0))]
    assert figures_from(traces_of(made_up)).real_time is met


def test_detections_that_the_end_of_the_run_leaves_undecided_are_not_judged():
    """An impact 40 ms before the last tick still counts, and so does a detection then."""
    ticks = records(
        t_s=np.arange(0.0, 1.001, 0.005),
        outputs__impact=np.zeros(201),
        outputs__impact_speed_m_s=np.ones(201),
    )
    touches = records(t_s=[0.5, 0.96, 0.98], v_m_s=[1.2, 1.0, 1.0], peak_force_n=[9.0, 9.0, 9.0])
    for tick in (102, 150, 199):  # the first in time, and two false ones, of which the last is too late
        ticks["outputs.impact"][tick] = 1.0
    found = parts.detector_figures(records(t_s=[0.0]), touches, ticks)
    assert (found.recall, found.precision, found.slept_through) == (0.5, 0.5, 0)
    assert found.speed_rmse_m_s is not None
    ticks["outputs.impact"][[150, 192]] = 0.0, 1.0
    assert parts.detector_figures(records(t_s=[0.0]), touches[:1], ticks).precision == 0.5
    assert parts.detector_figures(records(t_s=[0.0])[:0], touches, ticks).recall is None
    assert parts.detector_figures(records(t_s=[0.0]), touches, ticks[:0]).recall is None


def test_the_latency_has_its_median_and_95th_percentile_in_ms():
    touches_s, latency_s = 0.5 * np.arange(1, 22), 1e-3 * np.arange(21)
    touches = records(t_s=touches_s, v_m_s=np.ones(21), peak_force_n=np.full(21, 9.0))
    ticks = records(
        t_s=[*(touches_s + latency_s), 99.0],
        outputs__impact=[1] * 21 + [0],
        outputs__impact_speed_m_s=np.ones(22),
    )
    found = parts.detector_figures(records(t_s=[0.0]), touches, ticks)
    assert (found.latency_ms.p50, found.latency_ms.p95) == pytest.approx((10.0, 19.0))


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [("speed.error", -np.inf, np.inf), ("detector.recall", 0.0, 1.0), ("peak_force_n", 0.0, np.inf)],
)
def test_a_figure_has_a_range_in_which_every_run_has_it(name, low, high):
    assert figure_records.CATALOGUE[name].range == (low, high)


def test_figures_cannot_be_changed_after_the_judgement():
    kinds = [kind for kind in vars(figure_records).values() if is_dataclass(kind)]
    assert len(kinds) > 10
    assert all(kind.__dataclass_params__.frozen for kind in kinds)
