"""`vibrohil why RUN`: cause, limit and events around a fault or a failed check."""

import json

import numpy as np
from run_folder import make_run, write_run

from firmware_py.interface.enums import Fault
from hil.record.run_faults import RunFault
from hil.runs.verdict import finish
from tools.cli import run

INJECTED = RunFault("sensor-stuck", "plant", False, 4.0, None, "sensor-stuck (sensor striker)", 3000)


def answer(folder, capsys):
    assert run(["why", str(folder), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert {"cause", "limit", "events"} <= set(said)
    return said


def test_a_latched_fault_is_explained_by_what_was_injected_seen_and_exceeded(tmp_path, capsys):
    made_up = make_run()
    made_up.run["faults"] = [INJECTED._asdict()]
    made_up.scenario["checks"] = []
    made_up.firmware["outputs.fault"][4031:] = Fault.SENSOR_TIMEOUT
    made_up.firmware["outputs.mode"][4031:] = 5
    made_up.firmware["state.gate.life.same_low"] = np.full(len(made_up.firmware["tick"]), 31)
    finish(write_run(made_up, tmp_path))
    said = answer(tmp_path, capsys)
    assert said["cause"].endswith(", 32 ms after the injected fault sensor-stuck (sensor striker)")
    assert said["limit"] == {
        "name": "number of equal readings of the low range",
        "value": 31.0,
        "unit": "",
        "bound": 30.0,
        "parameter": None,
        "row": "readings of a channel without a sign of life",
    }
    assert said["injected"][0]["acted_on"] == 3000
    texts = [event["text"] for event in said["events"]]
    assert len(texts) <= 10
    assert {"injected fault: sensor-stuck (sensor striker)", "latched fault sensor-timeout"} <= set(texts)
    times_s = [event["t_s"] for event in said["events"]]
    assert times_s == sorted(times_s)

    assert run(["why", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    for text in ("readings of a channel without a sign of life", "acted 3,000 times", "4.0315 s"):
        assert text in printed


def test_a_failed_check_is_explained_by_its_limit_without_the_checks_that_passed(tmp_path, capsys):
    made_up = make_run()
    made_up.scenario["checks"] = [
        {"name": "peak_force_n", "high": 100.0},
        {"name": "regime", "equals": "impact"},
    ]
    made_up.scenario["checks"] += [
        {"name": "gait.last_pulse_after_s", "high": 1.0},
        {"name": "gait.in_window", "low": 0.5},
    ]
    finish(write_run(made_up, tmp_path))
    said = answer(tmp_path, capsys)
    assert said["cause"] == "the check peak_force_n is 250 N, wanted ≤ 100 N"
    assert said["limit"]["name"] == "peak_force_n"
    assert said["failed"] == ["peak_force_n is 250 N, wanted ≤ 100 N"]
    texts = [event["text"] for event in said["events"]]
    assert any(text.startswith("check failed: peak_force_n") for text in texts)
    assert not any("check passed" in text or "is not there" in text for text in texts)
    assert [one.partition(":")[0] for one in said["without_figure"]] == [
        "gait.last_pulse_after_s",
        "gait.in_window",
    ]


def test_a_run_without_fault_and_failed_check_has_no_cause_and_one_that_broke_off_its_reason(
    tmp_path, capsys
):
    finish(write_run(make_run(), tmp_path / "passed"))
    said = answer(tmp_path / "passed", capsys)
    assert (said["cause"], said["limit"]) == (None, None)
    broken = make_run()
    broken.scenario["checks"] = []
    broken.outcome["reasons"] = ["interrupted by SIGTERM"]
    finish(write_run(broken, tmp_path / "broken"))
    assert answer(tmp_path / "broken", capsys)["cause"] == "interrupted by SIGTERM"
