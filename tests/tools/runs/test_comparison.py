"""Two runs side by side: equal where they are, and the first difference named where they are not."""

import json
import shutil
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
from short_run import make_run

from hil.figures.records import CATALOGUE
from hil.judge.tolerance import Tolerance
from hil.record.log_reader import tables
from hil.runs.recorded_run import open_run
from tools import cli
from tools.commands.compare import show
from tools.output import EXIT_BAD_INPUT, EXIT_CHECK_FAILED, EXIT_PASSED
from tools.runs.changes import flip
from tools.runs.comparison import (
    Difference,
    compare,
    first_in_blocks,
    first_in_table,
    flips_of,
    is_timing,
    largest_changes,
    position_and_speed_apart,
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compared")
    for name, seed in (("first", 1), ("again", 1), ("other", 2)):
        make_run(folder / name, seed)
    return folder


def test_one_seed_gives_one_run(runs):
    result = compare(open_run(runs / "first"), open_run(runs / "again"))
    assert result["equal"]
    assert result["first_difference"] is None
    assert result["figures"]["largest_v_m_s"]["change"] == 0.0


def test_another_seed_differs_from_the_first_noisy_sample_on(runs, capsys):
    out = runs / "both.rrd"
    command = ["compare", str(runs / "first"), str(runs / "other"), "--out", str(out), "--json"]
    assert cli.run(command) == EXIT_PASSED
    result = json.loads(capsys.readouterr().out)
    assert not result["equal"]
    first = result["first_difference"]
    assert first["t_s"] == 0.0
    assert first["signal"] in ("plant.striker_low_m_s2", "plant.striker_high_m_s2")
    assert first["a"] != first["b"]
    assert result["figures"]["largest_v_m_s"]["change"] != 0.0

    log = tables(out)
    plant_a, plant_b = log["/a/plant"], log["/b/plant"]
    assert plant_a.num_rows == plant_b.num_rows == 3000
    x_a, x_b = (open_run(runs / name).signal("plant.x_m")[1] for name in ("first", "other"))
    apart = [value for (value,) in log["/b_minus_a/x_mm"]["Scalars:scalars"].to_pylist()]
    assert apart == pytest.approx(1e3 * (np.asarray(x_b, float) - np.asarray(x_a, float)), abs=1e-9)
    assert log["/difference"]["StateChange:state"].to_pylist() == [[f"first difference: {first['signal']}"]]


def test_of_a_run_that_ends_earlier_the_ends_are_shown(runs, tmp_path, capsys):
    make_run(tmp_path / "shorter", 1, "script.duration_s=2.5")
    assert cli.run(["compare", str(runs / "first"), str(tmp_path / "shorter")]) == EXIT_PASSED
    printed = " ".join(capsys.readouterr().out.split())
    assert "first difference: a ends at 2.9" in printed
    assert "s and b at 2.4" in printed
    assert "every logged signal is equal until the earlier end" in printed


def test_a_comparison_fits_one_screen_and_begins_with_the_runs_the_verdict_and_the_fault(runs, capsys):
    assert cli.run(["compare", str(runs / "first"), str(runs / "other")]) == EXIT_PASSED
    lines = capsys.readouterr().out.splitlines()
    assert "first difference at 0.000000 s in plant.striker" in " ".join(lines)
    assert lines[:3] == [f"a: {runs / 'first'}", f"b: {runs / 'other'}", ""]
    assert [line.split()[0] for line in lines[3:6]] == ["figure", "verdict", "latched"]
    assert len(lines) <= 24


def test_the_machine_is_compared_only_if_both_runs_measured_it(runs, capsys):
    result = compare(open_run(runs / "first"), open_run(runs / "other"))
    show(result)
    assert "the machine" not in capsys.readouterr().out
    result["figures"]["tick_us.p99"] |= {"a": 10.0, "b": 20.0}
    show(result)
    assert "the machine: firmware work p99 10 and 20 µs" in capsys.readouterr().out


def test_the_largest_change_comes_first_and_what_the_machine_took_last():
    def row(a, b):
        numbers = isinstance(a, float) and isinstance(b, float)
        return {"a": a, "b": b, "change": b - a if numbers else None}

    figures = {
        "tick_us.p99": row(10.0, 90.0),
        "energy_residual": row(1e-11, 1e-10),  # of 1e-6
        "speed.error": row(1e-5, 4e-5),  # of 2e-3
        "peak_force_n": row(200.0, 201.0),
        "impact_count": row(3.0, 3.0),
        "regime": row("impact", "lost"),
        "largest_v_m_s": row(-1.0, 1.0),
    }
    wanted = ["regime", "largest_v_m_s", "speed.error", "peak_force_n", "tick_us.p99"]
    assert largest_changes(figures) == wanted
    tolerances = {"speed.error": Tolerance(1e-4, 0.0), "peak_force_n": Tolerance(0.0, 0.01)}
    assert largest_changes(figures, tolerances) == ["regime", "largest_v_m_s", "tick_us.p99"]


def verdict_run(*checks, passed=True):
    """A run of which only verdict and checks are read; a check is (name, passed, value)."""
    rows = [
        {"name": name, "limit": "≤ 1", "unit": "m", "passed": ok, "value": value}
        for name, ok, value in checks
    ]
    return SimpleNamespace(verdict={"checks": rows}, passed=passed)


def test_checks_that_only_one_run_passes_are_found_and_the_newly_failed_come_first():
    a = verdict_run(("one", False, 2.0), ("two", True, 0.9), ("three", True, 0.1), ("four", True, 0.2))
    b = verdict_run(("one", True, 0.9), ("two", False, 1.1), ("three", True, 0.2), ("four", None, None))
    found = flips_of(a, b)
    assert [(one["name"], one["a"], one["b"]) for one in found] == [
        ("two", True, False),
        ("four", True, None),
        ("one", False, True),
    ]


def test_a_changed_verdict_is_shown_in_red_above_all_figures(runs, capsys):
    result = compare(open_run(runs / "first"), open_run(runs / "other"))
    result["flips"] = flips_of(
        verdict_run(("striker_x_m", True, 0.9)), verdict_run(("striker_x_m", False, 1.1))
    )
    show(result)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:4]] == ["figure", "verdict", "latched", "striker_x_m"]
    assert lines[3].rstrip().endswith("passed → failed")
    assert flip(True, False).startswith("[bold red]")
    assert flip(False, None).startswith("[bold red]")


