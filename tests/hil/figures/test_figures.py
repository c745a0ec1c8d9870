"""Figures against made-up traces whose answers are known."""

import json

import numpy as np
import pytest
from run_folder import (
    END_S,
    HOLD_S,
    LATENCY_S,
    OMEGA_RAD_S,
    READY_S,
    STOP_S,
    T_S,
    V_M_S,
    MadeUpRun,
    make_run,
    records,
    traces_of,
    write_run,
)

from firmware_py.interface.enums import Fault, Mode
from hil.figures.figures import figures_from, figures_of, impact_count
from hil.figures.records import Spread
from hil.record.candump import parse_candump
from hil.record.run_traces import RunTraces, column


def drop_after(columns, t_s):
    """A process that died at `t_s`."""
    return {name: values[columns["t_s"] <= t_s] for name, values in columns.items()}


def drop_ticks(columns, ticks):
    keep = ~np.isin(columns["tick"], ticks)
    return {name: values[keep] for name, values in columns.items()}


@pytest.fixture
def made_up() -> MadeUpRun:
    return make_run()


def test_impacts_that_a_log_has_lost_are_not_counted_as_none(made_up, tmp_path):
    """A log that was cut has the plant's first records, but not yet the impacts, which come after them."""
    made_up.impacts = {name: values[:0] for name, values in made_up.impacts.items()}
    assert figures_of(write_run(made_up, tmp_path / "without")).impact_count == 0
    cut = write_run(made_up, tmp_path / "cut")
    (cut / "outcome.json").unlink()
    assert figures_of(cut).impact_count is None
    one = RunTraces(plant=records(t_s=[1.0]), impacts=records(t_s=[0.5]))
    assert impact_count(one) == 1


def test_the_made_up_run_gives_its_known_figures(made_up, tmp_path):
    figures = figures_of(write_run(made_up, tmp_path))

    assert figures.regime == figures.regime_estimated == "impact"
    assert (figures.duration_s, figures.ticks) == (END_S, round(END_S / T_S))
    assert figures.hold_start_s == pytest.approx(HOLD_S, abs=T_S)
    assert figures.hold_end_s == pytest.approx(STOP_S, abs=T_S)
    assert figures.impacts_per_period == 1.0
    assert figures.impact_count == len(figures.impacts) == len(made_up.impacts["t_s"])
    assert figures.impact_v_m_s == figures.largest_v_m_s == pytest.approx(V_M_S)
    assert figures.largest_v_on_the_way_m_s is None
    assert figures.capture_s == made_up.impacts["t_s"][0]
    assert figures.peak_force_n == 250.0
    assert figures.estimate.x_rmse_m == pytest.approx(1e-3)
    assert figures.estimate.v_rmse_m_s == pytest.approx(1e-2)
    assert figures.estimate.x_worst_m == pytest.approx(1e-3, abs=2e-8)  # single precision of 0.18 m
    assert figures.detector.precision == figures.detector.recall == 1.0
    assert figures.detector.latency_ms.p50 == pytest.approx(1e3 * LATENCY_S, abs=1.0)
    assert figures.detector.speed_rmse_m_s == pytest.approx(0.02)
    assert figures.speed.mean_rad_s == pytest.approx(OMEGA_RAD_S)
    assert figures.speed.error == pytest.approx(0.0, abs=6e-8)  # single precision of a constant speed
    assert figures.fault == "none"
    assert figures.final_mode == "ready"
    assert figures.safe_state.cause == "stop"
    assert figures.safe_state.at_s == pytest.approx(READY_S, abs=T_S)
    assert figures.motor_torque_after_stop_n_m == 0.0
    assert figures.energy_residual == pytest.approx(0.0, abs=1e-12)
    assert figures.real_time
    assert figures.realtime_factor == pytest.approx(1.0)
    # Two frames of 8 bytes a tick: 270 bits in 1 ms.
    assert figures.bus_load == pytest.approx(0.270)


def test_lockstep_gives_the_same_figures_of_physics(made_up, tmp_path):
    real = figures_of(write_run(made_up, tmp_path / "real")).as_json()
    made_up.run["clock"] = "lockstep"
    lockstep = figures_of(write_run(made_up, tmp_path / "lockstep")).as_json()

    assert {key for key in real if real[key] != lockstep[key]} == {"clock", "real_time", "time", "log"}
    assert [(one["real_time"], one["time"]) for one in (real, lockstep)] == [(True, "strict"), (None, None)]


