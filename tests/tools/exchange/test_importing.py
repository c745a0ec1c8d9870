"""Logs of a real bench: all three formats give the same run, and what is not understood is counted."""

import gzip
import io
import json
from contextlib import redirect_stdout
from pathlib import Path

import can
import numpy as np
import pytest

from firmware_py.interface import codec
from firmware_py.interface.enums import ActingLimit, Fault, Mode, Regime
from firmware_py.interface.generated.records import (
    FirmwareHeartbeat,
    ImpactEvent,
    SetInputTorque,
    StrikerEstimate,
)
from hil.record.bus_reconstruction import reconstruct_ticks, tick_numbers
from hil.record.candump import bus_log
from hil.record.log_reader import tables
from hil.runs import recorded_run
from hil.runs.recorded_run import open_run
from tools import cli
from tools.exchange import foreign_logs
from tools.output import EXIT_BAD_INPUT, EXIT_NOTHING_RAN, EXIT_PASSED

START_S = 1_700_000_000.0
"""A wall time: what candump writes."""
TICKS = 2000
OFFSET_S = 0.2e-3
HEARTBEAT_ID = codec.CODECS[FirmwareHeartbeat].can_id


def mode_at(tick):
    return Mode.READY if tick < 500 else Mode.SOFT_START if tick < 1000 else Mode.RUN