def test_runs_of_two_seeds_are_equal_within_a_wide_tolerance(runs):
    command = ["compare", str(runs / "first"), str(runs / "other"), "--must-be-equal"]
    assert cli.run([*command, "--tolerance", "*=1e-12"]) == EXIT_CHECK_FAILED
    assert cli.run([*command, "--tolerance", "*=1e9,1"]) == EXIT_PASSED
    assert cli.run([*command, "--tolerance", "nothing=1"]) == EXIT_BAD_INPUT


def table(t_s, **columns):
    return pa.table({"t_s": np.array(t_s, float), **columns})


def test_the_time_for_which_a_run_was_held_is_no_difference_of_the_module():
    assert all(map(is_timing, ("held_s", "own_late_s", "loops.plant.overruns")))
    assert not any(map(is_timing, ("impact_count", "latched.at_s")))


def test_how_long_a_node_was_held_before_a_fault_is_judged_in_spite_of_the_gap():
    spec = CATALOGUE["latched.firmware_held_ms"]
    assert is_timing(spec.name)
    assert spec.describes_the_bench
    assert not CATALOGUE["latched.at_s"].describes_the_bench


def test_the_earliest_difference_of_all_columns_is_named():
    a = table([0.0, 1.0, 2.0], x=[1.0, 1.0, 3.0], y=[5, 5, 5], work_us=[1.0, 2.0, 3.0])
    b = table([0.0, 1.0, 2.0], x=[1.0, 1.0, 4.0], y=[5, 6, 5], work_us=[9.0, 9.0, 9.0])
    assert first_in_table("plant", a, b) == Difference(1.0, "plant.y", 5, 6)
    assert first_in_table("plant", a, a) is None


