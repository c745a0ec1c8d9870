"""Reading a run: from its log alone come every figure of its verdict, its tables and its plots."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from PIL import Image
from pyarrow import csv, feather, parquet
from short_run import make_run

from hil.record.rrd.rates import SLOW_TICKS, is_slow
from hil.record.run_traces import read_bus
from hil.record.traces import trace
from hil.runs.recorded_run import open_run
from tools import cli
from tools.output import EXIT_BAD_INPUT, EXIT_PASSED

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inspected") / "run"
    assert make_run(folder)["passed"]
    return folder


def said(capsys):
    return json.loads(capsys.readouterr().out)


def test_every_figure_of_the_verdict_comes_from_the_log_alone(run_dir, tmp_path, capsys):
    alone = tmp_path / "run.rrd"
    shutil.copyfile(run_dir / "run.rrd", alone)
    assert cli.run(["inspect", str(alone), "--json"]) == EXIT_PASSED
    recomputed = said(capsys)
    verdict = json.loads((run_dir / "verdict.json").read_text())
    assert recomputed.pop("out") == str(tmp_path)
    del verdict["out"]
    assert recomputed == verdict
    assert verdict["impact_count"] > 0


def test_a_table_holds_what_the_trace_held(run_dir):
    table = open_run(run_dir).table("plant")
    records = trace.read(run_dir / "plant.trace")
    assert set(table.column_names) == {*records.dtype.names, "wall_time"}
    for name in records.dtype.names:
        logged = table[name].to_numpy()
        wanted = np.round(records[name] * 1e9) / 1e9 if name == "t_s" else records[name].astype(logged.dtype)
        if is_slow(f"plant.{name}"):
            wanted = wanted[np.arange(len(wanted)) // SLOW_TICKS * SLOW_TICKS]
        np.testing.assert_array_equal(logged, wanted, err_msg=name)


def test_frames_are_tables_raw_and_decoded(run_dir):
    logged = open_run(run_dir)
    assert logged.table("can/raw")["data"].to_pylist() == list(read_bus(run_dir / "can.log").payloads)
    estimates = logged.table("can/StrikerEstimate")
    signals = ["position_m", "velocity_m_s", "crank_omega_rad_s", "counter", "crc"]
    assert estimates.column_names[2:] == signals
    modes = logged.table("states/mode")["state"].to_pylist()
    assert modes[modes.index("ready") + 1] == "soft-start"
    assert pa.types.is_fixed_size_list(logged.table("module/striker")["translation"].type)


def test_asked_for_frames_a_log_alone_says_where_they_are(run_dir, tmp_path, capsys):
    shutil.copyfile(run_dir / "run.rrd", tmp_path / "run.rrd")
    command = ["inspect", str(tmp_path / "run.rrd"), "--table", "can/StrikerEstimate"]
    assert cli.run(command) == EXIT_BAD_INPUT
    assert "frames are in can.log" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("ending", "read"),
    [
        ("parquet", parquet.read_table),
        ("arrow", feather.read_table),
        ("csv", csv.read_csv),
        ("CSV", csv.read_csv),
    ],
)
def test_a_table_is_written_as_its_ending_says(run_dir, tmp_path, capsys, ending, read):
    path = tmp_path / f"impacts.{ending}"
    command = ["inspect", str(run_dir), "--table", "impacts/truth", "--to", str(path), "--json"]
    assert cli.run(command) == EXIT_PASSED
    assert said(capsys)["rows"] == read(path).num_rows
    np.testing.assert_array_equal(
        read(path)["v_m_s"].to_numpy(), open_run(run_dir).table("impacts/truth")["v_m_s"].to_numpy()
    )


def test_rows_in_the_middle_of_a_table_are_printed_on_request(run_dir, capsys):
    command = ["inspect", str(run_dir), "--table", "plant", "--rows", "300:303"]
    assert cli.run([*command, "--json"]) == EXIT_PASSED
    values = said(capsys)["values"]
    assert [row["tick"] for row in values] == [300, 301, 302]
    assert cli.run(command) == EXIT_PASSED
    printed = capsys.readouterr().out
    assert "plant: rows 300 to 303 of " in printed
    assert all(f"{row['x_m']:.4g}" in printed for row in values)


def test_bytes_are_hexadecimal_in_csv(run_dir, tmp_path):
    path = tmp_path / "raw.csv"
    assert cli.run(["inspect", str(run_dir), "--table", "can/raw", "--to", str(path)]) == EXIT_PASSED
    first = read_bus(run_dir / "can.log").payloads[0]
    assert csv.read_csv(path)["data"][0].as_py() == first.hex()


def test_signals_are_drawn(run_dir, tmp_path, capsys):
    path = tmp_path / "plot.png"
    signals = ["--signal", "plant.v_m_s", "--signal", "impacts/truth.v_m_s"]
    assert cli.run(["inspect", str(run_dir), "--plot", str(path), *signals, "--json"]) == EXIT_PASSED
    assert said(capsys) == {"plot": str(path), "signals": signals[1::2]}
    picture = np.asarray(Image.open(path).convert("RGB"), int)
    blue = (picture[..., 2] - picture[..., 0]) > 60
    assert np.count_nonzero(blue) > 1000


def texts_of(path):
    """The texts of an SVG picture, which matplotlib leaves as comments beside their outlines."""
    return re.findall(r"<!-- (.*?) -->", path.read_text("utf-8"))


def test_a_plot_has_the_units_of_its_signals(run_dir, tmp_path):
    path = tmp_path / "plot.svg"
    signals = [
        "--signal",
        "plant.v_m_s",
        "--signal",
        "plant.drive_work_j",
        "--signal",
        "firmware.outputs.mode",
    ]
    assert cli.run(["inspect", str(run_dir), "--plot", str(path), *signals]) == EXIT_PASSED
    assert {"m/s", "J", "time [s]"} <= set(texts_of(path))


def test_a_log_without_truth_is_drawn_by_its_own_signals(tmp_path, capsys):
    log = ROOT / "docs" / "data" / "bench.log.gz"
    folder = tmp_path / "bench"
    assert cli.run(["import", str(log), "--out", str(folder)]) == EXIT_PASSED
    capsys.readouterr()
    assert cli.run(["inspect", str(folder), "--plot", str(tmp_path / "bench.svg"), "--json"]) == EXIT_PASSED
    assert said(capsys)["signals"] == ["firmware.state.estimator.x_m", "firmware.outputs.torque_n_m"]


def test_a_log_without_signals_to_plot_is_refused(tmp_path, capsys):
    log = tmp_path / "other.log"
    log.write_text("(0.0) can0 7FF#00\n(0.1) can0 7FF#00\n")
    assert cli.run(["import", str(log), "--out", str(tmp_path / "run")]) == EXIT_PASSED
    command = ["inspect", str(tmp_path / "run"), "--plot", str(tmp_path / "x.svg")]
    assert cli.run(command) == EXIT_BAD_INPUT
    assert "no signals of plant or firmware" in capsys.readouterr().err


@pytest.mark.parametrize(("until_s", "window"), [(2.0, "whole run"), (8.0, "last 5 s")])
def test_the_plot_of_a_scene_names_its_window(until_s, window, tmp_path):
    path = tmp_path / "scene.svg"
    command = ["simulate", "table1-viscous", "--until", str(until_s), "--plot", str(path)]
    assert cli.run([*command, "--set", "scene.drive.ratio=1.1"]) == EXIT_PASSED
    texts = texts_of(path)
    assert {f"position and impacts, {window}", f"phase portrait, {window}"} <= set(texts)
    assert ("impacts, whole run" in texts) is (window != "whole run")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--table", "plnt"], "plant"),
        (["--table", "plant", "--to", "plant.xlsx"], ".parquet"),
        (["--table", "module/striker", "--to", "striker.csv"], "several numbers"),
        (["--to", "plant.csv"], "--table"),
        (["--rows", "1:2"], "--table"),
        (["--table", "plant", "--rows", "9:9"], "FROM:TO"),
        (["--table", "plant", "--rows", "900000:900001"], "rows, from 0"),
        (["--signal", "plant.x_m"], "--plot"),
        (["--plot", "x.png", "--signal", "plant.x"], "x_m"),
        (["--plot", "x.png", "--signal", "nothing"], "TABLE.COLUMN"),
        (["--plot", "x.png", "--signal", "states/mode.state"], "no numbers"),
        (["--plot", "x.docx"], ".svg"),
    ],
)
def test_what_cannot_be_given_is_refused_with_a_remedy(
    run_dir, tmp_path, monkeypatch, capsys, options, message
):
    monkeypatch.chdir(tmp_path)
    assert cli.run(["inspect", str(run_dir), *options]) == EXIT_BAD_INPUT
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