def frames():
    """Two seconds of a firmware on the bus: seconds from the start, identifier, data."""
    for tick in range(TICKS):
        t_s = OFFSET_S + tick * 1e-3
        if tick % 100 == 0:
            heartbeat = FirmwareHeartbeat(mode_at(tick), ActingLimit.NONE, Fault.NONE, 12.0, Regime.IMPACT)
            yield t_s, *codec.encode(heartbeat, tick // 100 % 16)
        if tick % 10 == 0:
            yield t_s, *codec.encode(StrikerEstimate(0.1 + 1e-5 * tick, 0.5, 12.0), tick // 10 % 16)
        if tick in (1200, 1700):
            yield t_s + 1e-4, *codec.encode(ImpactEvent(0.002, 0.9, 1.1), tick // 500)
        yield t_s + 2e-4, *codec.encode(SetInputTorque(0.05))


def strangers():
    yield 0.5, 0x7AB, b"\x01\x02"
    yield 0.6, 0x7AB, b"\x01\x02"
    yield 0.7, codec.CODECS[StrikerEstimate].can_id, bytes(8)


def write(path):
    with can.Logger(path) as logger:
        for t_s, can_id, data in sorted([*frames(), *strangers()]):
            logger.on_message_received(
                can.Message(
                    timestamp=START_S + t_s, arbitration_id=can_id, data=data, is_extended_id=False, channel=0
                )
            )
        remote = can.Message(
            timestamp=START_S + 1.9999,
            arbitration_id=9,
            is_remote_frame=True,
            dlc=8,
            is_extended_id=False,
            channel=0,
        )
        logger.on_message_received(remote)


@pytest.fixture(scope="module", params=["log", "log.gz", "asc", "asc.gz", "blf", "trc"])
def imported(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    path, out = folder / f"bench.{request.param}", folder / "run"
    write(path)
    with redirect_stdout(io.StringIO()) as printed:
        assert cli.run(["import", str(path), "--out", str(out), "--json"]) == EXIT_PASSED
    return out, json.loads(printed.getvalue())


def test_what_is_not_understood_is_counted(imported):
    out, result = imported
    assert result["unknown"] == {"0x7AB": 2}
    assert result["refused"] == {"0x069": 1}
    # python-can writes no remote frames to .trc
    assert result["skipped"] == ({} if result["log"].endswith(".trc") else {"remote frame": 1})
    assert (result["left_out"], result["truncated"]) == ([], None)
    assert result["frames"] == result["known"] + 3 == len([*frames()]) + 3
    assert result["duration_s"] == pytest.approx((TICKS - 1) * 1e-3 + 2e-4, abs=1e-4)
    assert result["firmware_seen"]
    assert recorded_run.log_of(out) == out / "run.rrd"


def test_modes_estimate_and_impacts_come_from_the_frames(imported):
    out, _ = imported
    log = tables(out / "run.rrd")
    assert [state for (state,) in log["/states/mode"]["StateChange:state"].to_pylist()] == [
        "ready",
        "soft-start",
        "run",
    ]
    logged = open_run(out)
    t_s, x_m = logged.signal("firmware.state.estimator.x_m")
    np.testing.assert_allclose(x_m[::10], 0.1 + 1e-5 * np.arange(0, TICKS, 10), atol=2e-5)
    assert len(t_s) == TICKS
    dots = ("detected", "detected_impulse", "touch_down")
    assert [log[f"/impacts/{name}"].num_rows for name in dots] == [2, 2, 2]
    refused = [text for (text,) in log["/can/rejected"]["TextLog:text"].to_pylist()]
    assert [text.partition(" s  ")[2] for text in refused[:2]] == ["0x7AB: not in the DBC"] * 2
    assert "/module/striker" not in log
    assert log["/module/ghost"].num_rows > 0


def test_the_sample_log_shows_impacts_and_a_latched_fault(tmp_path, capsys):
    sample = Path(__file__).parents[3] / "docs/data/bench.log.gz"
    assert cli.run(["import", str(sample), "--out", str(tmp_path / "bench")]) == EXIT_PASSED
    capsys.readouterr()
    assert cli.run(["why", str(tmp_path / "bench"), "--json"]) == EXIT_PASSED
    said = json.loads(capsys.readouterr().out)
    assert said["cause"].startswith("the firmware latched the fault sensor-timeout at 6.1")
    assert open_run(tmp_path / "bench").figures.impacts_reported == 7


def test_figures_that_need_the_truth_are_missing(imported):
    out, _ = imported
    verdict = open_run(out).verdict
    assert (verdict["reasons"], verdict["passed"]) == ([], None)
    assert verdict["regime"] == "uncertain"
    assert verdict["regime_estimated"] == "impact"
    assert (verdict["impact_count"], verdict["impacts_reported"]) == (None, 2)
    assert verdict["final_mode"] == "run"
    assert verdict["estimate"]["x_rmse_m"] is None
    assert verdict["detector"]["precision"] is None
    assert verdict["safe_state"]["cause"] is None
    assert verdict["duration_s"] == pytest.approx(TICKS * 1e-3, abs=2e-3)
    assert verdict["overruns"] == 0


def test_it_is_printed_with_what_the_firmware_reported(imported, capsys):
    out, _ = imported
    assert cli.run(["inspect", str(out)]) == EXIT_NOTHING_RAN
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert {"regime reported impact", "impacts reported 2"} <= set(lines)
    assert "not judged: an imported log has no scenario, and so no checks" in lines
    assert not any(line.startswith(("regime uncertain", "impacts 0", "check ")) for line in lines)


def test_a_clock_that_falls_back_is_a_reason_not_to_judge_the_run(tmp_path, capsys):
    """Frames of two recordings are mixed, so every figure of the run may be wrong."""
    write(tmp_path / "bench.log")
    log, run = tmp_path / "twice.log", tmp_path / "run"
    log.write_text(2 * (tmp_path / "bench.log").read_text())
    assert cli.run(["import", str(log), "--out", str(run)]) == EXIT_NOTHING_RAN
    capsys.readouterr()
    assert cli.run(["inspect", str(run)]) == EXIT_NOTHING_RAN
    printed = " ".join(capsys.readouterr().out.split())
    assert "not judged: the log's clock falls back from 1700000001.999" in printed
    assert "cut the log there and import its parts" in printed


def test_heartbeats_of_two_firmwares_are_a_reason_not_to_judge_the_run(tmp_path, capsys):
    log, run = tmp_path / "bench.log", tmp_path / "run"
    both = sorted((t_s + late_s, can_id, data) for late_s in (0.0, 0.037) for t_s, can_id, data in frames())
    log.write_text("".join(f"({t_s:.6f}) can0 {can_id:03X}#{data.hex()}\n" for t_s, can_id, data in both))
    assert cli.run(["import", str(log), "--out", str(run)]) == EXIT_NOTHING_RAN
    capsys.readouterr()
    assert cli.run(["inspect", str(run)]) == EXIT_NOTHING_RAN
    printed = " ".join(capsys.readouterr().out.split())
    assert "not judged: 40 heartbeats of a firmware within 1.9 s, and one firmware sends 20" in printed
    assert "two firmwares with the same node number share the bus" in printed


def test_a_log_in_the_folder_that_it_would_replace_is_refused(tmp_path, capsys):
    write(tmp_path / "bench.log")
    run = tmp_path / "run"
    assert cli.run(["import", str(tmp_path / "bench.log"), "--out", str(run)]) == EXIT_PASSED
    (tmp_path / "link").symlink_to(run)
    before = (run / "run.json").read_bytes()
    for log in (run / "can.log", tmp_path / "link" / "can.log"):
        assert cli.run(["import", str(log), "--out", str(run)]) == EXIT_BAD_INPUT
        assert "lies in the folder that it would replace" in " ".join(capsys.readouterr().err.split())
    assert (run / "run.json").read_bytes() == before


def test_what_came_before_the_first_heartbeat_is_no_overrun(tmp_path, capsys):
    lines = [
        f"({START_S + t_s:.6f}) can0 {can_id:03X}#{data.hex()}\n"
        for t_s, (can_id, data) in sorted((t_s, (can_id, data)) for t_s, can_id, data in frames())
    ]
    first_heartbeat = next(place for place, line in enumerate(lines) if f" {HEARTBEAT_ID:03X}#" in line)
    del lines[first_heartbeat]
    (tmp_path / "bench.log").write_text("".join(lines))
    assert cli.run(["import", str(tmp_path / "bench.log"), "--out", str(tmp_path / "run")]) == EXIT_PASSED
    firmware = open_run(tmp_path / "run").verdict["loops"]["firmware"]
    assert (firmware["ticks"], firmware["overruns"]) == (TICKS - 100, 0)


@pytest.mark.parametrize("can_ids", [(0x069, 0x7AB), (HEARTBEAT_ID, 0x7AB)])
def test_a_log_lasts_from_its_first_frame_to_its_last_whoever_sent_them(can_ids, tmp_path, capsys):
    log, run = tmp_path / "bench.log", tmp_path / "run"
    times_s = (START_S, START_S + 2.5)
    log.write_text(
        "".join(f"({t_s:.6f}) can0 {can_id:03X}#0000\n" for t_s, can_id in zip(times_s, can_ids, strict=True))
    )
    assert cli.run(["import", str(log), "--out", str(run)]) == EXIT_PASSED
    verdict = open_run(run).verdict
    assert verdict["duration_s"] == pytest.approx(2.5)
    assert verdict["bus_load"] == pytest.approx(2 * (55 + 20) / 2.5e6)


def test_times_of_a_wall_clock_stay_on_the_wall_time(tmp_path, capsys):
    write(tmp_path / "bench.log")
    assert cli.run(["import", str(tmp_path / "bench.log"), "--out", str(tmp_path / "run")]) == EXIT_PASSED
    assert f"open it with: vibrohil view {tmp_path / 'run'}" in capsys.readouterr().out
    table = open_run(tmp_path / "run").table("can/StrikerEstimate")
    wall_s = table["wall_time"].to_numpy().astype("int64") / 1e9
    np.testing.assert_allclose(wall_s - table["t_s"].to_numpy(), START_S + OFFSET_S, atol=1e-5)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("nothing.log", None, "is not there"),
        (".", None, "is no file"),
        ("notes.txt", "hello", ".blf"),
        ("broken.blf", "hello", ".blf"),
        ("broken.log", "hello", ".log"),
        ("empty.log", "", "no data frame"),
        ("broken.db", "SQLite format 3\0 and no more", "no CAN log by its name"),
        ("broken.mf4", "hello", ".mf4 is not imported"),
        ("broken.trc", "hello", "no data frame"),
        ("broken.trc.gz", "hello", "cannot be read as text"),
        ("broken.blf.gz", "hello", "only text"),
    ],
)
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # python-can leaves it open
def test_what_is_no_log_is_refused(tmp_path, capsys, name, content, message):
    if content is not None:
        (tmp_path / name).write_text(content)
    assert cli.run(["import", str(tmp_path / name), "--out", str(tmp_path / "run")]) == EXIT_BAD_INPUT
    assert message in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_a_log_that_is_large_once_unpacked_is_refused_before_it_takes_all_memory(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(foreign_logs, "LARGEST_BYTES", 1 << 20)
    (tmp_path / "bomb.log.gz").write_bytes(gzip.compress(bytes(2 << 20)))
    (tmp_path / "long.blf").write_bytes(bytes(2 << 20))
    for name in ("bomb.log.gz", "long.blf"):
        assert cli.run(["import", str(tmp_path / name), "--out", str(tmp_path / "run")]) == EXIT_BAD_INPUT
        assert "more than 1 MB" in capsys.readouterr().err


GOOD = "(1700000000.000000) can0 00E#CDCC4C3D00000000\n"
LINES = [GOOD, "# a comment\n", "\n", "(1700000000.001) can0 00E#CD\n", "(17000000", "00) rubbish\n", GOOD]


def test_a_line_that_cannot_be_read_is_named(tmp_path, capsys):
    (tmp_path / "bench.log").write_text("".join(LINES))
    assert cli.run(["import", str(tmp_path / "bench.log"), "--out", str(tmp_path / "run")]) == EXIT_BAD_INPUT
    stderr = capsys.readouterr().err
    assert "line 5" in stderr
    assert "(1700000000) rubbish" in " ".join(stderr.split())
    assert "--tolerant" in stderr


def test_a_tolerant_reading_leaves_such_lines_out_and_lists_them(tmp_path, capsys):
    (tmp_path / "bench.log").write_text("".join([*LINES, "cut"]))
    arguments = [
        "import",
        str(tmp_path / "bench.log"),
        "--out",
        str(tmp_path / "run"),
        "--tolerant",
        "--json",
    ]
    assert cli.run(arguments) == EXIT_NOTHING_RAN
    result = json.loads(capsys.readouterr().out)
    assert [line["number"] for line in result["left_out"]] == [5, 7]
    assert result["frames"] == 3
    assert result["refused"] == {"0x00E": 1}
    assert result["truncated"] == "its last line has no end"


@pytest.mark.parametrize("kind", ["asc", "blf", "trc", "log"])
def test_a_log_that_is_cut_short_says_so(tmp_path, capsys, kind):
    path = tmp_path / f"bench.{kind}"
    write(path)
    path.write_bytes(path.read_bytes()[: -5000 if kind == "blf" else -3])
    arguments = ["import", str(path), "--out", str(tmp_path / "run"), "--tolerant", "--json"]
    assert cli.run(arguments) == EXIT_PASSED
    assert json.loads(capsys.readouterr().out)["truncated"]


def test_an_error_frame_without_a_channel_is_counted_for_each(tmp_path, capsys):
    path = tmp_path / "bench.log"
    frames = "".join(f"(1700000000.{k}) can{k % 2} 00E#CDCC4C3D\n" for k in range(10))
    path.write_text(f"{frames}(1700000001.0) can0 20000080#0000000000000000\n")
    for channel in ("can0", "can1"):
        command = ["import", str(path), "--out", str(tmp_path / channel), "--json", "--channel", channel]
        assert cli.run(command) == EXIT_PASSED
        result = json.loads(capsys.readouterr().out)
        assert (result["frames"], result["skipped"]) == (5, {"error frame": 1})


def test_of_several_channels_one_is_chosen(tmp_path, capsys):
    path = tmp_path / "bench.log"
    path.write_text(GOOD + GOOD.replace("can0", "can1") + GOOD)
    assert cli.run(["import", str(path), "--out", str(tmp_path / "run")]) == EXIT_BAD_INPUT
    stderr = " ".join(capsys.readouterr().err.split())
    assert "can0 (2 messages), can1 (1 messages)" in stderr
    assert "--channel" in stderr
    arguments = ["import", str(path), "--out", str(tmp_path / "run"), "--json", "--channel"]
    assert cli.run([*arguments, "can2"]) == EXIT_BAD_INPUT
    capsys.readouterr()
    assert cli.run([*arguments, "can0"]) == EXIT_PASSED
    assert json.loads(capsys.readouterr().out)["frames"] == 2


def test_a_run_in_which_nothing_was_checked_has_not_passed(imported, capsys):
    out, _ = imported
    assert cli.run(["inspect", str(out), "--json"]) == EXIT_NOTHING_RAN
    assert json.loads(capsys.readouterr().out)["passed"] is None


def test_a_folder_with_something_in_it_is_left_alone(tmp_path, capsys):
    write(tmp_path / "bench.log")
    assert cli.run(["import", str(tmp_path / "bench.log"), "--out", str(tmp_path)]) == EXIT_BAD_INPUT
    assert "--out" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["bench.log"]


@pytest.mark.parametrize("phase_s", [0.0, 0.0002, 0.0005, 0.0009])
def test_jitter_moves_no_frame_into_another_tick(phase_s):
    jitter_s = np.random.default_rng(1).uniform(-2e-4, 2e-4, 5000)
    numbers = tick_numbers(0.01 + phase_s + np.arange(5000) * 1e-3 + jitter_s, 1e-3)
    np.testing.assert_array_equal(np.diff(numbers), 1)


def test_a_bus_without_firmware_shows_no_ticks():
    torque = codec.encode(SetInputTorque(0.1))
    bus = bus_log(np.array([0.1]), np.array([torque.can_id]), (torque.data,))
    assert reconstruct_ticks(bus, 1e-3) == {}


def test_an_adapter_that_bundles_frames_hides_no_ticks():
    """All frames of a bundle have its time."""
    t_s, can_ids, payloads = zip(*frames(), strict=True)
    bundle_s = 0.016 * np.ceil(np.array(t_s) / 0.016)
    found = reconstruct_ticks(bus_log(bundle_s, np.array(can_ids), payloads), 1e-3)
    np.testing.assert_array_equal(np.diff(found["tick"]), 1)
    assert len(found["tick"]) == TICKS - 15  # before the bundle of the first heartbeat, nothing is known
    assert np.count_nonzero(found["outputs.impact"]) == 2
