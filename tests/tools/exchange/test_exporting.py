"""Frames exported for other programs come back with their values, times and units."""

import io
import json
import re
from contextlib import redirect_stdout

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv, parquet
from short_run import make_run

from firmware_py.interface import codec
from firmware_py.interface.dbc import database
from hil.runs.recorded_run import open_run
from tools import cli
from tools.exchange.csv_table import write_csv
from tools.output import EXIT_BAD_INPUT, EXIT_PASSED

FRAME = "Accelerometer"
UNIT = "m/s^2"
SIGNAL = "housing_m_s2"
SINGLE = 1e-7
"""The log keeps decoded signals in single precision."""


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory):
    run_dir = tmp_path_factory.mktemp("exported") / "run"
    make_run(run_dir)
    return run_dir


@pytest.fixture(scope="module")
def truth(run_dir):
    """The frame as `can.log` has it: seconds and the signal."""
    logged = open_run(run_dir)
    raw = logged.table("can/raw")
    rows = [
        (t_s, codec.ACCELEROMETER.decode(data).housing_m_s2)
        for t_s, can_id, data in zip(
            *(raw[name].to_pylist() for name in ("t_s", "can_id", "data")), strict=True
        )
        if can_id == codec.ACCELEROMETER.can_id
    ]
    return np.array(rows).T


def exported(run_dir, kind, out):
    with redirect_stdout(io.StringIO()) as printed:
        assert cli.run(["export", str(run_dir), "--to", kind, "--out", str(out), "--json"]) == EXIT_PASSED
    return json.loads(printed.getvalue())


def test_every_signal_of_the_dbc_is_exported_counters_and_crcs_too(run_dir, tmp_path):
    """Held to cantools, which decodes the raw bytes."""
    result = exported(run_dir, "parquet", tmp_path / "run")
    raw = open_run(run_dir).table("can/raw")
    for name in result["frames"]:
        message = database().get_message_by_name(name)
        table = parquet.read_table(tmp_path / "run" / f"{name}.parquet")
        rows = np.flatnonzero(raw["can_id"].to_numpy() == message.frame_id)
        wanted = [message.decode(data, decode_choices=False) for data in raw["data"].take(rows).to_pylist()]
        assert set(table.column_names) == {"t_s", "wall_time", *(signal.name for signal in message.signals)}
        for signal in message.signals:
            found = table[signal.name].to_numpy()
            np.testing.assert_allclose(found, [one[signal.name] for one in wanted], rtol=1e-6, atol=1e-9)


def test_mf4(run_dir, truth, tmp_path):
    asammdf = pytest.importorskip("asammdf", reason="asammdf reads .mf4; it is in requirements-dev.lock")
    result = exported(run_dir, "mf4", tmp_path / "run.mf4")
    with asammdf.MDF(tmp_path / "run.mf4") as file:
        signal = file.get(f"{FRAME}.{SIGNAL}")
        assert signal.unit == UNIT
        np.testing.assert_allclose(signal.timestamps, truth[0], atol=1e-9)
        np.testing.assert_allclose(signal.samples, truth[1], rtol=SINGLE)
        names = {name.partition(".")[0] for name in file.channels_db if "." in name}
    assert names == set(result["frames"])


