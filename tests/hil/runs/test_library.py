"""The bench from Python, and as a pytest plug-in."""

import re
import shutil
import tomllib

import numpy as np
import pytest

import hil
from compilation.kernel_cache import root
from hil.record.rrd.unpacked_size import CHUNK, HEAD_BYTES, MESSAGE
from hil.record.run_traces import read_json
from hil.runs.recorded_run import RunError, open_run
from hil.scenario.files import ScenarioError
from hil.scenario.settings import SettingError

pytest_plugins = ["pytester"]

KERNELS = root()
"""A session of pytester has a home of its own, in which all kernels would be compiled anew."""

SCENARIO = """
title = "The module stands still for half a second"
scene = "table1-motor-soft"

[script]
duration_s = 0.5

[[checks]]
name = "impact_count"
high = 0
"""


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenario") / "still.toml"
    path.write_text(SCENARIO)
    return path


@pytest.fixture(scope="module")
def run(scenario):
    return hil.run(scenario, set={"script.duration_s": 1.0}, out=scenario.parent / "run")


def test_a_run_is_an_object_with_verdict_signals_and_impacts(run):
    assert run.passed
    assert run.verdict["scenario"] == "still"
    assert run.impacts == ()
    t_s, x_m = run.signal("plant.x_m")
    assert len(t_s) == run.figures.ticks == 1000
    np.testing.assert_allclose(np.diff(t_s), 1e-3)
    assert np.all(x_m < 0.18)
    assert run.table("firmware").num_rows == 1000
    assert read_json(run.folder / "run.json")["firmware"] == "compiled"


def test_a_run_whose_checks_fail_is_returned_and_says_so(scenario, tmp_path):
    failing = tmp_path / "failing.toml"
    failing.write_text(SCENARIO.replace("high = 0", "low = 1"))
    run = hil.run(failing, out=tmp_path / "run")
    assert not run.passed
    assert [check["passed"] for check in run.verdict["checks"]] == [False]


def test_what_cannot_run_raises_a_sentence():
    with pytest.raises(SettingError, match=r"starts with 'plant'; wanted one of (\w+\., ){4}\w+\.$"):
        hil.run("soft-start-multistable", set={"plant.mass_kg": 1.0})
    with pytest.raises(ScenarioError, match="no named scenario"):
        hil.run("soft-strat")
    with pytest.raises(AttributeError, match="walk"):
        _ = hil.walk


@pytest.mark.parametrize(
    ("argument", "wanted"),
    [
        ({"clock": "lock-step"}, "clock = 'lock-step': wanted real or lockstep"),
        ({"firmware": "c"}, "firmware = 'c': wanted python, compiled, host-single, cortex-m7 or cortex-m4f"),
        ({"seed": -1}, "seed = -1: wanted a whole number of at least 0"),
        ({"seed": 1.5}, "seed = 1.5: wanted a whole number of at least 0"),
        ({"seed": "a"}, "seed = 'a': wanted a whole number of at least 0"),
        ({"seed": float("nan")}, "seed = nan: wanted a whole number of at least 0"),
        ({"parameters": None}, "parameters = None: wanted a text or a path"),
        ({"parameters": [5]}, "parameters = 5: wanted a text or a path"),
    ],
)
def test_an_unusable_argument_is_named_before_a_folder_is_made(scenario, tmp_path, argument, wanted):
    with pytest.raises(ScenarioError) as refused:
        hil.run(scenario, out=tmp_path / "run", **argument)
    assert str(refused.value) == wanted
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("settings", [None, 5, b"a.b=1", [5], {5: 1}, [("script.duration_s", 1.0)]])
def test_settings_of_another_type_are_refused(scenario, settings):
    with pytest.raises(SettingError, match=r"^set "):
        hil.run(scenario, set=settings)


@pytest.mark.parametrize("argument", [None, 5, b"mine", {"title": "mine"}])
def test_a_scenario_that_is_no_text_or_path_is_refused(argument):
    with pytest.raises(ScenarioError, match=r"^scenario = .*: wanted a text or a path$"):
        hil.run(argument)


def test_one_setting_or_file_needs_no_list(scenario, tmp_path):
    file = tmp_path / "calmer.toml"
    file.write_text('format = 1\n[parameters]\n"start.rise_s" = { value = 6.0, unit = "s" }\n')
    run = hil.run(scenario, set="script.duration_s=0.2", parameters=str(file), out=tmp_path / "run")
    assert run.figures.duration_s == pytest.approx(0.2)
    assert tomllib.loads((run.folder / "scenario.toml").read_text())["firmware"]["start"]["rise_s"] == 6.0


def test_a_run_has_by_default_the_seed_of_its_scenario(tmp_path):
    """A trial that a campaign keeps is repeated by its seed."""
    (tmp_path / "seeded.toml").write_text(f"seed = 7\n{SCENARIO}")
    seeds = [
        read_json(hil.run(tmp_path / "seeded.toml", out=tmp_path / name, **given).folder / "run.json")["seed"]
        for name, given in (("own", {}), ("other", {"seed": np.int64(8)}))
    ]
    assert seeds == [7, 8]


def start_of_last_chunk(log):
    """Where a log's last chunk begins; what follows the chunks may be most of the file."""
    place, starts = HEAD_BYTES, []
    while place < len(log):
        kind, length = MESSAGE.unpack_from(log, place)
        if kind == CHUNK:
            starts.append(place)
        place += MESSAGE.size + length
    return starts[-1]


