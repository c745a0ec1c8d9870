"""Memory and run time of the firmware on an emulated Cortex-M: flash, RAM, stack, instructions per tick."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from firmware_py.builds.board import TIMER_TICKS_AN_INSTRUCTION, BoardName, image
from firmware_py.builds.machine_code import sizes
from firmware_py.shell.board_node import MEASURED_TICK, BoardNode
from hil.bench.lockstep import Progress, run_lockstep
from hil.scenario.scenario import load_scenario

SCENARIOS = ("soft-start-multistable", "a-controller-that-pauses-for-thirty-ticks-goes-on")
"""An ordinary run, and the run with the longest tick after an overrun: most samples have queued up there."""


def budget(names: Sequence[str], progress: Progress, target: BoardName = "cortex-m7") -> dict[str, Any]:
    """Sizes in bytes, and the instructions per tick: of ordinary ticks, and of ticks after an overrun."""
    measured: list[tuple[str, int, float, int]] = []

    class Measured(BoardNode):
        kind = MEASURED_TICK

        def run(self, elapsed_ticks: int, frame_count: int, frames: Any) -> bool:
            done = super().run(elapsed_ticks, frame_count, frames)
            instructions = float(self.reply["timer_ticks"][0]) / TIMER_TICKS_AN_INSTRUCTION
            measured.append((name, elapsed_ticks, instructions, int(self.reply["stack_bytes"][0])))
            return done

    Measured.target = target
    flash = image_bytes(target)
    for name in names or SCENARIOS:
        with tempfile.TemporaryDirectory() as folder:
            run_lockstep(load_scenario(name), Path(folder), 1, progress, make=Measured)
    ordinary = [one for one in measured if one[1] == 1]
    late = [one for one in measured if one[1] > 1]
    found = sizes(target)
    return {
        "flash": {"code": found["code"], "constants": found["constants"], "image": flash},
        "ram": {name: found[name] for name in ("config", "state", "tx")},
        "stack": max(one[3] for one in measured),
        "instructions": {"ordinary": spread(ordinary), "after_a_pause": spread(late) if late else None},
    }


def spread(ticks: Sequence[tuple[str, int, float, int]]) -> dict[str, Any]:
    """Percentiles of the instructions per tick, and the scenario of the worst tick."""
    instructions = [one[2] for one in ticks]
    p50, p99 = np.percentile(instructions, [50, 99]).tolist()
    worst = max(ticks, key=lambda one: one[2])
    return {"p50": p50, "p99": p99, "worst": worst[2], "scenario": worst[0], "elapsed_ticks": worst[1]}


def image_bytes(target: BoardName) -> int:
    """Flash of the whole image, in bytes: the firmware, parts of the C library and the bench's own code."""
    total = 0
    for section in llvm.ObjectFileRef.from_path(str(image(target))).sections():
        total += section.size() if (section.name() or b"") in (b".text", b".ARM.exidx", b".data") else 0
    return total
