"""What the firmware takes of an emulated Cortex-M7: flash, RAM, stack, and instructions a tick."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import llvmlite.binding as llvm
import numpy as np

from firmware_py.builds.board import TIMER_TICKS_AN_INSTRUCTION, image
from firmware_py.builds.machine_code import object_code, sizes
from firmware_py.shell.board_node import MEASURED_TICK, BoardNode
from hil.lockstep import Progress, run_lockstep
from hil.scenario import load_scenario

SCENARIOS = ("soft-start-multistable", "a-controller-that-pauses-for-long-stops-the-motor")
"""An ordinary run, and one whose tick after a pause is the longest."""


def budget(names: Sequence[str], progress: Progress) -> dict[str, Any]:
    """Sizes in bytes, and the instructions of ordinary ticks and of those after a pause, with their worst."""
    measured: list[tuple[str, int, float, int]] = []

    class Measured(BoardNode):
        kind = MEASURED_TICK

        def run(self, elapsed_ticks: int, frame_count: int, frames: Any) -> bool:
            done = super().run(elapsed_ticks, frame_count, frames)
            instructions = float(self.reply["timer_ticks"][0]) / TIMER_TICKS_AN_INSTRUCTION
            measured.append((name, elapsed_ticks, instructions, int(self.reply["stack_bytes"][0])))
            return done

    flash = image_bytes()
    for name in names or SCENARIOS:
        with tempfile.TemporaryDirectory() as folder, patch("hil.nodes.node_of", lambda _: Measured):
            run_lockstep(load_scenario(name), Path(folder), 1, progress)
    ordinary = [one for one in measured if one[1] == 1]
    late = [one for one in measured if one[1] > 1]
    found = sizes(object_code("cortex-m7"))
    return {
        "flash": {"code": found["code"], "constants": found["constants"], "image": flash},
        "ram": {name: found[name] for name in ("config", "state", "tx")},
        "stack": max(one[3] for one in measured),
        "instructions": {"ordinary": spread(ordinary), "after_a_pause": spread(late) if late else None},
    }


def spread(ticks: Sequence[tuple[str, int, float, int]]) -> dict[str, Any]:
    """Percentiles of the ticks' instructions, and where the worst was."""
    instructions = [one[2] for one in ticks]
    p50, p99 = np.percentile(instructions, [50, 99]).tolist()
    worst = max(ticks, key=lambda one: one[2])
    return {"p50": p50, "p99": p99, "worst": worst[2], "scenario": worst[0], "elapsed_ticks": worst[1]}


def image_bytes() -> int:
    """Flash that the whole image takes: the firmware, the C library's part and the bench's few lines."""
    total = 0
    for section in llvm.ObjectFileRef.from_path(str(image())).sections():
        total += section.size() if (section.name() or b"") in (b".text", b".ARM.exidx", b".data") else 0
    return total
