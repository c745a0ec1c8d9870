"""Memory and run time of the firmware on an emulated Cortex-M: flash, RAM, stack, instructions per tick."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numpy as np

from firmware_py.builds.board import TIMER_TICKS_AN_INSTRUCTION, BoardName, image
from firmware_py.builds.c_compiler import measure_sizes
from firmware_py.builds.flat import Precision, layout
from firmware_py.core.config import Config
from firmware_py.node.inbox import PERIODS
from firmware_py.node.memory import FirmwareState
from firmware_py.shell.board_node import MEASURED_TICK, BoardNode
from hil.runs.job import Job, Progress
from hil.runs.recording import record
from hil.scenario.scenario import load_scenario

SCENARIOS = ("soft-start-multistable", "a-controller-that-pauses-for-thirty-ticks-goes-on")
"""An ordinary run, and one whose firmware catches up after an overrun."""


def blocks(kind: Any) -> dict[str, int]:
    """Bytes of a record's members, each including the padding after it."""
    begins = [place for _, place in kind.fields.values()]
    lengths = (end - begin for begin, end in zip(begins, [*begins[1:], kind.itemsize], strict=True))
    return dict(zip(kind.fields, lengths, strict=True))


def ram_by_block(precision: Precision) -> dict[str, dict[str, int]]:
    """Bytes of the `config` and the `state` by block, each with the largest first."""
    whole = layout(FirmwareState, precision)
    state = whole.fields["node"][0]
    core = {f"core.{name}": size for name, size in blocks(state.fields["core"][0]).items()}
    others = {name: size for name, size in blocks(whole).items() if name != "node"}
    parts = {
        "config": blocks(layout(Config, precision)),
        "state": {name: size for name, size in blocks(state).items() if name != "core"} | core | others,
    }
    return {part: dict(sorted(found.items(), key=lambda one: -one[1])) for part, found in parts.items()}


def budget(names: Sequence[str], progress: Progress, target: BoardName = "cortex-m7") -> dict[str, Any]:
    """Sizes in bytes, and the instructions per tick: of ordinary ticks, and of those that catch up."""
    measured: list[tuple[str, bool, float, int]] = []

    class Measured(BoardNode):
        kind = MEASURED_TICK

        def run(self) -> None:
            super().run()
            instructions = float(self.reply["timer_ticks"][0]) / TIMER_TICKS_AN_INSTRUCTION
            measured.append((name, self.inbox[PERIODS] == 0, instructions, int(self.reply["stack_bytes"][0])))

    Measured.target = target
    flash = image_bytes(target)
    for name in names or SCENARIOS:
        with tempfile.TemporaryDirectory() as folder:
            record(Job(load_scenario(name), 1, Measured, Path(folder), progress=progress))
    ordinary = [one for one in measured if one[1]]
    late = [one for one in measured if not one[1]]
    found = measure_sizes(target)
    return {
        "flash": {
            "code": found["code"],
            "constants": found["constants"],
            "image": flash,
            "image without a gait": flash - in_flash(found) + in_flash(measure_sizes(target, has_gait=False)),
        },
        "ram": {name: found[name] for name in ("config", "state", "tx")},
        "stack": max(one[3] for one in measured),
        "instructions": {"ordinary": spread(ordinary), "catching_up": spread(late) if late else None},
    }


def in_flash(of_object: dict[str, int]) -> int:
    """Bytes of an object file in flash."""
    return of_object["code"] + of_object["constants"]


def spread(ticks: Sequence[tuple[str, bool, float, int]]) -> dict[str, Any]:
    """Percentiles of the instructions per tick, and the scenario of the worst tick."""
    instructions = [one[2] for one in ticks]
    p50, p99 = np.percentile(instructions, [50, 99]).tolist()
    worst = max(ticks, key=lambda one: one[2])
    return {"p50": p50, "p99": p99, "worst": worst[2], "scenario": worst[0]}


def image_bytes(target: BoardName) -> int:
    """Flash of the whole image, in bytes: the firmware, parts of the C library and the bench's own code."""
    total = 0
    for section in llvm.ObjectFileRef.from_path(str(image(target))).sections():
        total += section.size() if (section.name() or b"") in (b".text", b".ARM.exidx", b".data") else 0
    return total
