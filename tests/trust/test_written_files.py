"""Every file that a command writes is made anew: a link in its place is replaced, its target left alone."""

import ast
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow as pa
import pytest
from matplotlib.figure import Figure

from compilation import kernel_cache
from hil.record import run_folder
from tools import cli, plots
from tools.commands.campaign import keep_trial
from tools.commands.places import PICTURES, RECORDINGS, TABLES
from tools.output import BadInputError
from tools.program import program
from tools.runs import inspection

ROOT = Path(kernel_cache.__file__).parents[1]
PACKAGES = ("firmware_py", "plant_sim", "hil", "tools")
OWN_PLACES = {
    "hil/record/new_file.py": "the one place",
    "hil/bus/log/can_log.py": "in a claimed run folder, as the next two",
    "hil/processes/child.py": "",
    "hil/record/traces/trace.py": "",
    "hil/kernel/user_mode_linux.py": "in a new temporary folder, as the next four",
    "tools/fmu/build.py": "",
    "tools/fmu/machine_code.py": "",
    "firmware_py/builds/board.py": "",
    "firmware_py/builds/c_compiler.py": "",
    "hil/processes/own_network.py": "the kernel's files",
    "firmware_py/interface/generate.py": "a developer's command, as all in tools/dev",
    "tools/error_report.py": "by a descriptor of mkstemp",
    "tools/commands/new.py": "a new file, which no link is",
    "tools/commands/places.py": "a trial that writes nothing, of a file that is no link",
}
WRITERS = ("write_text", "write_bytes", "touch", "savefig", "write_feather")
OPENED = ("open", "fdopen", "ZipFile")


def ways_to_write(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield the lines that open a file by its path to write it."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        modes = [
            one.value
            for one in (*node.args, *(word.value for word in node.keywords))
            if isinstance(one, ast.Constant)
        ]
        mode = next((one for one in modes if isinstance(one, str) and one and set(one) <= set("rwaxbt+")), "")
        is_path = not any(isinstance(one, ast.Name) and one.id in ("file", "opened") for one in node.args)
        if is_path and (name in WRITERS or (name in OPENED and set(mode) & set("wax+"))):
            yield node.lineno, name


def test_no_other_place_opens_a_file_to_write() -> None:
    found = {}
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        name = str(path.relative_to(ROOT))
        ways = list(ways_to_write(ast.parse(path.read_bytes())))
        if ways and name not in OWN_PLACES and not name.startswith("tools/dev/"):
            found[name] = ways
    assert found == {}, "use hil.record.new_file"


def options(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, Any, Any]]:
    """Yield name, command and option of all options of all commands that take a path."""
    for name, one in getattr(command, "commands", {}).items():
        yield from options(one, (*path, name))
    for option in command.params:
        kind = getattr(option, "type_descriptor", None)
        if option.param_type_name == "option" and kind and "Path" in str(kind.annotation):
            yield f"{' '.join(path)} {option.opts[0]}", command, option


READ = ("--parameters", "--spread", "--turns")
"""Options for files that a command reads, and a socket."""


def test_every_option_for_a_file_to_write_refuses_a_link(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious\n")
    refused, accepted = set(), set()
    for name, command, option in options(program()):
        for ending in (*PICTURES, *RECORDINGS, *TABLES, ".toml", ".fmu", ".md", ""):
            link = tmp_path / f"link{ending}"
            if not link.is_symlink():
                link.symlink_to(victim)
            try:
                value = [str(link)] if option.multiple else str(link)
                option.process_value(command.context_class(command), value)
                accepted.add(name)
            except BadInputError:
                refused.add(name)
    assert {name for name in accepted if name.split()[-1] not in READ} == set()
    assert len(refused) >= 20
    assert victim.read_text() == "precious\n"


SOME = pa.table({"a": [1.0, 2.0], "b": ["x", "y"]})
SCENARIO = SimpleNamespace(name="trial", document={"title": "a trial"})
FUNCTIONS: dict[str, Callable[[Path], Any]] = {
    "--to t.csv": lambda path: inspection.write_table(SOME, path.with_suffix(".csv")),
    "--to t.arrow": lambda path: inspection.write_table(SOME, path.with_suffix(".arrow")),
    "--to t.parquet": lambda path: inspection.write_table(SOME, path.with_suffix(".parquet")),
    "--plot t.svg": lambda path: plots.save(Figure(), path.with_suffix(".svg"), 50),
    "--plot t.png": lambda path: plots.save(Figure(), path.with_suffix(".png"), 50),
    "campaign --keep": lambda path: keep_trial(path.parent, SimpleNamespace(scenario=SCENARIO)),
    "firmware build": lambda path: cli.run(
        ["firmware", "build", "--target", "host", "--out", str(path.parent)]
    ),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_link_that_comes_after_the_check_is_replaced(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    victim, place = tmp_path / "victim", tmp_path / "out" / "t"
    victim.write_text("precious\n")
    place.parent.mkdir()
    for _ in range(2):  # the second time with links in all the places that were written
        FUNCTIONS[name](place)
        written = [one for one in tmp_path.rglob("*") if one.is_file() and one != victim]
        assert written
        assert not [one for one in written if one.is_symlink()]
        for one in written:
            one.unlink()
            one.symlink_to(victim)
    assert victim.read_text() == "precious\n"


def test_a_run_folder_is_written_by_its_user_alone_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        with run_folder.claimed("x", tmp_path / "above" / "run") as folder:
            run_folder.note(folder, a=1)
            (folder / "can.log").write_text("")
        assert os.umask(0) == 0
    finally:
        os.umask(before)
    modes = {path.name: path.stat().st_mode & 0o777 for path in (folder, folder.parent, *folder.iterdir())}
    assert modes == {"run": 0o755, "above": 0o755, "run.json": 0o644, "can.log": 0o644}