def test_skipped_ticks_are_overruns_of_their_loop(made_up):
    made_up.firmware = drop_ticks(made_up.firmware, [2500, 2501, 4000])
    made_up.plant = drop_ticks(made_up.plant, [100])
    figures = figures_from(traces_of(made_up))

    assert figures.overruns == 4
    assert (figures.loops.plant.overruns, figures.loops.firmware.overruns) == (1, 3)
    assert figures.estimate.x_rmse_m == pytest.approx(1e-3), "ticks are joined by number, not by row"
    # A log of a real bench has no ticks before its first frames.
    made_up.plant, made_up.firmware = drop_ticks(made_up.plant, range(101)), drop_after(made_up.firmware, 2.0)
    made_up.run["clock"] = "imported"
    assert figures_from(traces_of(made_up)).overruns == 0


@pytest.mark.parametrize(
    ("skipped", "baseline", "uml", "met"),
    [
        (11, 2, False, True),
        (12, 2, False, False),
        (12, 3, False, True),
        (70, 0, True, True),
        (71, 0, True, False),
    ],
)
def test_real_time_is_judged_beside_a_bare_loop(made_up, skipped, baseline, uml, met):
    # 7000 ticks due: 0.1 % are 7, 1 % are 70.
    made_up.firmware = drop_ticks(made_up.firmware, 1000 + 2 * np.arange(skipped))
    made_up.outcome["baseline_overruns"] = baseline
    made_up.run |= {"user_mode_linux": True} if uml else {}
    figures = figures_from(traces_of(made_up))

    assert (figures.overruns, figures.real_time) == (skipped, met)


def test_durations_that_were_not_measured_have_no_quantiles(made_up):
    made_up.firmware["wake_latency_us"][:] = 0.0
    made_up.firmware["work_us"][:] = 0.0
    made_up.firmware["work_us"][7] = 0.5
    figures = figures_from(traces_of(made_up))
    assert figures.tick_us == Spread(0.5, 0.5, 0.5)
    assert figures.wake_us == Spread(None, None, None)


def test_late_wake_ups_and_long_work_are_counted_apart(made_up):
    made_up.firmware["wake_latency_us"][:3] = 501.0
    made_up.plant["work_us"][:5] = made_up.firmware["work_us"][:2] = 700.0
    figures = figures_from(traces_of(made_up))

    assert (figures.late_wakeups, figures.long_work) == (3, 7)
    assert figures.overruns == 0


def test_what_a_wearer_feels_is_the_peak_of_the_run_and_of_each_settled_turn(made_up):
    """A pull of 90 N on the way up, then a peak in each turn that is 40 N first and 60 N from 3/4 on."""
    t_s, crank_rad = made_up.plant["t_s"], made_up.plant["crank_rad"]
    late = t_s > HOLD_S + 0.75 * (STOP_S - HOLD_S)
    force_n = np.where(late, 60.0, 40.0) * np.maximum(np.sin(crank_rad), 0.0)
    force_n[np.searchsorted(t_s, HOLD_S - 0.1)] = -90.0
    force_n[t_s > STOP_S] = 0.0
    made_up.plant["felt_force_n"] = force_n
    bare = figures_from(traces_of(made_up)).felt
    assert (bare.peak_n, bare.settled_low_n, bare.settled_high_n) == (None, None, None)

    made_up.scenario["scene"]["wearer"] = {"plate_kg": 1.0, "ankle_n_m": 1e4, "ankle_n_s_m": 100.0}
    felt = figures_from(traces_of(made_up)).felt
    assert felt.peak_n == 90.0
    assert felt.settled_low_n == pytest.approx(40.0, rel=1e-3)
    assert felt.settled_high_n == pytest.approx(60.0, rel=1e-3)


def test_an_estimate_that_is_not_finite_is_a_figure_not_given(made_up):
    made_up.firmware["state.estimator.x_m"][5000:] = np.nan
    figures = figures_from(traces_of(made_up)).as_json()
    assert figures["estimate"]["x_rmse_m"] is None
    assert figures["estimate"]["v_rmse_m_s"] == pytest.approx(1e-2)
    json.dumps(figures, allow_nan=False)


def test_missed_and_false_detections(made_up):
    ticks = np.flatnonzero(made_up.firmware["outputs.impact"])
    made_up.firmware["outputs.impact"][ticks[:2]] = False
    made_up.firmware["outputs.impact"][ticks[4] + 150] = True
    figures = figures_from(traces_of(made_up))

    n = len(ticks)
    assert figures.detector.recall == pytest.approx((n - 2) / n)
    assert figures.detector.precision == pytest.approx((n - 2) / (n - 1))


