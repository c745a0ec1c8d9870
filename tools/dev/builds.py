"""`python -m tools.dev.builds [NAME…]`: the firmware's builds side by side, in lockstep.

Each scenario runs once on the `python` build, whose algebra is filterpy's, and once on the `compiled` one.
Rounding differs, so the sent bytes may differ; modes, faults and detected impacts must be the same, each
within a tick. `vibrohil compare` of a suite on each build compares the verdicts.

In the first run three more nodes receive the same frames: the interpreted firmware with its algebra written
out, the compiled firmware, and the emitted C. These three must send the same bytes in every tick, and the
last two must keep the same state to the bit. Without names: all scenarios.

`--board cortex-m7` instead runs each scenario on the emulated board and on the compiled build, `--board
cortex-m4f` on the board and on `host-single`: can.log must be the same to the byte.

filterpy's algebra is numpy's, whose last bits depend on the processor. All machines take OpenBLAS's kernels
for Haswell, so that a comparison has the same result everywhere: with those for AVX-512, the mode at the end
of `soft-start-multistable` changes 5 ticks later.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple

os.environ["OPENBLAS_CORETYPE"] = "Haswell"  # before numpy is imported, here and in each worker

import numpy as np
from numpy.typing import NDArray

from firmware_py.builds.c_compiler import shared_library
from firmware_py.builds.flat import layout
from firmware_py.core.config import Config
from firmware_py.core.estimation import kalman
from firmware_py.interface.frame import Frame
from firmware_py.node.memory import FirmwareState
from firmware_py.shell.builds import HERE, Build
from firmware_py.shell.native import NativeNode, emitted_functions
from firmware_py.shell.node import FirmwareNode, MakeNode
from hil.nodes.firmware.runner import warm_firmware
from hil.nodes.plant.runner import PlantRunner
from hil.processes import workers
from hil.record.traces.trace import read
from hil.run_files import RunFile, trace_file
from hil.runs.job import Job
from hil.runs.recording import record
from hil.scenario.files import scenario_names
from hil.scenario.scenario import Scenario, load_scenario
from hil.suite.suite import PROCESSES

TOLERANCE_TICKS = 1
"""Largest time difference of equal decisions of two builds."""


class Decisions(NamedTuple):
    """Changes of mode or fault, rows of (tick, mode, fault), and detections of impacts, rows of (tick,)."""

    modes: NDArray[np.int64]
    impacts: NDArray[np.int64]


def decisions_of(trace: NDArray[np.void]) -> Decisions:
    """The decisions of a firmware, from its trace."""
    now = np.column_stack([trace["tick"], trace["outputs.mode"], trace["outputs.fault"]]).astype(np.int64)
    changes = np.flatnonzero(np.any(np.diff(now[:, 1:], axis=0) != 0, axis=1)) + 1
    return Decisions(now[changes], now[trace["outputs.impact"], :1])


def differences(python: Decisions, compiled: Decisions) -> list[str]:
    """A sentence for each decision without an equal decision of the other build within the tolerance."""
    found = []
    for kind, ours, others in zip(Decisions._fields, python, compiled, strict=True):
        for one, other in zip_longest(ours.tolist(), others.tolist()):
            same = one is not None and other is not None and one[1:] == other[1:]
            if not same or abs(one[0] - other[0]) > TOLERANCE_TICKS:
                found.append(f"{kind}: python decides {one}, compiled {other}")
    return found


class DifferentBytesError(AssertionError):
    """Two builds sent different frames."""


@contextmanager
def written_out() -> Iterator[None]:
    """Within the context, the interpreted firmware uses the algebra of the compiled firmware."""
    shipped = kalman.predict, kalman.update
    kalman.predict, kalman.update = kalman.predict_written_out, kalman.update_written_out
    try:
        yield
    finally:
        kalman.predict, kalman.update = shipped


class EmittedNode(NativeNode):
    """A node of the emitted C, in double precision."""

    @staticmethod
    def load_functions() -> list[Any]:
        """The functions of the emitted C."""
        return emitted_functions("double")


def numbers_in(kind: Any, start: int = 0) -> Iterator[int]:
    """The bytes of a record that are no padding."""
    if kind.subdtype is not None:
        item, shape = kind.subdtype
        for index in range(int(np.prod(shape))):
            yield from numbers_in(item, start + index * item.itemsize)
    elif kind.fields is None:
        yield from range(start, start + kind.itemsize)
    else:
        for item, offset in kind.fields.values():
            yield from numbers_in(item, start + offset)


NUMBERS = np.fromiter(numbers_in(layout(FirmwareState)), np.int64)


class Beside(FirmwareNode):
    """The interpreted firmware; on the same frames, its written-out algebra, the compiled one and the C."""

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._written_out = FirmwareNode(config)
        self._compiled, self._emitted = NativeNode(config), EmittedNode(config)
        self._ticks = 0

    def tick(self, frames_in: Sequence[Frame], elapsed_ticks: int) -> list[Frame]:
        """Run one control tick of all four; DifferentBytesError if the other three differ."""
        self._ticks += elapsed_ticks
        with written_out():
            sent = self._written_out.tick(frames_in, elapsed_ticks)
        others = self._compiled.tick(frames_in, elapsed_ticks)
        if sent != others:
            raise DifferentBytesError(f"tick {self._ticks}: python sends {sent}, compiled sends {others}")
        emitted = self._emitted.tick(frames_in, elapsed_ticks)
        if emitted != others:
            raise DifferentBytesError(f"tick {self._ticks}: C sends {emitted}, compiled sends {others}")
        one, other = (node.whole.view(np.uint8)[NUMBERS] for node in (self._compiled, self._emitted))
        if not np.array_equal(one, other):
            raise DifferentBytesError(f"tick {self._ticks}: the state of the C differs from the compiled one")
        return super().tick(frames_in, elapsed_ticks)


def decide(scenario: Scenario, seed: int, firmware: str | MakeNode) -> Decisions:
    """Decisions of a run on a node; DifferentBytesError if it is `Beside` and the other two nodes differ."""
    with tempfile.TemporaryDirectory() as folder:
        record(Job(scenario, seed, firmware, Path(folder)))
        return decisions_of(read(Path(folder) / trace_file("firmware")))


def difference(name: str, seed: int) -> str:
    """The first difference between the builds in a scenario; empty if there is none."""
    scenario = load_scenario(name)
    PlantRunner.warm(scenario)
    try:
        of_python = decide(scenario, seed, Beside)
        found = differences(of_python, decide(scenario, seed, "compiled"))
    except DifferentBytesError as error:
        return str(error)
    return f"{len(found)} decisions differ, first {found[0]}" if found else ""


def different_log(name: str, seed: int, board: Build) -> str:
    """The first line in which can.log differs between board and this machine; empty if there is none."""
    logs = []
    for build in (board, HERE[board]):
        with tempfile.TemporaryDirectory() as folder:
            record(Job(load_scenario(name), seed, build, Path(folder)))
            logs.append((Path(folder) / RunFile.CAN_LOG).read_text().splitlines())
    pairs = enumerate(zip_longest(*logs, fillvalue="nothing"))
    return next((f"line {k}: {ours} here {here}" for k, (ours, here) in pairs if ours != here), "")


def main() -> None:
    """Compare the builds, and exit with status 1 if any scenario differs."""
    parser = argparse.ArgumentParser(prog="python -m tools.dev.builds", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--board", choices=HERE)
    given = parser.parse_args()
    names = given.names or scenario_names()
    # Compile once for all processes.
    if given.board is None:
        warm_firmware({}, "compiled")
        shared_library("host")
        compare, same = partial(difference, seed=given.seed), "the same bytes and decisions"
    else:
        for build in (given.board, HERE[given.board]):
            warm_firmware({}, build)
        compare, same = partial(different_log, seed=given.seed, board=given.board), "the same bytes"
    failed = 0
    for name, found in workers.results(compare, names, PROCESSES):
        differs = workers.alive(found)
        failed += differs != ""
        print(f"{name}: {differs or same}", flush=True)
    print(f"{len(names) - failed} of {len(names)} scenarios: {same} from all builds")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
