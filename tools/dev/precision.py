"""`python -m tools.dev.precision [NAME…]`: the firmware in single precision beside double precision.

Each scenario runs in lockstep once on the `compiled` build and once on `cortex-m4f`. In the second run a
compiled node receives the same frames, but its outputs have no effect: this is the open loop, in which only
the precision differs.

The program prints for each scenario the largest difference of position, speed and torque in open loop, the
checks whose verdicts differ between the closed loops, and the distances of modes and impacts in ticks. Then
it prints the members of the firmware's state that differ most, on average over a run, relative to the largest
value of each. The exit status is 1 if a verdict differs. Without names: all scenarios.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from firmware_py.builds.flat import layout
from firmware_py.core.state import Config
from firmware_py.interface.frame import Frame
from firmware_py.node.tick import NodeState
from firmware_py.shell import board_node
from firmware_py.shell.compiled_node import CompiledNode
from hil.bench.lockstep import in_lockstep, silent
from hil.bench.verdict import judge
from hil.judge.decisions import Decisions, decisions_of
from hil.judge.figures.figures import figures_from
from hil.record.run_traces import read_run
from hil.record.traces.trace import read
from hil.scenario.scenario import Scenario, load_scenario, scenario_names

POSITION, SPEED, TORQUE = "core.estimator.x_m", "core.estimator.v_m_s", "outputs.torque_n_m"
MOST_SHOWN = 12


def reals(kind: Any, name: str = "", start: int = 0) -> Iterator[tuple[str, int]]:
    """The real numbers of a record's type, with their places in bytes."""
    if kind.subdtype is not None:
        item, (count,) = kind.subdtype
        for index in range(count):
            yield from reals(item, f"{name}[{index}]", start + index * item.itemsize)
    elif kind.names is not None:
        for member, (inner, place) in kind.fields.items():
            yield from reals(inner, f"{name}.{member}".removeprefix("."), start + place)
    elif kind.kind == "f":
        yield name, start


PLACES = dict(reals(layout(NodeState)))
"""Offset in bytes of each real number in the firmware's state."""
_INDEX = np.array(list(PLACES.values())) // 8


class Beside(board_node.SinglePrecisionBoardNode):
    """The firmware in single precision; a second node, in double precision, only receives the same frames."""

    made: "list[Beside]" = []  # noqa: RUF012 - the nodes of a run, in the order of their restarts

    def __init__(self, config: Config, parameters: Mapping[str, Any] | None = None) -> None:
        super().__init__(config, parameters)
        self._double = CompiledNode(config, parameters)
        self.largest, self.total, self.range = (np.zeros(len(PLACES)) for _ in range(3))
        self.ticks = 0
        Beside.made.append(self)

    def tick(self, frames_in: Sequence[Frame], elapsed_ticks: int) -> list[Frame]:
        """Run one control tick of both, and accumulate the differences of their states."""
        self._double.tick(frames_in, elapsed_ticks)
        sent = super().tick(frames_in, elapsed_ticks)
        ours, double = (memory.view(np.float64)[_INDEX] for memory in (self.memory, self._double.memory))
        known = np.isfinite(ours) & np.isfinite(double)
        error = np.abs(np.subtract(ours, double, where=known, out=np.zeros(len(PLACES))))
        np.maximum(self.largest, error, out=self.largest)
        np.maximum(self.range, np.abs(double), where=known, out=self.range)
        self.total += error
        self.ticks += 1
        return sent


class Compared(NamedTuple):
    """The effects of the precision on a scenario.

    `largest` and `average` are the differences of the state's members in open loop, average ones relative to
    the largest value. `mode_ticks` and `impact_ticks` are the distances of each change of mode and each
    impact in double precision from the nearest equal one in single precision, both in closed loop.
    """

    passed: tuple[bool, bool]
    other_checks: list[str]
    largest: dict[str, float]
    average: dict[str, float]
    mode_ticks: list[int]
    impact_ticks: list[int]
    impact_counts: tuple[int, int]


