"""Kernels are cached by the state of the sources, and are made for the types of a scene's parts."""

import doctest
import errno
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba.core import config

from plant_sim import kernels, linking
from plant_sim.parts import restitution
from plant_sim.result import Phase


def test_examples() -> None:
    assert doctest.testmod(kernels).failed == 0
    assert doctest.testmod(restitution).failed == 0


def test_another_packages_cache_folder_is_left_alone() -> None:
    before = config.CACHE_DIR
    kernels.jit(lambda x: x)
    assert before == config.CACHE_DIR


def test_a_subroutine_that_returns_an_array_is_refused_but_one_that_makes_it_may() -> None:
    def made(numbers):  # type: ignore[no-untyped-def]
        return np.zeros(numbers.size)

    def handed_on(numbers):  # type: ignore[no-untyped-def]
        return numbers

    make, hand_on = kernels.allocating(made), kernels.subroutine(handed_on)
    assert list(kernels.jit(lambda numbers: 2.0 * make(numbers))(np.ones(2))) == [0.0, 0.0]
    with pytest.raises(TypeError, match=r"handed_on returns .*; wanted no arrays"):
        kernels.jit(lambda numbers: hand_on(numbers)[0])(np.ones(2))


class Numbers(NamedTuple):
    """Numbers as they are compiled."""

    real: float
    whole: int


def test_an_entry_point_is_made_for_each_compiled_type_and_only_once() -> None:
    table = np.arange(12.0).reshape(3, 4)
    fixed = table.copy()
    fixed.flags.writeable = False
    records = np.zeros(1, [("a", "f8")]), np.zeros(1, [("a", "i8")])
    different: list[Any] = [
        table,
        np.asfortranarray(table),
        table[:, ::2],
        fixed,
        table.astype("f4"),
        table[0],
        *records,
        *(rows[0] for rows in records),
        1,
        2**63,
        1.0,
        True,
        Phase.FLIGHT,
        Numbers(1.0, 1),
        Numbers(1.0, True),
        Numbers(1.0, 2**63),
        (1, 1.0),
        (1.0, 1),
    ]
    kernel = kernels.jit(lambda value: 0)
    points = [kernels.entry_point(kernel, value) for value in different]
    assert len(set(map(id, points))) == len(different)
    assert kernels.entry_point(kernel, table[:2]) is points[0]
    assert kernels.entry_point(kernel, Numbers(1, 2)) is kernels.entry_point(kernel, Numbers(1.0, 1))


def test_an_entry_point_reads_arrays_in_their_order() -> None:
    table = np.arange(12.0).reshape(3, 4)
    kernel = kernels.jit(lambda values: values[1, 1])
    for values in (np.asfortranarray(table), table[:, ::2], table):
        assert kernels.entry_point(kernel, values)(values) == values[1, 1]


PROGRAM = """
import sys
import tempfile
sys.path.insert(0, {root!r})
from plant_sim.caller import call
print(call(1.0))
"""


def test_an_edited_callee_in_another_file_is_never_run_stale(tmp_path: Path) -> None:
    package = tmp_path / "plant_sim"
    package.mkdir()
    (package / "__init__.py").touch()
    for module in (kernels, linking):
        (package / Path(module.__file__).name).write_text(Path(module.__file__).read_text())
    (package / "caller.py").write_text(
        "from plant_sim.kernels import jit\nfrom plant_sim.callee import value\n"
        "@jit\ndef call(x):\n    return value(x)\n"
    )
    # Python itself takes an edit within the same second and of the same length for none: no bytecode is kept.
    environment = {
        "VIBROHIL_CACHE_DIR": str(tmp_path / "cache"),
        "PYTHONPATH": "",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    answers = []
    for factor in ("2.0", "3.0", "3.0"):
        (package / "callee.py").write_text(
            f"from plant_sim.kernels import subroutine\n@subroutine\ndef value(x):\n    return {factor} * x\n"
        )
        run = subprocess.run(
            [sys.executable, "-c", PROGRAM.format(root=str(tmp_path))],
            env=os.environ | environment,
            capture_output=True,
            text=True,
            check=True,
        )
        answers.append(float(run.stdout))
    assert answers == [2.0, 3.0, 3.0]
    assert len(list((tmp_path / "cache").iterdir())) == 2


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.touch()
    run = subprocess.run(
        [sys.executable, "-c", "import plant_sim.plant"],
        env={
            **os.environ,
            "VIBROHIL_CACHE_DIR": str(blocked),
            "PYTHONPATH": str(Path(kernels.__file__).parents[1]),
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode != 0
    assert "set VIBROHIL_CACHE_DIR to a writable folder" in run.stderr


def test_an_existing_folder_that_cannot_be_written_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**_: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setenv("VIBROHIL_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)  # root may write anywhere
    with pytest.raises(kernels.KernelCacheError, match=r"cannot be written \(Permission denied\); set"):
        kernels.cache_folder("unwritable", ())
