"""The log explains its verdict: words, injected faults, errors, and no empty panel."""

import os
import subprocess
from contextlib import contextmanager

import numpy as np
import pytest
import rerun.blueprint as rrb
from rerun.experimental import ViewerClient
from run_folder import make_run, write_run
from screen import require_screen

from hil.bus.model.fault_confinement import BusErrorRecord, ErrorState, NodeErrors
from hil.record.log_reader import documents, read_traces, tables
from hil.record.run_faults import RunFault
from hil.record.run_traces import read_run
from hil.record.traces.trace import TraceWriter
from hil.runs.verdict import finish
from hil.show import layout, rerun_log, window
from hil.show.legible.limits import APPROACH_LIMITS
from hil.show.rerun_log import ERROR_TICKS, rebuild
from tools.runs import view

FAULT = RunFault("sensor-stuck", "plant", False, 4.0, 4.5, "sensor-stuck (sensor striker)")
FAILING = {"name": "detector.recall", "low": 1.5}
PASSING = {"name": "impact_v_m_s", "low": 0.01, "high": 9.0}


def broken(**more):
    made_up = make_run()
    made_up.scenario["checks"] = [PASSING, FAILING]
    made_up.run["faults"] = [FAULT._asdict()]
    made_up.scenario.update(more)
    return made_up


def events(log):
    return [text[0] for text in log["/events"]["TextLog:text"].to_pylist()]


def states(log, name):
    table = log[f"/states/{name}"]
    return [state[0] for state in table["StateChange:state"].to_pylist()]


@pytest.fixture(scope="module")
def log_path(tmp_path_factory):
    """The log of a run that has failed."""
    return rebuild(write_run(broken(title="Stuck for half a second"), tmp_path_factory.mktemp("broken")))


def test_the_verdict_comes_in_words_with_failed_checks_first(log_path):
    text = documents(log_path)["verdict"]
    assert text.startswith("### FAILED: Stuck for half a second")
    assert text.index("**FAILED** | detector.recall") < text.index("passed | impact_v_m_s")


def test_injected_faults_are_a_state_timeline_and_all_that_happened_are_events(log_path):
    log = tables(log_path)
    assert states(log, "injected") == ["none", "sensor-stuck (sensor striker)", "none"]
    assert "4.000 s  injected fault: sensor-stuck (sensor striker)" in events(log)
    assert "4.500 s  injected fault over: sensor-stuck (sensor striker)" in events(log)
    assert any("check passed: impact_v_m_s" in text for text in events(log))
    assert any("check failed: detector.recall" in text for text in events(log))


