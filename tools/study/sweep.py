"""Amplitude–frequency diagrams: run-up and run-down by the paper's protocol, and the ends of the impacts.

Each ratio starts from the final state of the previous ratio, including the crank angle. Where impacts begin
or end, the attractor is then followed in decreasing steps until a step is below EDGE_STEP.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from tools.study import work
from tools.study.cases import Case
from tools.study.orbits import AT_REST, PAPER, Outcome, Protocol, State, follow

LOW_RATIO, HIGH_RATIO, RATIOS = 0.7, 1.8, 111
"""The paper's range of ratios, in steps of 0.01."""

EDGE_STEP = 1e-5
"""Last step of a continuation, in r; at smaller steps the slow passage beyond a fold outlasts CONTINUE."""

CONTINUE = Protocol(settle_s=280.0, record_s=20.0, tolerance=1e-6)
"""Protocol of a continuation: near a fold a motion settles slowly, and a transient would graze too early."""

COLUMNS = tuple(name for name in Outcome._fields if name not in ("regime", "end"))
"""The columns of a sweep from an orbit's outcome, beside its regime."""


Interval = tuple[float, float]
"""A closed interval of the ratio r; those of a union are ascending and disjoint."""


def contains(union: list[Interval], value: float) -> bool:
    """Return whether one of the intervals contains the value."""
    return any(low <= value <= high for low, high in union)


def symmetric_difference(one: list[Interval], other: list[Interval]) -> list[Interval]:
    """Return the intervals that belong to exactly one of the two unions.

    >>> symmetric_difference([(0.8, 1.4)], [(0.7, 1.1)])
    [(0.7, 0.8), (1.1, 1.4)]
    """
    cuts = sorted({cut for union in (one, other) for interval in union for cut in interval})
    found: list[Interval] = []
    for low, high in pairwise(cuts):
        middle = 0.5 * (low + high)
        if contains(one, middle) != contains(other, middle):
            adjoins = bool(found) and found[-1][1] == low
            found.append((found.pop()[0] if adjoins else low, high))
    return found


def width(union: list[Interval]) -> float:
    """Return the total length of the intervals."""
    return sum(high - low for low, high in union)


@dataclass(frozen=True)
class Sweep:
    """A run-up or a run-down: a row for each ratio, and the ratios at which impacts begin or end.

    An edge may lie before the sweep's last ratio with impacts if the impacts decay too slowly to end within
    the run.
    """

    rows: list[dict[str, Any]]
    edges: list[float]

    def column(self, name: str) -> NDArray[Any]:
        """Return a column as an array."""
        return np.array([row[name] for row in self.rows])

    def with_impacts(self) -> list[Interval]:
        """Return the intervals of r with impacts, bounded by the edges or by the sweep's ends."""
        grid, reaches_stop = self.column("ratio"), self.column("impacts") > 0.0
        cuts = [float(grid[0]), *self.edges, float(grid[-1])]
        found, on = [], bool(reaches_stop[0])
        for start, end in pairwise(cuts):
            if on:
                found.append((min(start, end), max(start, end)))
            on = not on
        return sorted(found)

    def at(self, ratio: float) -> dict[str, Any]:
        """Return the row nearest to a ratio."""
        return min(self.rows, key=lambda row: abs(float(row["ratio"]) - ratio))

    def state_at(self, ratio: float) -> State:
        """Return the final state of the orbit nearest to a ratio."""
        row = self.at(ratio)
        return State(*(row[f"end_{name}"] for name in State._fields))


@dataclass(frozen=True)
class Diagram:
    """Run-up and run-down of one case."""

    case: Case
    up: Sweep
    down: Sweep

    def multistable(self) -> list[Interval]:
        """Return the intervals of r in which only one of run-up and run-down has impacts."""
        return symmetric_difference(self.up.with_impacts(), self.down.with_impacts())

    def widest_multistable(self) -> Interval | None:
        """Return the widest interval with two motions; None if there is none."""
        return max(self.multistable(), key=lambda interval: interval[1] - interval[0], default=None)

    def two_motions_r(self) -> float:
        """Return the middle of the widest interval with two motions, to 0.01; ValueError without one."""
        band = self.widest_multistable()
        if band is None:
            raise ValueError(f"{self.case.preset}, {self.case.label}: no ratio has two motions")
        return round(0.5 * (band[0] + band[1]), 2)

    def onset(self) -> float | None:
        """Return the lowest ratio at which the run-up has impacts; None if it has none."""
        return min((low for low, _ in self.up.with_impacts()), default=None)

    def as_json(self) -> dict[str, Any]:
        """Return the diagram as a JSON object."""
        return {
            "law": self.case.law,
            "preset": self.case.preset,
            "parameters": self.case.parameters(),
            "up_r": self.up.with_impacts(),
            "down_r": self.down.with_impacts(),
            "multistable_r": self.multistable(),
        }


