"""The cause of a run's end: a fault's limit, its value at the latch, its parameter, its row of the page."""

from pathlib import Path

import numpy as np
import pytest
from run_folder import make_run, traces_of, write_run

from firmware_py.core.numbers import TAU
from firmware_py.interface.enums import AxisState, Fault, Mode
from firmware_py.shell.parameters import BY_NAME, config_from
from hil.judge.judge import judge
from hil.judge.why.cause import Cause, conditions, find_cause
from hil.record.run_traces import RunTraces, read_run
from hil.runs.recorded_run import open_run
from hil.runs.verdict import finish
from hil.show.report.run_picture import close_up

SAFETY = Path(__file__).parents[3] / "docs/safety.md"
LATCHED = 6007
"""Tick of the latch: none of those at which the log has every signal."""
NOT_LATCHED = {Fault.NONE, Fault.REQUEST_REFUSED}


def rows_of_the_page():
    """The whole rows of the tables of faults and of limits, by the fault's name or by the first cell."""
    text = SAFETY.read_text("utf-8").partition("## Reaction times")
    lines = (text[0] + text[2].partition("\n## ")[2]).splitlines()
    rows = [line.strip("| ").split(" | ") for line in lines if "|" in line]
    return {(cells[1] if cells[0].isdecimal() else cells[0]): " ".join(cells) for cells in rows}


def test_every_latched_fault_has_its_conditions_and_every_condition_its_row_with_the_parameter():
    assert set(conditions()) == set(Fault) - NOT_LATCHED
    page = rows_of_the_page()
    for fault, of_fault in conditions().items():
        for one in of_fault:
            assert np.isfinite(one.limit(config_from({})))
            row = page[one.row_for(fault)]
            assert fault.name in row, one
            for name in filter(None, (one.parameter, one.lasting)):
                assert name in BY_NAME
                assert name in row or "full_scale" in name, one


# What the firmware has at the latch, and the sentence of the limit that results.
CASES = {
    Fault.SENSOR_TIMEOUT: (
        {"state.gate.life.same_low": 31, "inputs.accelerometer.age_ticks": 0, "state.gate.reading_ticks": 0},
        "number of equal readings of the low range was 31, limit 30",
    ),
    Fault.DRIVE_TIMEOUT: (
        {"inputs.drive.age_ticks": 20, "inputs.power.age_ticks": 351},
        "silence of the drive was 0.351 s, limit 0.35 s (watchdog.drive_s)",
    ),
    Fault.DRIVE_ERROR: (
        {
            **{"inputs.drive.axis_error": 0, "state.monitors.enabled": 1, "state.monitors.enable_ticks": 0},
            "inputs.drive.axis_state": AxisState.IDLE,
        },
        "axis out of closed loop by itself was 1, limit 0",
    ),
    Fault.OVERSPEED: (
        {"state.gate.own_rad_s": -26.0, "inputs.encoder.velocity_rev_s": -26.0 / TAU},
        "crank speed from the positions, over 20 ms was 26 rad/s, limit 25 rad/s (limit.overspeed_rad_s)",
    ),
    Fault.OVERTEMPERATURE: (
        {"inputs.power.inverter_degc": 40.0, "inputs.power.motor_degc": -31.0},
        "temperature of the motor was -31 °C, limit -30 °C (limit.lowest_degc)",
    ),
    Fault.UNDERVOLTAGE: (
        {"inputs.power.voltage_v": 15.0},
        "supply voltage was 15 V, limit 18 V (limit.lowest_v) for 0.15 s (limit.voltage_s)",
    ),
    Fault.IMPULSE_LIMIT: (
        {"state.gate.contact.change_m_s": -4.5},
        "impulse of a contact was 3.6 N s, limit 3.2 N s (limit.impulse_n_s)",
    ),
    Fault.FORCE_LIMIT: (
        {"state.gate.contact.deviation_m_s2": 2000.0, "inputs.accelerometer.high_m_s2": np.nan},
        "high-range reading, which may be clipped was —, limit 1922 m/s² (sensor.high_full_scale_m_s2)",
    ),
    Fault.STALL: (
        {"state.own_crank.tracked.omega_rad_s": 2.0, "outputs.target_omega_rad_s": 10.0},
        "crank speed over its target was 0.2, limit 0.3 (limit.stall_share) for 0.8 s (limit.stall_s)",
    ),
    Fault.LOAD_IMPLAUSIBLE: (
        {"state.own_crank.tracked.disturbance_rad_s2": -302.0},
        "unexplained torque on the crank was 0.151 N m, limit 0.15 N m",
    ),
    Fault.STOP_FAILED: (
        {"state.monitors.held.stop_failed": 2001},
        "duration of the stop was 2.001 s, limit 2 s",
    ),
    Fault.DRIVE_WATCHDOG: ({}, ""),
}
# Of several limits that are exceeded the one is named that is exceeded by the largest share of its bound.
FURTHEST = [
    (
        Fault.DRIVE_ERROR,
        {
            **{
                "inputs.drive.axis_error": 0,
                "state.monitors.enabled": 1,
                "state.monitors.enable_ticks": 1001,
            },
            "inputs.drive.axis_state": AxisState.CLOSED_LOOP_CONTROL,
        },
        "time to close or open the axis was 1.001 s, limit 1 s (watchdog.enable_s)",
    ),
    (
        Fault.OVERTEMPERATURE,
        {"inputs.power.inverter_degc": 82.0, "inputs.power.motor_degc": -31.0},
        "temperature of the motor was -31 °C, limit -30 °C (limit.lowest_degc)",
    ),
    (
        Fault.OVERTEMPERATURE,
        {"inputs.power.inverter_degc": 84.0, "inputs.power.motor_degc": -31.0},
        "temperature of the inverter was 84 °C, limit 80 °C (limit.inverter_degc)",
    ),
    (
        Fault.FORCE_LIMIT,
        {"state.gate.contact.deviation_m_s2": 1515.0 / 0.8, "inputs.accelerometer.high_m_s2": 1937.0},
        "force of the stop was 1515 N, limit 1500 N (limit.force_n)",
    ),
]


