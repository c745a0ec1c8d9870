"""The firmware in single precision: every float narrowed, every integer kept, the same decisions."""

import random
import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from closed_loop import Bench
from compilers import require_compiler

from firmware_py.builds.c99.emitter import emit
from firmware_py.builds.c99.single_precision import REPLACED, round_to_single
from firmware_py.builds.flat import copier, from_flat, to_flat, to_precision
from firmware_py.core.config import Config
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated import kinds
from firmware_py.node.tick import INITIAL, NodeState
from firmware_py.shell.flat_node import FlatNode
from firmware_py.shell.native import NativeNode, SinglePrecisionNode
from firmware_py.shell.parameters import config_from


def test_each_constant_of_the_number_format_is_met_in_the_firmware() -> None:
    """Of an elementary function that is rewritten, what is replaced has to be thought over."""
    literals = set(
        map(float, re.findall(r"(?<![\w.])\d+\.\d+(?:e[+-]?\d+)?(?![\w.])", emit("double").text()))
    )
    assert set(REPLACED) <= literals
    assert {value for value in literals if abs(value) > 2.0**24} - set(REPLACED) == {
        1e9,  # the largest to wrap
        3.4028235677973366e38,  # rounds to infinity, and every finite float is below it
    }


def test_memory_goes_to_single_precision_and_back() -> None:
    memory = to_flat(INITIAL)
    small, back = to_precision(memory, NodeState, "single"), to_flat(INITIAL)
    back["core"]["estimator"]["x_m"] = 1.0
    back["ticks"] = 7
    copier(small, back)()
    assert back.tobytes() == to_flat(from_flat(NodeState, small[0].item())).tobytes()
    assert np.allclose(reals(back), reals(memory), rtol=1e-7, atol=0.0, equal_nan=True)
    assert integers(back) == integers(memory)
    assert small["ticks"].dtype == np.int64
    assert 0.5 * memory.nbytes < small.nbytes < memory.nbytes
    config = to_precision(to_flat(config_from({})), Config, "single")
    assert config["tick_s"][0] == np.float32(0.001)
    assert round_to_single(1e39) == np.inf
    with_large = to_flat(INITIAL)
    with_large["core"]["estimator"]["x_m"] = -1e39
    assert to_precision(with_large, NodeState, "single")["core"]["estimator"]["x_m"][0] == -np.inf


@pytest.fixture
def gcc() -> None:
    require_compiler("gcc")


PARAMETERS = {"start.rise_s": 2.0, "start.confirm_periods": 2}
A_DAY_TICKS = 86_400_000


def driven(nodes: Sequence[FlatNode], each_tick: Callable[[list[list[Frame]]], None]) -> None:
    """Start and hold, driven by a compiled node; the others get the same frames, of which a few are lost."""
    dice = random.Random(1)

    def change(_: int, frames: list[Frame]) -> list[Frame]:
        kept = [frame for frame in frames if dice.random() < 0.99]
        each_tick([node.tick(kept, 1) for node in nodes])
        return kept

    bench = Bench(PARAMETERS, change=change, build="compiled")
    bench.started()
    bench.run(4.5, keep=False)
    assert bench.node.outputs.torque_n_m != 0.0


@pytest.mark.usefixtures("gcc")
def test_open_loop_it_estimates_as_in_double_precision() -> None:
    config = config_from(PARAMETERS)
    ours, double = SinglePrecisionNode(config), NativeNode(config)
    errors, modes = [], []

    def look(_: list[list[Frame]]) -> None:
        estimates = [node.memory["core"]["estimator"][0] for node in (ours, double)]
        errors.append([abs(estimates[0][name] - estimates[1][name]) for name in ("x_m", "v_m_s")])
        modes.append([int(node.memory["outputs"]["mode"][0]) for node in (ours, double)])
        for name in ("ticks", "received", "counters"):
            assert integers(ours.memory[name]) == integers(double.memory[name])

    driven([ours, double], look)
    x_m, v_m_s = np.max(errors, axis=0)
    assert 1e-9 < x_m < 50e-6
    assert 1e-9 < v_m_s < 0.2e-3
    changes = [np.flatnonzero(np.diff(one)) for one in np.array(modes).T]
    assert len(changes[0]) == len(changes[1]) >= 2
    assert np.max(np.abs(changes[0] - changes[1])) <= 2


def numbers(memory: Any, kind: str) -> list[Any]:
    """The numbers of a kind in memory of a record."""
    if memory.dtype.names is None:
        return memory.ravel().tolist() if memory.dtype.kind == kind else []
    return [found for name in memory.dtype.names for found in numbers(memory[name], kind)]


def integers(memory: Any) -> list[int]:
    return numbers(memory, "i")


def reals(memory: Any) -> list[float]:
    return numbers(memory, "f")


@pytest.mark.usefixtures("gcc")
def test_after_a_day_it_sends_what_it_sends_at_first() -> None:
    """Clocks and ages are integers, or real numbers that begin anew with each period."""
    config = config_from(PARAMETERS)
    first, later = SinglePrecisionNode(config), SinglePrecisionNode(config)
    later.memory["ticks"] = A_DAY_TICKS
    later.push_memory()
    sent: list[Frame] = []

    def look(frames: list[list[Frame]]) -> None:
        assert frames[0] == frames[1]
        sent.extend(frames[0])

    driven([first, later], look)
    assert later.memory["ticks"][0] == first.memory["ticks"][0] + A_DAY_TICKS
    assert len(sent) > 5_000
    assert sum(frame.can_id == kinds.IMPACT_EVENT.can_id for frame in sent) > 3