def test_nothing_is_like_nothing():
    a = table([0.0, 1.0], force=[np.nan, np.nan])
    b = table([0.0, 1.0], force=[np.nan, 2.0])
    assert first_in_table("impacts/truth", a, a) is None
    difference = first_in_table("impacts/truth", a, b)
    assert difference is not None
    assert difference.t_s == 1.0


def test_a_skipped_tick_is_no_difference_but_an_impact_that_is_missing_is():
    whole, skipped = table([0.0, 1.0, 2.0], x=[1, 2, 3]), table([0.0, 2.0], x=[1, 3])
    assert first_in_table("plant", whole, skipped) is None
    assert first_in_table("impacts/truth", whole, skipped) == Difference(1.0, "impacts/truth.t_s", 1.0, 2.0)
    shorter = table([0.0, 1.0], x=[1, 2])
    assert first_in_table("impacts/truth", whole, shorter) == Difference(2.0, "impacts/truth.t_s", 2.0, None)
    assert first_in_table("plant", whole, shorter) == Difference(1.0, "plant.t_s", 2.0, 1.0)


@pytest.mark.parametrize("name", ["plant", "can/raw"])
@pytest.mark.parametrize("rows", [1, 3, 7, 100])
def test_blocks_of_any_length_give_the_difference_of_the_whole_tables(name, rows):
    t_s = np.arange(20.0)
    x = np.arange(20)
    whole = table(t_s, x=x)
    others = [
        whole,
        table(t_s, x=np.where(t_s == 13.0, -1, x)),
        whole.slice(0, 12),
        whole.filter(pa.array(t_s != 6.0)),
        whole.filter(pa.array((t_s < 6.0) | (t_s > 10.0))),
    ]
    for other in others:
        cut = (other.slice(first, rows) for first in range(0, other.num_rows, rows))
        fives = (whole.slice(first, 5) for first in range(0, 20, 5))
        assert first_in_blocks(name, fives, cut) == first_in_table(name, whole, other)


def test_times_that_come_twice_in_a_damaged_log_are_compared_once():
    a, b = table([0.0, 1.0, 2.0], x=[1, 2, 3]), table([0.0, 1.0, 1.0, 2.0, 2.0], x=[1, 2, 5, 4, 4])
    assert first_in_blocks("plant", [a], [b.slice(0, 2), b.slice(2)]) == Difference(2.0, "plant.x", 3, 4)


def test_frames_differ_in_hexadecimal():
    a, b = table([0.0], data=[b"\x01\x02"]), table([0.0], data=[b"\x01\x03"])
    assert first_in_table("can/raw", a, b) == Difference(0.0, "can/raw.data", "0102", "0103")


def test_a_run_without_its_frames_is_not_equal_to_one_that_has_them(runs, tmp_path):
    without = tmp_path / "without"
    shutil.copytree(runs / "first", without)
    (without / "can.log").write_bytes(b"")
    (without / "run.rrd").unlink()
    for pair in ((runs / "first", without), (without, runs / "first")):
        assert cli.run(["compare", *map(str, pair), "--must-be-equal"]) == EXIT_CHECK_FAILED


@pytest.mark.parametrize(("other", "expected"), [("again", EXIT_PASSED), ("other", EXIT_CHECK_FAILED)])
def test_equality_is_a_check_where_it_is_asked_for(runs, other, expected):
    command = ["compare", str(runs / "first"), str(runs / other)]
    assert cli.run(command) == EXIT_PASSED
    assert cli.run([*command, "--must-be-equal"]) == expected


def test_a_tick_that_a_damaged_trace_repeats_is_shown_once() -> None:
    trace = np.zeros(3, [("tick", "i8"), ("t_s", "f8"), ("x_m", "f8"), ("omega_rad_s", "f8")])
    trace["tick"] = 1, 1, 2
    run = SimpleNamespace(traces=SimpleNamespace(plant=trace))
    for _, t_s, apart in position_and_speed_apart(run, run):
        assert (len(t_s), apart.tolist()) == (2, [0.0, 0.0])