def latched(fault, signals):
    """A made-up run that latches a fault; the signals have their values in the tick of the latch alone."""
    made_up = make_run()
    made_up.firmware["outputs.fault"][LATCHED:] = fault
    for name, value in signals.items():
        values = made_up.firmware.setdefault(name, np.zeros(len(made_up.firmware["tick"])))
        values[LATCHED] = value
    return made_up


def judged(made_up):
    """The cause of the end of a made-up run, and its verdict."""
    traces = traces_of(made_up)
    verdict = judge(traces, Path())
    return find_cause(traces, verdict), verdict


@pytest.mark.parametrize(("fault", "signals", "sentence"), [(one, *CASES[one]) for one in CASES] + FURTHEST)
def test_a_latched_fault_names_the_limit_that_was_exceeded(fault, signals, sentence):
    cause, _ = judged(latched(fault, signals))
    name = fault.name.lower().replace("_", "-")
    head = f"the firmware latched the fault {name} at 6.0075 s"
    assert cause.sentence == (f"{head}: {sentence}" if sentence else head)
    assert (cause.limit is None) is (not sentence)


@pytest.mark.parametrize("fault", CASES, ids=lambda fault: fault.name)
def test_the_limit_of_a_latched_fault_is_the_same_from_the_traces_and_from_the_log(tmp_path, fault):
    verdict = finish(write_run(latched(fault, CASES[fault][0]), tmp_path))
    logged = open_run(tmp_path)
    assert (
        find_cause(logged.traces, logged.judged).sentence == find_cause(read_run(tmp_path), verdict).sentence
    )


def test_the_cause_is_the_first_of_fault_failed_checks_and_emergency_stop():
    made_up = latched(Fault.OVERCURRENT, {})
    later = {"name": "fault", "equals": "none"}
    earlier = {"name": "capture_s", "high": 1.0}
    made_up.scenario["checks"] = [later, earlier]
    cause, _ = judged(made_up)
    assert cause.sentence.startswith("the check capture_s is ")
    assert (cause.limit.name, cause.limit.bound, cause.limit.parameter) == ("capture_s", "≤ 1", None)

    made_up.scenario["checks"] = [{"name": "gait.last_pulse_after_s", "high": 1.0}]
    cause, verdict = judged(made_up)
    assert verdict.checks[0].value is None
    assert cause.sentence.startswith("the firmware latched the fault overcurrent")
    assert (cause.limit, cause.rows) == (None, ("motor current",))

    broken_off = make_run()
    broken_off.outcome["reasons"] = ["the controller failed: no such name"]
    broken_off.scenario["checks"] = [earlier]
    cause, _ = judged(broken_off)
    assert (cause.at_s, cause.sentence) == (6.9995, "the controller failed: no such name")
    nothing = RunTraces()
    assert find_cause(nothing, judge(nothing, Path())).at_s == 0.0

    stopped = make_run()
    stopped.firmware["outputs.mode"][3000:] = Mode.E_STOP
    stopped.scenario["checks"] = []
    assert judged(stopped)[0].sentence == "the operator's emergency stop was latched at 3.0005 s"
    assert judged(make_run())[0] is None


@pytest.mark.parametrize(("at_s", "from_s", "to_s"), [(0.2, 0.0, 1.5), (5.0, 4.0, 5.5), (6.9, 5.5, 7.0)])
def test_a_close_up_shows_a_second_before_the_cause_and_half_a_second_after_it(at_s, from_s, to_s):
    picture = close_up(traces_of(make_run()), 7.0, Cause(at_s, "", None))
    assert picture.window_s == (from_s, to_s)