def judged(run_dir: Path) -> tuple[bool, dict[str, bool], Decisions]:
    """Whether a run has passed, the verdicts of its checks, and the decisions of its firmware."""
    traces = read_run(run_dir)
    verdict, results = judge(traces, figures_from(traces), run_dir)
    checks = {result.name: result.passed for result in results}
    return bool(verdict["passed"]), checks, decisions_of(read(run_dir / "firmware.trace"))


def distances(ours: NDArray[np.int64], others: NDArray[np.int64]) -> list[int]:
    """Distance in ticks of each decision from the nearest equal one of the others; -1 if there is none."""
    found = []
    for tick, *what in ours.tolist():
        equal = [abs(other - tick) for other, *its in others.tolist() if its == what]
        found.append(min(equal, default=-1))
    return found


def compared(scenario: Scenario, seed: int) -> Compared:
    """Run a scenario in both precisions."""
    with tempfile.TemporaryDirectory() as folder:
        run_dir, _ = in_lockstep(scenario, Path(folder) / "double", seed, silent, "compiled")
        double_passed, double_checks, double = judged(run_dir)
        Beside.made.clear()
        with patch.object(board_node, "SinglePrecisionBoardNode", Beside):
            run_dir, _ = in_lockstep(scenario, Path(folder) / "single", seed, silent, "cortex-m4f")
        nodes = [node for node in Beside.made if node.ticks > 0]
        single_passed, single_checks, single = judged(run_dir)
    largest = np.max([node.largest for node in nodes], axis=0)
    span = np.max([node.range for node in nodes], axis=0)
    average = np.sum([node.total for node in nodes], axis=0) / sum(node.ticks for node in nodes)
    relative = np.divide(average, span, where=span > 0.0, out=np.zeros(len(PLACES)))
    return Compared(
        (double_passed, single_passed),
        [name for name, passed in double_checks.items() if single_checks[name] != passed],
        dict(zip(PLACES, largest.tolist(), strict=True)),
        dict(zip(PLACES, relative.tolist(), strict=True)),
        distances(double.modes, single.modes),
        distances(double.impacts, single.impacts),
        (len(double.impacts), len(single.impacts)),
    )


def line(found: Compared) -> str:
    """Effect of the precision on a scenario, in a line."""
    open_loop = (
        f"{found.largest[POSITION] * 1e6:.1f} µm, {found.largest[SPEED] * 1e3:.3f} mm/s, "
        f"{found.largest[TORQUE]:.4f} N m"
    )
    verdicts = "the same verdict" if not found.other_checks else f"OTHER: {', '.join(found.other_checks)}"
    if found.passed[0] != found.passed[1]:
        verdicts = f"PASSED {found.passed[0]} in double, {found.passed[1]} in single; {verdicts}"
    closed = [f"{name} {spread(ticks)}" for name, ticks in zip(("modes", "impacts"), found[4:6], strict=True)]
    counts = "" if found.impact_counts[0] == found.impact_counts[1] else f" of {found.impact_counts}"
    return f"{verdicts}; open loop {open_loop}; closed loop {', '.join(closed)}{counts}"


def spread(ticks: Sequence[int]) -> str:
    """Numbers of decisions by their distance in ticks: `12×0 3×1`."""
    return " ".join(f"{ticks.count(off)}×{off}" for off in sorted(set(ticks))) or "none"


def main() -> None:
    """Compare both precisions, print the results, and exit with status 1 if a verdict differs."""
    parser = argparse.ArgumentParser(prog="python -m tools.dev.precision", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    all_found = []
    for name in given.names or scenario_names():
        found = compared(load_scenario(name), given.seed)
        all_found.append(found)
        print(f"{name}: {line(found)}", flush=True)
    average = {name: float(np.median([one.average[name] for one in all_found])) for name in PLACES}
    print(f"members that differ most, on average over a run, median of {len(all_found)} scenarios:")
    for name in sorted(average, key=lambda name: -average[name])[:MOST_SHOWN]:
        print(f"  {name}: {average[name]:.1e} of its largest value")
    others = sum(one.passed[0] != one.passed[1] or bool(one.other_checks) for one in all_found)
    print(f"{len(all_found) - others} of {len(all_found)} scenarios: the same verdict")
    sys.exit(1 if others else 0)


if __name__ == "__main__":
    main()
