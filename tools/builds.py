"""`python -m tools.builds [NAME…]`: the builds of the firmware, one against the other, in lockstep.

Each scenario runs on the interpreted firmware with its algebra written out while the compiled one receives
the same frames: both have to send the same bytes in every tick. Without names: all scenarios.

What filterpy's algebra changes is seen by `vibrohil compare` of a suite on each build.
"""

import argparse
import multiprocessing
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from itertools import repeat
from pathlib import Path
from typing import Any
from unittest.mock import patch

from firmware_py.core import kalman
from firmware_py.interface.frame import Frame
from firmware_py.shell.builds import node_of
from firmware_py.shell.node import FirmwareNode
from hil.lockstep import run_lockstep
from hil.scenario import Scenario, load_scenario, scenario_names
from hil.warm import warm_firmware, warm_plant


class DifferentBytesError(AssertionError):
    """Two builds sent different frames."""


class Twins(FirmwareNode):
    """The interpreted firmware, with the compiled one on the same frames."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._other = node_of("compiled")(*arguments)
        self._ticks = 0

    def tick(self, frames_in: Sequence[Frame], elapsed_ticks: int) -> list[Frame]:
        """One control tick of both."""
        self._ticks += elapsed_ticks
        sent, others = super().tick(frames_in, elapsed_ticks), self._other.tick(frames_in, elapsed_ticks)
        if sent != others:
            raise DifferentBytesError(f"tick {self._ticks}: python sends {sent}, compiled sends {others}")
        return sent


def silent(_: float, __: str) -> None:
    """No progress is shown."""


def same_bytes(scenario: Scenario, seed: int) -> None:
    """Run `scenario` on both builds at once; raise DifferentBytesError at the first tick that differs."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for name in ("predict", "update"):
            stack.enter_context(patch.object(kalman, name, getattr(kalman, f"{name}_written_out")))
        stack.enter_context(patch("hil.nodes.node_of", lambda _: Twins))
        run_lockstep(scenario, folder, seed, silent)


def difference(name: str, seed: int) -> str:
    """What differs in the scenario of this name; empty if nothing does."""
    scenario = load_scenario(name)
    warm_plant(scenario.scene)
    try:
        same_bytes(scenario, seed)
    except DifferentBytesError as error:
        return str(error)
    return ""


def main() -> None:
    """Compare, and exit with 1 where anything differs."""
    parser = argparse.ArgumentParser(prog="python -m tools.builds", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    names = given.names or scenario_names()
    warm_firmware({}, "compiled")  # compiled once, for all processes
    failed = 0
    with ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")) as pool:
        for name, found in zip(names, pool.map(difference, names, repeat(given.seed)), strict=True):
            failed += found != ""
            print(f"{name}: {found or 'the same bytes'}", flush=True)
    print(f"{len(names) - failed} of {len(names)} scenarios: both builds send the same bytes")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
