"""The mutation tool on a module of a few lines."""

import ast
import importlib
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tools.dev import mutation

SOURCE = '''
from enum import IntEnum

HERE = __file__

class Mode(IntEnum):
    """Two of them."""

    OFF = 0
    ON = 1

def mode(x: float, well: bool = True) -> Mode:
    """ON from 2 up."""
    return Mode.ON if x >= 2.0 and well else Mode.OFF
'''


def test_every_change_is_made_once_and_the_rest_stays() -> None:
    made = [(m.before, m.after) for m in mutation.mutants(SOURCE, {"Mode": ["OFF", "ON"]})]
    assert ("x >= 2.0", "x > 2.0") in made
    assert ("x >= 2.0", "x < 2.0") in made
    assert ("x >= 2.0 and well", "x >= 2.0 or well") in made
    assert ("2.0", "3.0") in made
    assert ("True", "False") in made
    assert ("Mode.ON", "Mode.OFF") in made
    assert len(made) == len(set(made))
    assert not any("float" in before for before, _ in made)


@pytest.fixture
def tests_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[float], str]]:
    """What writes tests of SOURCE that look at one x only, where a module is to be ON; their path."""
    package = tmp_path / "small_package"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "module.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)

    def write(x: float) -> str:
        tests = tmp_path / "test_small_module.py"
        tests.write_text(
            textwrap.dedent(f"""
                from small_package import module
                def test_it():
                    assert module.mode({x}) == module.Mode.ON
            """)
        )
        return str(tests)

    yield write
    for name in ("small_package", "small_package.module"):
        sys.modules.pop(name, None)


def test_the_projects_own_tests_pass_with_its_own_options() -> None:
    root = Path(__file__).parents[3]
    code = ast.parse((root / "firmware_py/core/numbers.py").read_text())
    assert mutation.passes(
        "firmware_py.core.numbers", code, [str(root / "tests/firmware_py/node/test_numbers.py")]
    )


def test_every_mutant_is_code_and_a_change_that_is_none_is_an_error_and_no_kill(
    tests_of: Callable[[float], str],
) -> None:
    tests = tests_of(2.0)
    for made in mutation.mutants(SOURCE, {"Mode": ["OFF", "ON"]}):
        compile(made.code, "module", "exec")
    (member,) = (m for m in mutation.mutants(SOURCE, {"Mode": ["OFF", "ON"]}) if m.after == "Mode.ON")
    assert mutation.passes("small_package.module", member.code, [tests])
    no_code = ast.Module(
        [ast.Expr(ast.Name("x", ast.Store(), lineno=1, col_offset=0), lineno=1, col_offset=0)], []
    )
    with pytest.raises(ValueError, match="Load"):
        mutation.passes("small_package.module", no_code, [tests])


@pytest.mark.parametrize(("x", "survives"), [(2.0, False), (5.0, True)])
def test_a_mutant_survives_tests_that_do_not_look_at_it(
    x: float, survives: bool, tests_of: Callable[[float], str]
) -> None:
    """Tests that look at x = 5 only do not see a moved edge."""
    tests = tests_of(x)
    importlib.import_module("small_package.module")  # as the tool itself does, to know the enumerations
    moved = next(m for m in mutation.mutants(SOURCE, {}) if m.after == "x > 2.0")
    assert mutation.passes("small_package.module", moved.code, [tests]) == survives


def test_survivors_are_counted(
    tests_of: Callable[[float], str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = [one for one in mutation.mutants(SOURCE, {}) if one.after in ("x > 2.0", "x >= 2.0 or well")]
    monkeypatch.setattr(mutation, "mutants", lambda *_: made)
    assert mutation.main("small_package.module", [tests_of(2.0)]) == 1
    out = capsys.readouterr().out
    assert "x >= 2.0 and well  →  x >= 2.0 or well" in out
    assert "x >= 2.0  →  x > 2.0" not in out


@pytest.mark.parametrize("mistake", ["fails", "missing"])
def test_tests_that_do_not_pass_on_the_code_as_it_is_kill_nothing(
    mistake: str, tests_of: Callable[[float], str], capsys: pytest.CaptureFixture[str]
) -> None:
    tests = tests_of(1.0)
    assert mutation.main("small_package.module", [tests + ("x" if mistake == "missing" else "")]) == 4
    out, err = capsys.readouterr()
    assert not out
    assert "does not pass" in err
