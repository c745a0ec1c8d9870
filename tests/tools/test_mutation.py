"""The mutation tool on a module of a few lines."""

import importlib
import textwrap
from pathlib import Path

import pytest

from tools import mutation

SOURCE = '''
from enum import IntEnum

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


@pytest.mark.parametrize(("edge", "survivors"), [(2.0, 0), (5.0, 1)])
def test_a_mutant_survives_what_does_not_look_at_it(
    edge: float, survivors: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tests that look at x = 5 only do not see a moved edge."""
    package = tmp_path / "small_package"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "module.py").write_text(SOURCE)
    tests = tmp_path / "test_small_module.py"
    tests.write_text(
        textwrap.dedent(f"""
            from small_package import module
            def test_it():
                assert module.mode({edge}) == module.Mode.ON
        """)
    )
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module("small_package.module")  # as the tool itself does, to know the enumerations
    moved = next(m for m in mutation.mutants(SOURCE, {}) if m.after == "x > 2.0")
    assert mutation.survives("small_package.module", moved, [str(tests)]) == bool(survivors)