def diagrams(cases: Sequence[Case], where: work.Where, count: int = RATIOS) -> list[Diagram]:
    """Compute the run-up and the run-down of every case, and write each as one file."""
    tasks = [(case, direction, count) for case in cases for direction in ("up", "down")]
    sweeps = [Sweep(**found) for found in work.run("sweep", piece, tasks, where)]
    for (case, direction, _), sweep in zip(tasks, sweeps, strict=True):
        work.write_table(
            where.out / f"sweep-{case.name}-{direction}.parquet",
            pa.Table.from_pylist(sweep.rows),
            case.parameters(),
        )
    return [Diagram(*one) for one in zip(cases, sweeps[::2], sweeps[1::2], strict=True)]


def piece(task: tuple[Case, str, int]) -> dict[str, Any]:
    """Compute the sweep of a case, up or down over a number of ratios: a row for each, and its edges."""
    return asdict(run(*task))


def ratios(direction: str, count: int = RATIOS) -> NDArray[np.float64]:
    """Return the ratios in the order of the sweep."""
    grid = np.round(np.linspace(LOW_RATIO, HIGH_RATIO, count), 12)
    return grid if direction == "up" else grid[::-1].copy()


def run(case: Case, direction: str, count: int = RATIOS) -> Sweep:
    """Run a sweep by the paper's protocol; each ratio starts from the final state of the previous ratio."""
    grid = ratios(direction, count)
    outcomes: list[Outcome] = []
    edges: list[float] = []
    for index, outcome in enumerate(follow_on(case, grid, PAPER)):
        if outcomes and (outcome.impacts > 0.0) != (outcomes[-1].impacts > 0.0):
            edges.append(_edge(case, grid[: index + 1], outcomes))
        outcomes.append(outcome)
    rows = [row_of(ratio, outcome) for ratio, outcome in zip(grid, outcomes, strict=True)]
    return Sweep(rows, edges)


def follow_on(case: Case, ratios: Iterable[float], protocol: Protocol) -> Iterator[Outcome]:
    """Follow the motion from rest over successive ratios, each from the final state of the previous one."""
    state = AT_REST
    for ratio in ratios:
        outcome = follow(case.scene(float(ratio)), state, protocol)
        yield outcome
        state = outcome.end


def row_of(ratio: float, outcome: Outcome) -> dict[str, Any]:
    """Return an orbit's row of a table."""
    regime = outcome.regime.name.lower().replace("_", "-")
    values = {name: getattr(outcome, name) for name in COLUMNS}
    end = {f"end_{name}": value for name, value in outcome.end._asdict().items()}
    return {"ratio": float(ratio), "regime": regime, **values, **end}


def _edge(case: Case, grid: NDArray[np.float64], outcomes: Sequence[Outcome]) -> float:
    """Follow the motion from a ratio before the last one of `grid` until its impacts end or begin."""
    reaches_stop = outcomes[-1].impacts > 0.0
    for index in range(len(grid) - 2, -1, -1):
        ratio, beyond, before = float(grid[index]), float(grid[index + 1]), outcomes[index]
        last = follow(case.scene(ratio), before.end, CONTINUE)
        if (last.impacts > 0.0) == reaches_stop:
            break
    step = 0.5 * (beyond - ratio)
    while abs(step) > EDGE_STEP:
        trial = follow(case.scene(ratio + step), last.end, CONTINUE)
        if (trial.impacts > 0.0) == reaches_stop:
            ratio, last = ratio + step, trial
        else:
            step *= 0.5
    return ratio
