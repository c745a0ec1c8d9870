"""Subharmonic orbits: one impact in n turns, on a standing leg with a rigid stop."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from plant_sim.orbits.sections import CLASSIFY, Outcome
from tools.study import store, work
from tools.study.cases import Case, case
from tools.study.orbits import State, follow

GAPS_OVER_AMPLITUDE = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 10.0)
RATIOS = tuple(np.round(np.arange(0.5, 8.001, 0.02), 3).tolist())
STARTS = 24
LONG = CLASSIFY._replace(settle_s=150.0)
ORBIT_COLUMNS = store.columns("gap_over_amplitude ratio turns share v_share", counts="turns")


def once_in(cycle: int, impacts: float) -> int:
    """Return the orbit's number of turns if it is at least 2 and has one impact in all; else 0."""
    return cycle if cycle > 1 and abs(impacts * cycle - 1.0) < 1e-6 else 0


def sampled_start(unit: Case, dice: np.random.Generator) -> State:
    """Sample an initial state within the range of motion of a striker with this gap."""
    y_m = dice.uniform(-1.5, 1.0) * unit.gap_m
    v_m_s = dice.uniform(-1.2, 1.2) * unit.gap_m * unit.natural_rad_s
    return State(float(y_m), float(v_m_s), float(dice.uniform(0.0, 2.0 * math.pi)))


def found_orbit(unit: Case, ratio: float, turns: int) -> Outcome | None:
    """Return the first orbit of 200 starts with one impact in this number of turns; None if there is none."""
    dice = np.random.default_rng(1)
    for _ in range(200):
        orbit = follow(unit, ratio, sampled_start(unit, dice), LONG)
        if orbit.certain and once_in(orbit.cycle, orbit.impacts) == turns:
            return orbit
    return None


def orbit_piece(spec: Mapping[str, Any]) -> tuple[pa.Table, dict[str, Any]]:
    """Compute, for one gap and all ratios, the share of starts that end in one impact in n turns."""
    over = spec["gap_over_amplitude"]
    unit = case("table1", "viscous", amplitude_m=0.06 / over)
    dice = np.random.default_rng([1, round(100 * over)])
    rows = []
    for ratio in spec["ratios"]:
        found: dict[int, list[float]] = {}
        for _ in range(STARTS):
            orbit = follow(unit, ratio, sampled_start(unit, dice), LONG)
            turns = once_in(orbit.cycle, orbit.impacts) if orbit.certain else 0
            if turns:
                found.setdefault(turns, []).append(orbit.v_mean_m_s / (unit.natural_rad_s * unit.gap_m))
        rows += [
            {
                "gap_over_amplitude": over,
                "ratio": ratio,
                "turns": turns,
                "share": len(speeds) / STARTS,
                "v_share": float(np.mean(speeds)),
            }
            for turns, speeds in sorted(found.items())
        ]
    return pa.Table.from_pylist(rows, schema=ORBIT_COLUMNS), {}


def orbits_found(where: work.Where) -> pa.Table:
    """Compute the subharmonic orbits with viscous friction (ζ = 0.013) over gap and ratio."""
    specs = [{"gap_over_amplitude": over, "ratios": list(RATIOS)} for over in GAPS_OVER_AMPLITUDE]
    paths = work.run("pulse-orbits", orbit_piece, specs, where)
    return pa.concat_tables([store.read(path)[0] for path in paths])


class Band(NamedTuple):
    """A range of ratios in which orbits have one impact in `turns` turns."""

    turns: int
    gap_over_amplitude: float
    low: float
    high: float
    share: float
    v_share: float

    @property
    def width(self) -> float:
        """Half the width of the range relative to its middle: the largest relative error of a cadence."""
        return (self.high - self.low) / (self.high + self.low)


def bands_of(orbits: Sequence[Mapping[str, Any]]) -> list[Band]:
    """Join neighbouring ratios with the same number of turns into bands; single ratios are left out."""
    step = 1.5 * (RATIOS[1] - RATIOS[0])
    found: list[list[Mapping[str, Any]]] = []
    for row in sorted(orbits, key=lambda one: (one["turns"], one["gap_over_amplitude"], one["ratio"])):
        before = found[-1][-1] if found else None
        if (
            before is not None
            and (before["turns"], before["gap_over_amplitude"]) == (row["turns"], row["gap_over_amplitude"])
            and row["ratio"] - before["ratio"] < step
        ):
            found[-1].append(row)
        else:
            found.append([row])
    return [
        Band(
            rows[0]["turns"],
            rows[0]["gap_over_amplitude"],
            rows[0]["ratio"],
            rows[-1]["ratio"],
            float(np.mean([row["share"] for row in rows])),
            float(np.mean([row["v_share"] for row in rows])),
        )
        for rows in found
        if len(rows) > 1
    ]
