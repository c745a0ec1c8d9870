"""Kernels are cached by the state of the sources, and are made for the types of a scene's parts."""

import subprocess
import sys
from typing import Any, NamedTuple

import numpy as np
import pytest

from plant_sim import kernels
from plant_sim.parts.friction import static_limit_n
from plant_sim.parts.stop import RigidStop
from plant_sim.result import Phase


def test_a_subroutine_that_returns_an_array_is_refused() -> None:
    @kernels.subroutine
    def hand_on(numbers):  # type: ignore[no-untyped-def]
        return numbers

    with pytest.raises(TypeError, match=r"hand_on returns .*; wanted no arrays"):
        kernels.jit(lambda numbers: hand_on(numbers)[0])(np.ones(2))


def test_a_law_in_a_file_that_a_kernel_need_not_import_is_refused() -> None:
    """A cached kernel would not be compiled anew after a change of the law."""
    with pytest.raises(TypeError, match=r"put the law into plant_sim.parts.friction or plant_sim.parts.stop"):
        static_limit_n.register(RigidStop)(lambda stop, normal_n: 0.0)


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


REPLACING = """
from typing import Any, NamedTuple
import numpy as np
import numba
import compilation.record_replace

class Record(NamedTuple):
    step_s: float
    values: Any

@numba.njit
def kept(count):
    record, total = Record(1.0, np.ones(3)), 0.0
    for step in range(count):
        total += record._replace(step_s=float(step)).values.sum()
        total += record._replace(values=np.full(3, 2.0)).step_s
    return record.values.sum(), total

print(kept(1000))
"""


def test_a_record_keeps_the_array_that_it_shares_with_its_replacements() -> None:
    """In a process of its own: an array that is freed too often ends it."""
    ended = subprocess.run([sys.executable, "-c", REPLACING], capture_output=True, text=True, check=False)
    assert (ended.stdout, ended.returncode) == ("(3.0, 4000.0)\n", 0), ended.stderr
