"""What commands write is checked before they work; an unexpected exception is one line and a file."""

import ast
import json
import os
import re
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from options import options_of

from compilation import PACKAGES
from hil.scenario.files import scenario_names
from tools import cli
from tools.error_report import report
from tools.output import EXIT_BAD_INPUT, EXIT_INTERNAL_ERROR, BadInputError

ROOT = Path(cli.__file__).parents[1]
FOLDERS = {
    "run",
    "suite",
    "falsify",
    "import",
    "bring-up",
    "firmware node",
    "firmware build",
    "firmware c",
    "plant",
    "measure",
}
"""Commands whose --out is a folder; `study`'s is one, too."""
READ = {
    ("run", "--parameters"),
    ("replay", "--parameters"),
    ("export-fmu", "--parameters"),
    ("suite", "--parameters"),
    ("suite", "--baseline"),
    ("campaign", "--parameters"),
    ("campaign", "--spread"),
}
"""Options that name a file to read."""


def outputs() -> list[tuple[str, str]]:
    """Every option of the program that takes a path to write to: command, option."""
    return [
        (command, option)
        for command, option in options_of("Path")
        if option.startswith("--") and (command, option) not in READ
    ]


def is_folder(command: str, option: str) -> bool:
    return option == "--out" and (command in FOLDERS or command.startswith("study "))


FILES = [one for one in outputs() if not is_folder(*one)]
PLOTS = [one for one in FILES if one[1] in ("--plot", "--rrd", "--to")]


def refused(command: str, option: str, path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What the command says of the path; it must refuse it before any work."""
    started_s = time.process_time()
    assert cli.run([*command.split(), option, str(path)]) == EXIT_BAD_INPUT
    assert time.process_time() - started_s < 5.0
    said = " ".join(capsys.readouterr().err.split())
    assert option in said
    assert str(path)[:70] in said
    return said


def test_the_program_has_outputs_of_both_kinds() -> None:
    assert ("simulate", "--plot") in PLOTS
    assert len(FILES) > 15
    assert len(outputs()) - len(FILES) > 8


@pytest.mark.parametrize(("command", "option"), PLOTS)
def test_a_format_that_nobody_writes_is_refused(
    command: str, option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "ending in" in refused(command, option, tmp_path / "x.xyz", capsys)


ENDINGS = {"--page": ".md", "--rrd": ".rrd", "--plot": ".svg", "--to": ".csv"}


def file_name(command: str, option: str) -> str:
    its_own = {"compare --out": ".rrd", "export-fmu --out": ".fmu"}
    return "x" + its_own.get(f"{command} {option}", ENDINGS.get(option, ".toml"))


FOLDER_PLACES = {
    "below a file": ("precious/{}", "file"),
    "where nobody may make a file": ("/proc/1/{}", "cannot be written"),
    "of a long name": ("x" * 300 + "{}", "File name too long"),
    "back out of a missing folder": ("missing/../{}", r"with `\.\.`"),
    "in a thousand folders": ("x/" * 1000 + "{}", "or more than 100"),
}
"""Places where nothing can be written, and what is said of each."""
FILE_PLACES = FOLDER_PLACES | {
    "below a file": ("precious/{}", "is a file"),
    "in a missing folder": ("missing/{}", "mkdir -p"),
    "back out of a missing folder": ("missing/../{}", "mkdir -p"),
    "in a thousand folders": ("x/" * 1000 + "{}", "mkdir -p"),
    "where a folder is": ("folder/{}", "a folder|there already"),
    "where a link is": ("link/{}", "is a link|there already"),
}
WRONG = [
    *((*one, place) for one in FILES for place in FILE_PLACES),
    *((*one, place) for one in outputs() if one not in FILES for place in FOLDER_PLACES),
]


@pytest.mark.parametrize(("command", "option", "place"), WRONG)
def test_a_place_where_nothing_can_be_written_is_refused(
    command: str, option: str, place: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing is made there, and the target of a link stays."""
    name = "x" if is_folder(command, option) else file_name(command, option)
    (tmp_path / "precious").write_text("precious")
    (tmp_path / "folder" / name).mkdir(parents=True)
    (tmp_path / "link").mkdir()
    (tmp_path / "link" / name).symlink_to(tmp_path / "precious")
    before = sorted(tmp_path.rglob("*"))
    where, wanted = (FOLDER_PLACES if is_folder(command, option) else FILE_PLACES)[place]
    assert re.search(wanted, refused(command, option, tmp_path / where.format(name), capsys))
    assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / "precious").read_text() == "precious"