def test_a_log_that_lost_ticks_since_its_verdict_says_so_and_not_that_the_run_was_cut(run, tmp_path):
    damaged = shutil.copytree(run.folder, tmp_path / "run")
    content = (run.folder / "run.rrd").read_bytes()
    (damaged / "run.rrd").write_bytes(content[: start_of_last_chunk(content)])
    (damaged / "plant.trace").unlink()  # from complete traces it is made again
    for _ in range(2):  # the log was repaired at the first reading
        (reason,) = open_run(damaged).verdict["reasons"]
        assert re.search(r"run\.rrd is damaged, with \d+ of the 1000 ticks", reason)


@pytest.mark.parametrize("content", [b"", b"RRF2"])
def test_an_unreadable_log_without_traces_is_left_as_it_is(run, tmp_path, content):
    damaged = shutil.copytree(run.folder, tmp_path / "run")
    for trace in damaged.glob("*.trace"):
        trace.unlink()
    (damaged / "run.rrd").write_bytes(content)
    with pytest.raises(RunError, match=r"run\.rrd is damaged, and no traces .*`vibrohil run .* --seed 1 "):
        open_run(damaged)
    assert (damaged / "run.rrd").read_bytes() == content


TESTS = """
import os
from pathlib import Path

import pytest

HOME = Path.cwd()

def test_that_passes(bench):
    run = bench.run("still.toml")
    assert run.passed
    assert run.verdict["provenance"]["seed"] == 7


def test_that_fails(bench):
    run = bench.run("still.toml", set={"script.duration_s": 0.21})
    assert run.impacts, "no impact"


def test_in_which_nothing_is_asserted(bench):
    bench.run("unchecked.toml", set={"script.duration_s": 0.22})


def test_that_passes_elsewhere(bench, monkeypatch):
    bench.run(HOME / "still.toml", set={"script.duration_s": 0.25})
    (HOME / "elsewhere").mkdir()
    (HOME / "elsewhere" / "runs").symlink_to(HOME / "runs")
    monkeypatch.chdir(HOME / "elsewhere")


@pytest.fixture
def fails_in_set_up(bench):
    bench.run(HOME / "still.toml", set={"script.duration_s": 0.23})
    raise ValueError("set-up")


@pytest.fixture
def fails_in_teardown(bench):
    yield
    raise ValueError("teardown")


def test_whose_set_up_fails(fails_in_set_up):
    pass


def test_whose_teardown_fails(fails_in_teardown, bench):
    bench.run(HOME / "still.toml", set={"script.duration_s": 0.24})


def test_that_writes_into_its_folder(bench):
    run = bench.run(HOME / "still.toml", set={"script.duration_s": 0.26})
    (run.folder / "own.txt").write_text("mine")
"""


def test_the_plug_in_keeps_and_names_the_runs_of_tests_that_fail_and_removes_no_others(pytester, monkeypatch):
    """A test whose run is not judged fails, too.

    Also where a test changes directory, and where set-up or teardown fails; never a user's own file.
    """
    monkeypatch.setenv("VIBROHIL_CACHE_DIR", str(KERNELS))
    (pytester.path / "still.toml").write_text(f"seed = 7\n{SCENARIO}")
    (pytester.path / "unchecked.toml").write_text(SCENARIO.partition("[[checks]]")[0])
    pytester.makepyfile(TESTS)
    result = pytester.runpytest_inprocess("-p", "no:cacheprovider")
    result.assert_outcomes(passed=4, failed=2, errors=2)
    kept = {}
    for folder in (pytester.path / "runs").iterdir():
        own = (folder / "own.txt").exists()
        assert not (own and (folder / "run.rrd").exists())
        kept["own" if own else hil.open_run(folder).figures.duration_s] = folder
    assert set(kept) == {0.21, 0.22, 0.23, 0.24, "own"}
    for name in (0.21, 0.22, 0.23, 0.24):
        result.stdout.fnmatch_lines(["*run folders kept*", str(kept[name])])
        assert kept[name].is_absolute()
    result.stdout.fnmatch_lines(
        ["*is not judged: nothing was checked; give the scenario*", f"*{kept[0.22].name}*"]
    )


def test_a_refused_input_is_shown_at_the_line_of_the_test(pytester):
    pytester.makepyfile("""
        def test_of_a_file_that_is_missing(bench):
            bench.run("missing.toml")
    """)
    result = pytester.runpytest_inprocess("-p", "no:cacheprovider")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        ['>*bench.run("missing.toml")', "E*scenario file 'missing.toml' cannot be read*"]
    )
    assert "pytest_plugin.py" not in result.stdout.str()


def test_clock_bus_and_build_of_the_session_are_those_of_its_runs(pytester):
    pytester.makepyfile(
        """
        def test_options(bench):
            assert (bench.clock, bench.time) == ("real", "strict")
            assert (bench.bus, bench.firmware) == ("local", "python")
        """
    )
    clock = ("--vibrohil-clock", "real", "--vibrohil-time", "strict", "--vibrohil-bus", "local")
    options = (*clock, "--vibrohil-firmware", "python")
    result = pytester.runpytest_inprocess("-p", "no:cacheprovider", *options)
    result.assert_outcomes(passed=1)