def test_mcap(run_dir, truth, tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="mcap reads .mcap; it is in requirements-dev.lock")
    exported(run_dir, "mcap", tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as stream:
        found = [*reader.make_reader(stream).iter_messages(topics=[f"/can/{FRAME}"])]
    schema = json.loads(found[0][0].data)
    assert schema["properties"][SIGNAL]["unit"] == UNIT
    values = [json.loads(message.data)[SIGNAL] for _, _, message in found]
    np.testing.assert_allclose(values, truth[1], rtol=SINGLE)
    t_s = np.array([message.log_time for _, _, message in found]) * 1e-9
    np.testing.assert_allclose(t_s - t_s[0], truth[0] - truth[0][0], atol=1e-6)


def test_parquet(run_dir, truth, tmp_path):
    result = exported(run_dir, "parquet", tmp_path / "frames")
    assert {path.stem for path in (tmp_path / "frames").iterdir()} == set(result["frames"])
    table = parquet.read_table(tmp_path / "frames" / f"{FRAME}.parquet")
    assert table.schema.field(SIGNAL).metadata[b"unit"] == UNIT.encode()
    np.testing.assert_allclose(table[SIGNAL].to_numpy(), truth[1], rtol=SINGLE)
    np.testing.assert_array_equal(table["t_s"].to_numpy(), truth[0])
    assert table.schema.field("wall_time").type == pa.timestamp("ns")


def test_csv(run_dir, truth, tmp_path):
    exported(run_dir, "csv", tmp_path / "frames")
    table = csv.read_csv(tmp_path / "frames" / f"{FRAME}.csv")
    np.testing.assert_allclose(table[f"{SIGNAL} [{UNIT}]"].to_numpy(), truth[1], rtol=SINGLE)
    np.testing.assert_array_equal(table["t_s [s]"].to_numpy(), truth[0])


def test_csv_columns_are_floats_throughout_and_texts_are_no_formulas(tmp_path):
    """Other readers guess a column's type from its first rows; polars takes these texts for floats."""
    floats = pa.array([0.0, -3.0, 0.1, 1e20, 1e-9, float("nan"), float("inf"), None], pa.float32())
    texts = ["ready", "=1+1", "+1", "-1", "@SUM(A1)", "\t\uff1d1", 'a\n"b",c', None]
    gaps = [None, *range(7)]
    table = pa.table(
        {"x [m]": floats, "late": [*[None] * 7, 0.5], "gaps": gaps, "=n": range(8), "text": texts}
    )
    write_csv(table, tmp_path / "table.csv")
    lines = (tmp_path / "table.csv").read_text().splitlines()
    assert lines[0] == '"x [m]","late","gaps","\'=n","text"'
    polars_float = r"[-+]?((\d*\.\d+)([eE][-+]?\d+)?|inf|NaN|(\d+)[eE][-+]?\d+|\d+\.)"
    for line in lines[1:]:
        assert all(re.fullmatch(polars_float, cell) for cell in line.split(",")[:3])
    found = csv.read_csv(tmp_path / "table.csv")
    assert found["'=n"].to_pylist() == list(range(8))
    assert found["text"].to_pylist() == [
        *("ready", "'=1+1", "'+1", "'-1", "'@SUM(A1)", "' \uff1d1", 'a "b",c', "")
    ]


def test_nothing_is_written_over(run_dir, tmp_path, capsys):
    (tmp_path / "taken").mkdir()
    arguments = ["export", str(run_dir), "--to", "csv", "--out", str(tmp_path / "taken")]
    assert cli.run(arguments) == EXIT_BAD_INPUT
    assert "there already" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "kind"), [("frames.csv", "csv"), ("frames.MF4", "mf4"), ("frames", "mf4")])
def test_the_format_is_by_default_the_ending_of_the_place(run_dir, tmp_path, name, kind):
    with redirect_stdout(io.StringIO()) as printed:
        assert cli.run(["export", str(run_dir), "--out", str(tmp_path / name), "--json"]) == EXIT_PASSED
    assert json.loads(printed.getvalue())["to"] == kind
    assert (tmp_path / name).is_dir() == (kind == "csv")


@pytest.mark.parametrize("name", ["run", "run.of.today", "run.MF4"])
def test_mf4_is_written_to_the_named_file_and_to_no_other(run_dir, tmp_path, name):
    asammdf = pytest.importorskip("asammdf", reason="asammdf reads .mf4; it is in requirements-dev.lock")
    (tmp_path / "run.mf4").write_text("mine")
    exported(run_dir, "mf4", tmp_path / name)
    assert (tmp_path / "run.mf4").read_text() == "mine"
    assert {path.name for path in tmp_path.iterdir()} == {name, "run.mf4"}
    with asammdf.MDF(io.BytesIO((tmp_path / name).read_bytes())) as file:
        assert f"{FRAME}.{SIGNAL}" in file.channels_db