def test_impacts_while_the_firmware_did_not_run_are_counted_apart(made_up):
    """The second one is missed as well, but the firmware ran 4 ms after it: that one is its own fault."""
    ticks = np.flatnonzero(made_up.firmware["outputs.impact"])
    touch_ticks = np.ceil(made_up.impacts["t_s"] / 1e-3).astype(int)
    made_up.firmware["outputs.impact"][ticks[1]] = False
    asleep = [
        *range(touch_ticks[0] - 20, touch_ticks[0] + 30),
        *range(touch_ticks[1] - 20, touch_ticks[1] + 3),
    ]
    made_up.firmware = drop_ticks(made_up.firmware, asleep)
    figures = figures_from(traces_of(made_up))

    n = len(ticks)
    assert figures.detector.slept_through == 1
    assert figures.detector.recall == pytest.approx((n - 2) / (n - 1))


def test_weak_impacts_need_not_be_seen_and_are_no_false_alarm(made_up):
    made_up.impacts["v_m_s"][:3] = 0.04
    ticks = np.flatnonzero(made_up.firmware["outputs.impact"])
    made_up.firmware["outputs.impact"][ticks[0]] = False
    figures = figures_from(traces_of(made_up))

    assert figures.detector.recall == 1.0
    assert figures.detector.precision == 1.0


def test_firmware_death_is_found_and_the_torque_after_it_measured(made_up):
    made_up.firmware = drop_after(made_up.firmware, 4.0)
    t_s = made_up.plant["t_s"]
    made_up.plant["motor_torque_n_m"] = np.where(t_s < 4.05, 0.2, 0.0)
    figures = figures_from(traces_of(made_up))

    assert figures.safe_state.cause == "firmware-silent"
    assert figures.safe_state.torque_zero_after_s == pytest.approx(0.05, abs=2 * T_S)
    assert figures.motor_torque_after_stop_n_m == 0.0
    assert figures.safe_state.impacts_after == np.count_nonzero(made_up.impacts["t_s"] > 4.0)


def test_torque_that_stays_on_is_reported(made_up):
    made_up.firmware = drop_after(made_up.firmware, 4.0)
    made_up.plant["motor_torque_n_m"][:] = -0.2
    figures = figures_from(traces_of(made_up))

    assert figures.safe_state.torque_zero_after_s is None
    assert figures.motor_torque_after_stop_n_m == pytest.approx(0.2)


def test_plant_death_is_judged_by_the_command(made_up):
    made_up.plant = drop_after(made_up.plant, 4.0)
    t_s = made_up.firmware["t_s"]
    made_up.firmware["outputs.mode"][t_s > 4.03] = Mode.FAULT
    made_up.firmware["outputs.fault"][t_s > 4.03] = Fault.SENSOR_TIMEOUT
    made_up.firmware["outputs.torque_n_m"] = np.where(t_s < 4.03, 0.1, 0.0)
    figures = figures_from(traces_of(made_up))

    assert figures.safe_state.cause == "plant-silent"
    assert figures.safe_state.command_zero_after_s == pytest.approx(0.03, abs=2 * T_S)
    assert figures.fault == "sensor-timeout"


def test_an_empty_run_folder_still_gives_figures(tmp_path):
    figures = figures_of(tmp_path)
    assert (figures.ticks, figures.duration_s, figures.final_mode) == (0, 0.0, "none")
    assert figures.regime == figures.regime_estimated == "uncertain"
    assert not figures.real_time


def test_an_unknown_column_is_an_error_that_names_its_neighbours():
    records = np.zeros(1, dtype=[("work_us", "f8")])
    with pytest.raises(KeyError, match="work_us"):
        column(records, "work_ms")


def test_a_cut_last_line_of_the_bus_log_is_left_out():
    log = parse_candump(b"(5.100000) can0 028#00FF\n(5.200000) can0 029#0")
    assert log.t_s == pytest.approx([5.1])
    assert log.payloads == (b"\x00\xff",)


def test_what_held_the_loops_up_before_a_fault_is_said(made_up):
    made_up.firmware["outputs.fault"][made_up.firmware["t_s"] > 4.0] = Fault.SENSOR_TIMEOUT
    # The first pause lies too long before it to be its cause.
    made_up.firmware = drop_ticks(made_up.firmware, [*range(3500, 3590), *range(3900, 3920)])
    made_up.plant = drop_ticks(made_up.plant, range(3950, 3990))
    latched = figures_from(traces_of(made_up)).latched

    assert latched.at_s == pytest.approx(4.0, abs=2 * T_S)
    assert latched.firmware_held_ms == pytest.approx(20.0, abs=1.5)
    assert latched.plant_held_ms == pytest.approx(40.0, abs=1.5)
