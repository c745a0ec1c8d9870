"""The log: all of the traces, read back; the same whoever wrote it; mended when cut."""

import re
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
from log_hashes import column_hashes, differing_entities
from part_of_a_run import part
from run_folder import END_S, STOP_M, T_S, make_run, write_run

from firmware_py.interface.enums import Fault, Mode
from hil.figures.figures import figures_from, figures_of
from hil.judge.judge import judge
from hil.judge.verdict import CheckResult, Verdict
from hil.record.log_reader import documents, read_traces, tables
from hil.record.rrd import log_file
from hil.record.rrd.log_file import ROOM_BYTES, is_whole, repair, written_whole
from hil.record.rrd.rates import SLOW_TICKS, is_slow, slow_rows
from hil.record.rrd.rerun_program import RerunError, rerun
from hil.record.run_traces import read_run
from hil.run_files import RunFile
from hil.show.highlights import highlights
from hil.show.log_stream import LogStream, recording_id
from hil.show.rerun_log import RunLog, rebuild, write_log
from hil.show.verdict_text import verdict_text


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory):
    return write_run(make_run(), tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def log_path(run_dir):
    return rebuild(run_dir)


def states(path, timeline):
    table = tables(path)[f"/states/{timeline}"]
    times = table["sim_time"].combine_chunks().cast(pa.int64()).to_numpy() / 1e9
    return list(
        zip(times.tolist(), [value[0] for value in table["StateChange:state"].to_pylist()], strict=True)
    )


def test_the_log_gives_back_every_record(run_dir, log_path):
    written, read = read_run(run_dir), read_traces(log_path)
    for name in ("plant", "firmware", "impacts", "operator"):
        traced, logged = getattr(written, name), getattr(read, name)
        assert {*traced.dtype.names} == {*logged.dtype.names}
        for column_name in traced.dtype.names:
            wanted = traced[column_name].astype(logged.dtype[column_name])
            if is_slow(f"{name}.{column_name}"):
                wanted = wanted[np.arange(len(wanted)) // SLOW_TICKS * SLOW_TICKS]
            np.testing.assert_array_equal(logged[column_name], wanted, err_msg=column_name)
    np.testing.assert_array_equal(read.bus.load, written.bus.load)
    assert (read.run, read.outcome, read.scenario) == (written.run, written.outcome, written.scenario)


def test_ticks_are_logged_in_single_precision_and_books_at_100_hz(tmp_path):
    made_up = make_run()
    ticks = np.arange(len(made_up.firmware["tick"]))
    made_up.firmware["state.crank.omega_rad_s"] = 1.0 / (ticks + 3.0)
    made_up.firmware["state.hold.gain"] = 1.0 / (ticks + 3.0)
    for named, slow in (((), ticks // SLOW_TICKS * SLOW_TICKS), (("state.hold.gain",), ticks)):
        checks = [{"name": name, "expression": f"max(firmware.{name})", "high": 1.0} for name in named]
        made_up.scenario["checks"] = checks
        folder = write_run(made_up, tmp_path / f"{len(named)}")
        traces = read_run(folder)
        path = tmp_path / f"{len(named)}.rrd"
        with closing(RunLog(path, traces.run, traces.scenario)) as log:
            log.append(traces)
        logged = read_traces(path).firmware
        gains = (1.0 / (slow + 3.0)).astype(np.float32)
        np.testing.assert_array_equal(logged["state.hold.gain"], gains)
        speeds = (1.0 / (ticks + 3.0)).astype(np.float32)
        np.testing.assert_array_equal(logged["state.crank.omega_rad_s"], speeds)


def test_a_log_of_less_than_ten_ticks_has_every_signal(tmp_path):
    made_up = make_run()
    made_up.firmware = {name: values[3:8] for name, values in made_up.firmware.items()}
    made_up.firmware["state.hold.gain"] = np.full(5, 0.25)
    traces = read_run(write_run(made_up, tmp_path))
    path = tmp_path / "short.rrd"
    with closing(RunLog(path, traces.run, traces.scenario)) as log:
        log.append(traces)
    np.testing.assert_array_equal(read_traces(path).firmware["state.hold.gain"], 0.25)


def test_energies_and_located_impacts_are_logged_as_they_are(tmp_path):
    made_up = make_run()
    made_up.plant["friction_j"] = 1.0 / (np.arange(len(made_up.plant["tick"])) + 3.0)
    logged = read_traces(rebuild(write_run(made_up, tmp_path)))
    slow = made_up.plant["friction_j"][::SLOW_TICKS]
    np.testing.assert_array_equal(slow_rows(logged.plant)["friction_j"], slow)
    np.testing.assert_array_equal(logged.impacts["t_s"], made_up.impacts["t_s"])


def test_every_figure_can_be_recomputed_from_the_log_alone(run_dir, log_path):
    assert figures_from(read_traces(log_path)).as_json() == figures_of(run_dir).as_json()


def test_both_timelines_stand_on_every_row(log_path):
    for entity, table in tables(log_path).items():
        assert {"sim_time", "wall_time"} <= set(table.column_names), entity
        assert table["sim_time"].null_count == table["wall_time"].null_count == 0
    plant = tables(log_path)["/plant"]
    sim_ns = plant["sim_time"].combine_chunks().cast(pa.int64()).to_numpy()
    wall_ns = plant["wall_time"].combine_chunks().cast(pa.int64()).to_numpy()
    assert wall_ns[0] >= 1_000_000_000_000
    late_us = (wall_ns - sim_ns - 1_000_000_000_000) * 1e-3
    np.testing.assert_allclose(late_us, read_traces(log_path).plant["wake_latency_us"], atol=1e-3)


def events(table):
    """Their texts without their times."""
    return [text[0].partition(" s  ")[2] for text in table["TextLog:text"].to_pylist()]


def test_states_are_lanes_and_changes_are_events(log_path):
    assert [state for _, state in states(log_path, "mode")] == [
        "ready",
        "soft-start",
        "run",
        "stopping",
        "ready",
    ]
    assert states(log_path, "mode")[1][0] == pytest.approx(0.5, abs=T_S)
    texts = events(tables(log_path)["/events"])
    assert "operator asks for run at r = 1.3" in texts
    assert "regime impact" in texts


def test_the_log_has_the_load_of_the_bus_and_leaves_the_frames_to_can_log(log_path):
    log = tables(log_path)
    assert {name for name in log if name.startswith("/can/")} == {"/can/load"}
    load = log["/can/load"]["Scalars:scalars"].to_pylist()
    assert load[3][0] == pytest.approx(0.27)


def test_frames_that_cannot_be_decoded_are_named(tmp_path):
    made_up = make_run()
    made_up.can_log = "(0.100000) can0 028#FFFFFFFFFFFFFFFF\n(0.200000) can0 7AB#00\n"
    log = tables(rebuild(write_run(made_up, tmp_path)))
    texts = [text[0] for text in log["/can/rejected"]["TextLog:text"].to_pylist()]
    assert texts[0].startswith("0.100 s  0x028: ")
    assert texts[1] == "0.200 s  0x7AB: not in the DBC"


def test_the_stop_and_each_touch_down_are_drawn_where_they_are(log_path):
    log = tables(log_path)
    touch_downs = {value[0] for value in log["/impacts/touch_down"]["Scalars:scalars"].to_pylist()}
    assert touch_downs == {STOP_M}
    assert log["/module/striker"].num_rows == round(END_S / T_S) // 20


def test_the_same_traces_give_the_same_columns(run_dir, log_path, tmp_path):
    made_up = make_run()
    again = rebuild(write_run(made_up, tmp_path / "again"))
    assert column_hashes(again) == column_hashes(log_path)

    made_up.plant["x_m"][1234] *= 1.0 + 2.0**-23
    made_up.plant["friction_j"][1230] += 1e-15
    made_up.firmware["work_us"] += 1.0
    other = column_hashes(rebuild(write_run(made_up, tmp_path / "other")))
    same = column_hashes(log_path)
    assert {name for name in same if same[name] != other[name]} == {
        "/plant:trace:record.x_m",
        "/plant:trace:record.friction_j",
    }


def test_a_log_written_in_pieces_holds_the_same_as_one_written_at_once(run_dir, log_path, tmp_path):
    traces = read_run(run_dir)
    path = tmp_path / RunFile.LOG
    with closing(RunLog(path, traces.run, traces.scenario)) as log:
        for start_s in np.arange(0.0, END_S + 1.0, 0.73):
            log.append(part(traces, start_s, start_s + 0.73))
    live, whole = column_hashes(path), column_hashes(log_path)
    differing = differing_entities(live, whole)
    # The stop's line has two points a piece, and checks are judged at the end; all else is the same.
    assert differing == {"/stop", "/nis_expected", "/estimate_error", "/events"}


@pytest.mark.parametrize("lost", [1, 100, 1000, 100_000])
def test_a_log_that_was_cut_is_mended(log_path, tmp_path, lost):
    cut = tmp_path / RunFile.LOG
    cut.write_bytes(log_path.read_bytes()[:-lost])

    assert repair(cut)
    assert rerun(["rrd", "verify", cut]).returncode == 0
    assert not repair(cut)
    assert read_traces(cut).plant.dtype == read_traces(log_path).plant.dtype


@pytest.mark.parametrize("kept", [5, 12, 100, 1000])
def test_a_log_that_ends_before_its_recording_begins_is_refused_as_it_stands(log_path, tmp_path, kept):
    cut = tmp_path / RunFile.LOG
    beginning = log_path.read_bytes()[:kept]
    cut.write_bytes(beginning)

    assert not is_whole(cut)
    with pytest.raises(RerunError, match="ends before its recording begins"):
        repair(cut)
    assert cut.read_bytes() == beginning
    assert list(tmp_path.iterdir()) == [cut]


def test_what_was_appended_outlives_a_kill(run_dir, tmp_path):
    """A copy of the file taken without closing it holds everything that was appended."""
    traces = read_run(run_dir)
    log = RunLog(tmp_path / RunFile.LOG, traces.run, traces.scenario)
    log.append(part(traces, 0.0, 3.0))
    cut = tmp_path / "cut.rrd"
    cut.write_bytes((tmp_path / RunFile.LOG).read_bytes())
    log.close()

    assert repair(cut)
    assert read_traces(cut).plant["t_s"][-1] == pytest.approx(3.0 - T_S)


def test_a_failed_check_is_marked_where_it_happened(tmp_path):
    made_up = make_run()
    ticks = np.flatnonzero(made_up.firmware["outputs.impact"])
    made_up.firmware["outputs.impact"][ticks[5]] = False
    made_up.scenario["checks"] = [{"name": "detector.recall", "low": 1.0}]
    path = rebuild(write_run(made_up, tmp_path))

    ((t_s, text),) = states(path, "checks")
    assert t_s == pytest.approx(made_up.impacts["t_s"][5], abs=1e-6)
    assert text.startswith("check failed: detector.recall is 0.875, wanted ≥ 1")


def test_the_log_opens_on_the_failed_check_else_on_the_end_of_the_run_up(run_dir):
    traces = read_run(run_dir)
    figures = figures_from(traces)
    passing = highlights(traces, figures, [])
    assert passing.detail_s[0] < figures.hold_start_s < passing.detail_s[1]
    assert passing.run_up_s[0] == pytest.approx(0.5, abs=0.1)
    assert 0.0 <= passing.detail_s[0] < passing.detail_s[1] <= END_S


def test_a_run_without_firmware_or_plant_still_has_a_log(tmp_path):
    made_up = make_run()
    run_dir = write_run(made_up, tmp_path)
    (run_dir / "firmware.trace").unlink()
    (run_dir / "can.log").unlink()
    log = tables(rebuild(run_dir))
    assert "/plant" in log
    assert "/firmware" not in log


def test_faults_are_events_and_alarms(tmp_path):
    made_up = make_run()
    late = made_up.firmware["t_s"] > 4.0
    made_up.firmware["outputs.mode"][late] = Mode.FAULT
    made_up.firmware["outputs.fault"][late] = Fault.SENSOR_TIMEOUT
    path = rebuild(write_run(made_up, tmp_path))

    assert states(path, "fault")[-1] == (pytest.approx(4.0, abs=2 * T_S), "sensor-timeout")
    found = tables(path)["/events"]
    levels = dict(
        zip(
            events(found),
            [level[0] for level in found["TextLog:level"].to_pylist()],
            strict=True,
        )
    )
    assert levels["latched fault sensor-timeout"] == levels["mode fault"] == "ERROR"


def test_the_same_run_keeps_its_identity():
    run = {"scenario": "a", "clock": "real", "bus": "local", "seed": 1, "wall_start_s": 5.0}
    assert recording_id(run) == recording_id({**run, "versions": {}})
    assert recording_id(run) != recording_id({**run, "seed": 2})


def test_write_log_leaves_no_half_written_file(run_dir, tmp_path):
    traces = read_run(run_dir)
    result = CheckResult("regime", Verdict.PASSED, value="impact", unit="", limit="= impact")
    write_log(tmp_path / RunFile.LOG, traces, replace(judge(traces, run_dir), checks=(result,)))
    assert [path.name for path in tmp_path.iterdir()] == [RunFile.LOG]


@pytest.mark.parametrize("pieces_before", [0, 1])
def test_a_log_for_which_the_disk_has_no_room_leaves_the_one_that_was_there(
    log_path, run_dir, tmp_path, monkeypatch, pieces_before
):
    path = tmp_path / RunFile.LOG
    path.write_bytes(log_path.read_bytes())
    free_bytes = iter([ROOM_BYTES] * pieces_before)
    monkeypatch.setattr(log_file.shutil, "disk_usage", lambda _: SimpleNamespace(free=next(free_bytes, 0)))
    traces = read_run(run_dir)
    with pytest.raises(OSError, match="No space left"):
        write_log(path, traces, judge(traces, run_dir))
    assert path.read_bytes() == log_path.read_bytes()
    assert list(tmp_path.iterdir()) == [path]


def test_a_log_of_which_only_a_part_was_written_is_refused(log_path, tmp_path):
    path = tmp_path / RunFile.LOG
    with pytest.raises(RerunError, match="is not written"), written_whole(path) as unfinished:
        unfinished.write_bytes(log_path.read_bytes()[:-1])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", ["", "`", "``", "a `b` c", '{"x": "``y"}', "```\n`", "`" * 7])
def test_a_document_comes_back_whatever_backticks_it_has(text, tmp_path):
    stream = LogStream(tmp_path / "a.rrd", {}, None)
    stream.log_document("about/run", text, "json")
    stream.recording.disconnect()
    assert documents(tmp_path / "a.rrd")["run"] == text


def test_texts_of_a_scenario_are_shown_and_not_taken_for_markdown(tmp_path, monkeypatch):
    """The viewer would fetch the pictures of a page in Markdown."""
    text = 'title = "x"\n```\n![y](http://192.0.2.1/y.png)\n````\n'
    stream = LogStream(tmp_path / "a.rrd", {}, None)
    stream.log_document("about/scenario", text, "toml")
    stream.recording.disconnect()
    assert documents(tmp_path / "a.rrd")["scenario"] == text
    pages = []
    monkeypatch.setattr(LogStream, "log_markdown", lambda _, __, page: pages.append(page))
    stream.log_document("about/scenario", text, "toml")
    assert pages[0].startswith("`````toml\n")
    title = "![x](http://192.0.2.1/x.png)<img src=//192.0.2.1/>"
    verdict = SimpleNamespace(verdict=Verdict.PASSED, reasons=[title], not_judged=[title], by_gravity=[])
    page = verdict_text(title, {"scenario": title, "changes": [title]}, verdict)
    assert re.search(r"(?<!\\)[!\[<]", page) is None