def test_a_comparison_goes_over_no_log_that_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.rrd"
    path.write_text("mine")
    assert "there already" in refused("compare", "--out", path, capsys)
    assert path.read_text() == "mine"


def test_an_unexpected_exception_is_one_line_and_a_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("planted")

    monkeypatch.setattr("plant_sim.simulation.simulate", broken)
    assert cli.run(["simulate", "table1-viscous"]) == EXIT_INTERNAL_ERROR
    said = capsys.readouterr().err
    (written,) = tmp_path.iterdir()
    assert said.count("\n") == 1
    assert str(written) in said
    assert "ZeroDivisionError: planted" in said
    assert "Traceback" not in said
    assert "in broken" in written.read_text()


def test_a_table_in_a_pipe_keeps_a_row_to_a_line() -> None:
    environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    command = [sys.executable, "-m", "tools.cli", "list"]
    listed = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
    assert {line.split()[0] for line in listed.splitlines() if line[0] != " "} >= set(scenario_names())
    assert not [line for line in listed.splitlines() if line.startswith(" ")], "nothing is folded"


def named_errors() -> list[str]:
    """The project's own kinds of errors that end a command."""
    return [
        f"{'.'.join(path.relative_to(ROOT).with_suffix('').parts)}.{node.name}"
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.ClassDef) and "RefusalError" in {ast.unparse(base) for base in node.bases}
    ]


@pytest.mark.parametrize("name", sorted(named_errors()))
def test_an_error_by_the_input_is_no_defect(name: str, capsys) -> None:
    module, _, kind = name.rpartition(".")
    error = getattr(import_module(module), kind)("the input is wrong")
    assert report(error, as_json=False) == EXIT_BAD_INPUT
    assert capsys.readouterr().err == "error: the input is wrong\n"


@pytest.mark.parametrize("missing", ["nothing", "plant_sim.kernels"])
def test_a_defect_that_breaks_imports_is_one_line_too(missing: str, monkeypatch, capsys) -> None:
    def defective(*_: str) -> None:
        raise RuntimeError("broken")

    monkeypatch.setattr("tools.program.program", defective)
    monkeypatch.setitem(sys.modules, missing, None)
    assert cli.run(["list", "--json"]) == EXIT_INTERNAL_ERROR
    assert "RuntimeError: broken" in json.loads(capsys.readouterr().out)["error"]


def test_a_current_folder_that_was_removed_is_refused(tmp_path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    code = f"import os; from tools.cli import run; os.rmdir({str(gone)!r}); os._exit(run(['list', '--json']))"
    done = subprocess.run([sys.executable, "-c", code], cwd=gone, capture_output=True, text=True, check=False)
    assert done.returncode == EXIT_BAD_INPUT
    assert "the current folder was removed" in json.loads(done.stdout)["error"]


@pytest.mark.parametrize("command", [["run", "e-stop-in-the-hold", "--clock", "lockstep"], ["suite"]])
def test_a_bus_that_is_not_used_is_named(command: list[str], monkeypatch, capsys) -> None:
    def ended(*_: Any, **__: Any) -> None:
        raise BadInputError("enough")

    monkeypatch.setattr("hil.runs.bench.run_scenario", ended)
    monkeypatch.setattr("hil.suite.suite.run_suite", ended)
    for bus, notes in (("auto", 0), ("vcan", 1)):
        assert cli.run([*command, "--bus", bus]) == EXIT_BAD_INPUT
        assert (
            capsys.readouterr().err.count(f"--bus {bus} is not used: lockstep has a bus of its own") == notes
        )
