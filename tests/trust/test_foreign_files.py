"""Files of somebody else: each line of the page on trust is held here, with a corpus of hostile ones."""

import ast
import io
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import rerun as rr
from hostile import FOLDERS, SCENARIO, SCENARIOS, expressions
from hostile_logs import HOSTILE
from pydantic import ValidationError

import hil
from compilation import kernel_cache
from hil.record.rrd.log_file import written_whole
from hil.record.run_folder import write_json
from hil.scenario.checks import Check
from tools import cli, output

ROOT = Path(kernel_cache.__file__).parents[1]
PACKAGES = ("firmware_py", "plant_sim", "hil", "tools")
LIMIT_S = 20.0
LIMIT_BYTES = 1 << 30


def test_no_hostile_expression_is_evaluated_or_writes_anything(tmp_path: Path) -> None:
    texts = expressions(tmp_path / "victim")
    assert len(set(texts)) >= 200
    passed = []
    for text in texts:
        begun_s = time.process_time()
        try:
            Check(name="mine", expression=text, high=1.0)
            passed.append(text)
        except ValidationError as error:
            said = str(error)
            refusals = "cannot be worked out", "is a signal", "names no signal"
            assert any(refusal in said for refusal in refusals), said
        assert time.process_time() - begun_s < LIMIT_S
    allowed = set("0123456789e+-*/%.()_ \nxabdf#\x07\x1b];title")
    assert [text for text in passed if not set(text) <= allowed and "sqrt" not in text] == []
    assert list(tmp_path.iterdir()) == []


def make_run_folders(cases: Path, victim: Path) -> None:
    """A run's folder, spoiled in each way."""
    (cases.parent / "still.toml").write_text(SCENARIO)
    run_dir = cases.parent / "run"
    hil.run(cases.parent / "still.toml", out=run_dir)
    for name, spoil in FOLDERS.items():
        case = shutil.copytree(run_dir, cases / re.sub(r"[^\w.]+", "-", name))
        spoil(case, victim)


def make_logs(cases: Path, _victim: Path) -> None:
    for name, write in HOSTILE.items():
        case = cases / re.sub(r"\W+", "-", name)
        case.mkdir()
        written = write(case)
        written.rename(case / f"log{''.join(written.suffixes)}")


def make_scenarios(cases: Path, victim: Path) -> None:
    for name, write in SCENARIOS.items():
        case = cases / re.sub(r"\W+", "-", name)
        case.mkdir()
        write(case, victim)


@pytest.mark.parametrize(
    ("make", "count"),
    [(make_run_folders, len(FOLDERS)), (make_logs, len(HOSTILE)), (make_scenarios, len(SCENARIOS))],
)
def test_hostile_run_folders_and_logs_change_nothing_elsewhere_and_end_with_a_sentence(
    make: Callable[[Path, Path], None], count: int, tmp_path: Path
) -> None:
    victim, cases = tmp_path / "victim", tmp_path / "cases"
    victim.write_text("precious\n")
    cases.mkdir()
    make(cases, victim)
    (tmp_path / "cache").mkdir()
    environment = os.environ | {
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "VIBROHIL_CACHE_DIR": str(kernel_cache.root()),
        "PYTHONDONTWRITEBYTECODE": "1",  # Python's own files beside the modules of the tests are no harm
    }
    done = subprocess.run(
        [sys.executable, "-P", Path(__file__).with_name("watched.py"), cases, kernel_cache.root()],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-500:] + done.stderr
    lines = [line.split("\t", 2) for line in done.stdout.splitlines()]
    # A run folder is read by several forms of a command, so their numbers distinguish their reports.
    reported = {(case, nth, command): json.loads(line) for nth, (case, command, line) in enumerate(lines)}
    assert len({case for case, _, _ in reported}) == count >= 30
    for (case, _, command), one in reported.items():
        if command == "import":
            assert one["status"] in (0, 4, 5), (case, one)
            is_read = one["status"] != 4  # 5: it is read and not judged
            assert is_read or one["error"].strip().startswith("error: "), (case, one)
            assert [name for name in one["left"] if not name.startswith("log.")] == ["run"] * is_read
    assert {case: one["harm"] for case, one in reported.items() if one["harm"]} == {}
    assert {case: one for case, one in reported.items() if one["status"] not in (0, 1, 4, 5)} == {}
    assert {case: one["error"] for case, one in reported.items() if "Traceback" in one["error"]} == {}
    assert {case: one["took_s"] for case, one in reported.items() if one["took_s"] > LIMIT_S} == {}
    large = {case: one["most_bytes"] for case, one in reported.items() if one["most_bytes"] >= LIMIT_BYTES}
    assert large == {}
    assert not victim.with_name("made").exists()
    assert victim.read_text() == "precious\n"


