"""Cost and effect of the firmware's builds: one start and hold in lockstep on each build."""

import math
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from firmware_py.interface.frame import Frame
from firmware_py.shell.builds import Build, node_of
from firmware_py.shell.node import FirmwareNode
from hil.bench.lockstep import in_lockstep, run_lockstep, silent
from hil.judge.figures.figures import figures_of
from hil.nodes.warm import warm_firmware, warm_plant
from hil.record.traces.trace import read
from hil.scenario.scenario import Scenario
from tools.trade.control_rate import short_start
from tools.trade.costs import Progress
from tools.trade.decisions import Decisions, decisions_of, differences

BUILDS: tuple[tuple[Build, str], ...] = (
    ("python", "interpreted, filterpy's algebra"),
    ("compiled", "numba's code, algebra written out"),
)
UNIT = "m (RMS of the estimated position); µs of processor per tick, called from Python"

Received = list[tuple[list[Frame], int]]
"""For each tick: the received frames, and the number of elapsed ticks."""


class Outcome(NamedTuple):
    """Result of a run on one build: the estimate's RMS errors, and the firmware's decisions."""

    x_rmse_m: float
    v_rmse_m_s: float
    decisions: Decisions


def measure(repeats: int, progress: Progress) -> list[dict[str, Any]]:
    """Run the scenario on each build and return a row for each."""
    scenario = short_start()
    warm_plant(scenario.scene)
    outcomes, received = {}, received_in(scenario)
    for build, _ in BUILDS:
        progress(f"firmware build: {build}")
        warm_firmware(scenario.parameters, build)
        outcomes[build] = _run(scenario, build)
    decided = outcomes["compiled"].decisions
    return [
        {
            "what": f"firmware build: {build}",
            "kind": "firmware build",
            "build": build,
            "setting": setting,
            "error": outcomes[build].x_rmse_m,
            "cost": min(_replayed_us(scenario, build, received) for _ in range(repeats)),
            "unit": UNIT,
            "v_rmse_m_s": outcomes[build].v_rmse_m_s,
            "decisions": outcomes[build].decisions.total,
            "decisions_that_differ": len(differences(outcomes[build].decisions, decided)),
        }
        for build, setting in BUILDS
    ]


def received_in(scenario: Scenario) -> Received:
    """Return the frames that the firmware receives in a run."""
    received: Received = []

    class Recorder(FirmwareNode):
        def tick(self, frames_in: Sequence[Frame], elapsed_ticks: int) -> list[Frame]:
            received.append((list(frames_in), elapsed_ticks))
            return super().tick(frames_in, elapsed_ticks)

    with tempfile.TemporaryDirectory() as folder:
        run_lockstep(scenario, Path(folder), 1, silent, make=Recorder)
    return received


def _run(scenario: Scenario, build: Build) -> Outcome:
    with tempfile.TemporaryDirectory() as folder:
        run_dir, _ = in_lockstep(scenario, Path(folder) / "run", 1, silent, build)
        estimate = figures_of(run_dir).estimate
        errors = [math.nan if one is None else one for one in (estimate.x_rmse_m, estimate.v_rmse_m_s)]
        return Outcome(errors[0], errors[1], decisions_of(read(run_dir / "firmware.trace")))


def _replayed_us(scenario: Scenario, build: Build, received: Received) -> float:
    tick: Callable[[Sequence[Frame], int], list[Frame]] = node_of(build)(scenario.config).tick
    begun = time.thread_time_ns()
    for frames, elapsed_ticks in received:
        tick(frames, elapsed_ticks)
    return (time.thread_time_ns() - begun) * 1e-3 / len(received)
