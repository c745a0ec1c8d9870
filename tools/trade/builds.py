"""Cost and effect of the firmware's builds: one start and hold in lockstep on each build."""

import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from firmware_py.interface.frame import Frame
from firmware_py.shell.builds import Build, node_of
from hil.bench.lockstep import run_lockstep, silent
from hil.scenario.scenario import Scenario
from tools.trade.control_rate import errors_of, hold, short_start
from tools.trade.costs import Progress

BUILDS: tuple[tuple[Build, str], ...] = (
    ("python", "interpreted, filterpy's algebra"),
    ("compiled", "numba's code, algebra written out"),
)
UNIT = "m (RMS of the estimated position); µs of processor per tick, called from Python"

Received = list[tuple[list[Frame], int]]
"""For each tick: the received frames, and the number of elapsed ticks."""


def measure(repeats: int, progress: Progress) -> list[dict[str, Any]]:
    """Run the scenario on each build and return a row for each."""
    scenario = short_start()
    held = {}
    for build, _ in BUILDS:
        progress(f"firmware build: {build}")
        held[build], _ = hold(scenario, build)
    received = received_in(scenario)
    return [
        {
            "what": f"firmware build: {build}",
            "kind": "firmware build",
            "build": build,
            "setting": setting,
            **errors_of(held[build]),
            "cost": min(_replayed_us(scenario, build, received) for _ in range(repeats)),
            "unit": UNIT,
        }
        for build, setting in BUILDS
    ]


def received_in(scenario: Scenario) -> Received:
    """Return the frames that the firmware receives in a run."""
    from firmware_py.shell.native import NativeNode

    received: Received = []

    class Recorder(NativeNode):
        def tick(self, frames_in: Sequence[Frame], elapsed_ticks: int) -> list[Frame]:
            received.append((list(frames_in), elapsed_ticks))
            return super().tick(frames_in, elapsed_ticks)

    with tempfile.TemporaryDirectory() as folder:
        run_lockstep(scenario, Path(folder), 1, silent, make=Recorder)
    return received


def _replayed_us(scenario: Scenario, build: Build, received: Received) -> float:
    tick: Callable[[Sequence[Frame], int], list[Frame]] = node_of(build)(scenario.config).tick
    begun = time.thread_time_ns()
    for frames, elapsed_ticks in received:
        tick(frames, elapsed_ticks)
    return (time.thread_time_ns() - begun) * 1e-3 / len(received)