def test_the_position_error_is_estimate_less_truth_in_m(tmp_path):
    made_up = broken()
    made_up.firmware["state.estimator.x_m"] = made_up.plant["x_m"] + 1e-3
    log = tables(rebuild(write_run(made_up, tmp_path)))
    errors = [record[0]["x_m"] for record in log["/estimate_error"]["trace:record"].to_pylist()]
    assert errors == pytest.approx([1e-3] * (len(made_up.plant["x_m"]) // ERROR_TICKS), abs=2e-8)


def test_bus_errors_reach_the_log_and_come_back_from_it(tmp_path):
    run_dir = write_run(broken(), tmp_path)
    well, passive = NodeErrors(), NodeErrors(136, 0, ErrorState.ERROR_PASSIVE)
    writer = TraceWriter(run_dir / "bus_errors.trace", [("", BusErrorRecord)])
    writer.append(BusErrorRecord(1.0, 17, 3, passive, well, well))
    writer.append(BusErrorRecord(2.0, 17, 3, well, well, well))
    writer.close()
    path = rebuild(run_dir)
    log = tables(path)
    assert states(log, "bus_plant") == ["error-passive", "error-active"]
    assert "1.000 s  bus: plant is error-passive" in events(log)
    from_log, from_trace = read_traces(path).bus_errors, read_run(run_dir).bus_errors
    assert from_log.dtype.names == from_trace.dtype.names
    for name in from_trace.dtype.names:
        assert np.array_equal(from_log[name], from_trace[name]), name


def contents_of(made_up, folder, monkeypatch):
    seen = []

    def noting(highlights, contents, *extents):
        seen.append(contents)
        return layout.layout(highlights, contents, *extents)

    monkeypatch.setattr(rerun_log, "layout", noting)
    rebuild(write_run(made_up, folder))
    return seen[-1]


def test_a_panel_is_there_where_it_has_something_to_show(tmp_path, monkeypatch):
    full = contents_of(broken(), tmp_path / "full", monkeypatch)
    assert full == layout.Contents(
        **{"judged": True, "failed": True, "injected": True, "refused": False},
        limited=(APPROACH_LIMITS,),
    )
    whole = broken()
    whole.impacts = {name: values[:0] for name, values in whole.impacts.items()}
    whole.firmware["outputs.impact"][:] = False
    whole.scenario["checks"] = []
    whole.run["faults"] = []
    whole.can_log = "(0.100000) can0 7AB#00\n"
    assert contents_of(whole, tmp_path / "calm", monkeypatch) == full._replace(
        limited=(), impacts=False, failed=False, injected=False, refused=True
    )


def names_of(part):
    """The names of all panels and tabs below one."""
    yield str(part.name)
    for inner in part.contents if isinstance(part, rrb.Container) else ():
        yield from names_of(inner)


def test_without_impacts_and_measured_loops_their_panels_are_gone():
    full = set(names_of(layout.layout(None, layout.Contents()).root_container))
    bare = layout.Contents(impacts=False, measured=False, refused=False)
    gone = full - set(names_of(layout.layout(None, bare).root_container))
    assert {
        layout.APPROACH_SPEED,
        layout.PEAK_FORCE,
        "Firmware loop [µs]",
        "Ticks skipped so far",
        "Frames refused",
    } <= gone


def test_after_a_failed_check_the_cursor_stays_in_its_close_up():
    panel = layout.time_panel((3.0, 6.0), failed=True)
    assert str(panel.loop_mode).lower().endswith("selection")
    assert panel.time_selection is not None
    assert layout.time_panel((3.0, 6.0), failed=False).time_selection is None


@contextmanager
def virtual_screen(monkeypatch):
    """A screen that nobody sees, as DISPLAY, for the time of the block."""
    number, written = os.pipe()
    command = ["Xvfb", "-displayfd", str(written), "-screen", "0", "1280x800x24", "-nolisten", "tcp"]
    with subprocess.Popen(command, pass_fds=(written,), stderr=subprocess.DEVNULL) as screen:
        try:
            monkeypatch.setenv("DISPLAY", f":{os.read(number, 16).decode().strip()}")
            monkeypatch.setenv("WGPU_BACKEND", "vulkan")
            yield
        finally:
            screen.terminate()
    os.close(number)
    os.close(written)


def test_the_cursor_stands_on_the_first_failed_check(tmp_path, monkeypatch):
    """In a real viewer on a virtual screen."""
    require_screen()
    made_up = make_run()
    made_up.scenario["checks"] = [{"name": "detector.recall", "low": 1.5}]
    run_dir = write_run(made_up, tmp_path)
    failure_s = finish(run_dir).first_failure_s
    commands = []

    def noted(command, **_):
        commands.append(command)
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(view.subprocess, "run", noted)
    view.open_in_window(run_dir / "run.rrd")
    assert commands[0][-2:] == ["--at", str(failure_s)]
    with virtual_screen(monkeypatch):
        viewer, url = window.open_window(run_dir / "run.rrd", stays=False)
        window.put_cursor(url, failure_s, viewer)
        current_time = ViewerClient.connect(url).get_state().recordings[0].current_time
        viewer.terminate()
        viewer.wait()
    assert current_time == round(1e9 * failure_s)