def test_files_are_made_anew_and_never_written_through_a_link(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious\n")
    (tmp_path / "run.rrd.new").symlink_to(victim)
    with written_whole(tmp_path / "run.rrd") as unfinished:
        assert not unfinished.is_symlink()
        recording = rr.RecordingStream("vibrohil")
        recording.save(unfinished)
        recording.disconnect()
    (tmp_path / "run.json.new").symlink_to(victim)
    write_json(tmp_path / "run.json", {"a": 1})
    assert victim.read_text() == "precious\n"
    assert json.loads((tmp_path / "run.json").read_text()) == {"a": 1}


def test_every_python_that_is_started_leaves_out_the_working_folder() -> None:
    unsafe, safe = [], 0
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.List) and len(node.elts) > 1:
                first, second = map(ast.unparse, node.elts[:2])
                if first == "sys.executable" and second == "'-P'":
                    safe += 1
                elif first in ("sys.executable", "python") and second != "'-I'":
                    unsafe.append(f"{path}:{node.lineno}")
    assert unsafe == []
    assert safe >= 8


def relative_entries() -> list[str]:
    """The entries of Python's path that stand for a place in the working folder."""
    command = [sys.executable, "-P", "-c", "import sys; print(*sys.path, sep='\\n')"]
    entries = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\n")
    return [entry for entry in entries if entry and not os.path.isabs(entry)]


ABSENT = {"polars", "sympy", "backports", "cython", "bottleneck"}
"""Modules that our libraries use where they are installed, and try to import."""


def test_no_entry_of_pythons_path_is_a_place_in_the_working_folder() -> None:
    assert relative_entries() == [], "install again: make setup"


def test_settings_of_numba_in_the_working_folder_are_refused(tmp_path: Path) -> None:
    (tmp_path / ".numba_config.yaml").write_text("disable_jit: 1\n")
    program = Path(sys.executable).with_name("vibrohil")
    done = subprocess.run([program, "list"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 4
    assert done.stderr.startswith("error: the current folder holds .numba_config.yaml")


def test_settings_of_matplotlib_in_the_working_folder_are_not_read(tmp_path: Path) -> None:
    program = Path(sys.executable).with_name("vibrohil")
    command = [program, "simulate", "table1-viscous", "--until", "1", "--plot", "plot.svg"]
    folders = plain, settings, pipe = [tmp_path / name for name in ("plain", "settings", "pipe")]
    for folder in folders:
        folder.mkdir()
    (settings / "matplotlibrc").write_text("font.size: 40\nsvg.fonttype: none\nbackend: module://evil\n")
    os.mkfifo(pipe / "matplotlibrc")
    for folder in folders:
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=120)
        assert done.returncode == 0, done.stderr
        assert "matplotlib" not in done.stderr
        assert (folder / "plot.svg").read_bytes() == (plain / "plot.svg").read_bytes()


@pytest.mark.realtime
def test_modules_in_the_working_folder_are_not_imported_by_any_process(tmp_path: Path) -> None:
    taken = tmp_path / "taken"
    own = {"hil", "tools", "plant_sim", "compilation", "text_input"}
    names = sys.stdlib_module_names | own | {"numpy"}
    for folder in (tmp_path, *(tmp_path / entry for entry in relative_entries())):
        folder.mkdir(exist_ok=True)
        for name in sorted(names | ABSENT):
            (folder / f"{name}.py").write_text(f"open({str(taken)!r}, 'a').write('{name} ')\n")
    subprocess.run([sys.executable, "-c", "import selectors"], cwd=tmp_path, check=False)
    assert taken.exists(), "a Python without -P imports them"
    taken.unlink()
    for name in ("still.toml", "again.toml"):
        (tmp_path / name).write_text(SCENARIO)
    program = Path(sys.executable).with_name("vibrohil")
    for command in (
        ["run", "still.toml", "--clock", "real", "--bus", "local", "--firmware", "python", "--out", "one"],
        ["suite", "still.toml", "again.toml", "--jobs", "2", "--out", "suite"],
    ):
        done = subprocess.run([program, *command], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert not taken.exists(), taken.read_text()
        assert done.returncode in (0, 1, 5), done.stdout + done.stderr  # verdicts of a busy machine too


def test_control_characters_of_foreign_texts_do_not_reach_the_terminal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stream = io.StringIO()
    console = output.console_on(None)
    console.file = stream
    console.print("a\x1b]0;title\x07b\x9b2J\u202ec\x7f\td", markup=False)
    console.print(output.figure_table("t\x1b[2J", [("name\x1b[1m", "value\r", "unit\x00")]))
    assert "a]0;titleb2Jc" in stream.getvalue()
    assert not output.CONTROL.search(stream.getvalue())


@pytest.mark.parametrize(
    "text",
    [
        "title = 't'\nscene = '{long}'\n[script]\nduration_s = 0.1\n",
        "title = 't'\nscene = 'table1-motor-soft'\n[script]\nduration_s = 0.1\n{long} = 1\n",
        "title = 't'\nscene = 'table1-motor-soft'\n[firmware]\n{long} = 1\n[script]\nduration_s = 0.1\n",
    ],
)
def test_long_words_of_foreign_files_are_shortened_in_errors(
    tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.toml").write_text(text.format(long=400_000 * "k"))
    assert cli.run(["run", str(tmp_path / "mine.toml"), "--out", str(tmp_path / "run")]) == 4
    errors = capsys.readouterr().err
    assert 60 * "k" in errors
    assert 80 * "k" not in errors
