"""The cause of a run's end: a fault's limit, its value at the latch, its parameter, its row of the page."""

from pathlib import Path

import numpy as np
import pytest
from run_folder import make_run, write_run

from firmware_py.core.numbers import TAU
from firmware_py.interface.enums import AxisState, Fault, Mode
from firmware_py.shell.parameters import BY_NAME, config_from
from hil.judge.why.cause import conditions, find_cause
from hil.record.run_traces import read_run
from hil.runs.recorded_run import open_run
from hil.runs.verdict import finish

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
            row = page[fault.name if one.row == "" else one.row or one.quantity]
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
    Fault.DRIVE_WATCHDOG: ({}, ""),
}


def latched(fault, signals):
    """A made-up run that latches a fault; the signals have their values in the tick of the latch alone."""
    made_up = make_run()
    made_up.firmware["outputs.fault"][LATCHED:] = fault
    for name, value in signals.items():
        values = made_up.firmware.setdefault(name, np.zeros(len(made_up.firmware["tick"])))
        values[LATCHED] = value
    return made_up


@pytest.mark.parametrize("fault", CASES, ids=lambda fault: fault.name)
def test_the_limit_of_a_latched_fault_is_the_same_from_the_traces_and_from_the_log(tmp_path, fault):
    signals, sentence = CASES[fault]
    verdict = finish(write_run(latched(fault, signals), tmp_path))
    traces, logged = read_run(tmp_path), open_run(tmp_path)
    cause = find_cause(traces, verdict)
    at_s = traces.firmware["t_s"][LATCHED]
    name = fault.name.lower().replace("_", "-")
    assert cause.sentence.partition(": ")[0] == f"the firmware latched the fault {name} at {at_s:.4f} s"
    assert cause.sentence.partition(": ")[2] == sentence
    assert find_cause(logged.traces, logged.judged).sentence == cause.sentence
    assert (cause.limit is None) is (not sentence)


def test_the_cause_is_the_first_of_fault_failed_checks_and_emergency_stop(tmp_path):
    made_up = latched(Fault.OVERCURRENT, {})
    later = {"name": "fault", "equals": "none"}
    earlier = {"name": "capture_s", "high": 1.0}
    made_up.scenario["checks"] = [later, earlier]
    verdict = finish(write_run(made_up, tmp_path / "both"))
    cause = find_cause(read_run(tmp_path / "both"), verdict)
    assert cause.sentence.startswith("the check capture_s is ")
    assert (cause.limit.name, cause.limit.bound, cause.limit.parameter) == ("capture_s", "≤ 1", None)

    made_up.scenario["checks"] = [{"name": "gait.last_pulse_after_s", "high": 1.0}]
    verdict = finish(write_run(made_up, tmp_path / "consequence"))
    assert verdict.checks[0].value is None
    cause = find_cause(read_run(tmp_path / "consequence"), verdict)
    assert cause.sentence.startswith("the firmware latched the fault overcurrent")
    assert (cause.limit, cause.rows) == (None, ("motor current",))

    broken_off = make_run()
    broken_off.outcome["reasons"] = ["the controller failed: no such name"]
    broken_off.scenario["checks"] = [earlier]
    verdict = finish(write_run(broken_off, tmp_path / "broken-off"))
    assert (
        find_cause(read_run(tmp_path / "broken-off"), verdict).sentence
        == "the controller failed: no such name"
    )

    stopped = make_run()
    stopped.firmware["outputs.mode"][3000:] = Mode.E_STOP
    stopped.scenario["checks"] = []
    verdict = finish(write_run(stopped, tmp_path / "stopped"))
    cause = find_cause(read_run(tmp_path / "stopped"), verdict)
    assert cause.sentence == "the operator's emergency stop was latched at 3.0005 s"
    verdict = finish(write_run(make_run(), tmp_path / "passed"))
    assert find_cause(read_run(tmp_path / "passed"), verdict) is None
