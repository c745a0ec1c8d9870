"""Maps over the ratio and a second parameter: the regimes, and the share of starts that end in impacts.

Reliability is the share of starts that end in impact motion if the crank starts at full speed. The starts
have positions within ± the gap about the rest length, speeds up to FASTEST_START_M_S (table1's, scaled by ω)
and any crank angle. They are evenly distributed by an additive recurrence (Roberts 2018) and the same for
every cell.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from plant_sim.orbits.sections import CLASSIFY, Regime
from tools.output import BadInputError
from tools.study.cases import STATIC_OVER_SLIDING, Case
from tools.study.orbits import classify
from tools.study.sweep import HIGH_RATIO, LOW_RATIO

FASTEST_START_M_S = 0.5

SETTLE = CLASSIFY._replace(settle_s=100.0, tolerance=1e-5)
"""Coarser protocol than for a basin, because orbits settle slowly near a border between regimes."""

STARTS = 64
"""Number of starts of a cell; the 95 % bounds of a share of 64 are ±12 % at most."""

SECOND = {
    # name: (field of the case, low, high, label)
    "A": ("amplitude_m", 0.004, 0.04, "drive amplitude A [m]"),
    "mu": ("mu", 0.02, 0.35, "friction coefficient μ"),
    "b": ("b_n_s_m", 0.02, 1.0, "viscous coefficient b [N s/m]"),
    "k": ("restitution", 0.2, 0.9, "restitution k"),
}
"""Second parameters of a map; their ranges are a little wider than Table 1's."""

GOLDEN_3D = 1.2207440846057596
"""Root of x⁴ = x + 1; its inverse powers are the recurrence's steps in three dimensions."""


def changed(case: Case, second: str, value: float) -> Case:
    """Return the case with another value of the second parameter."""
    other: Case = replace(case, **{SECOND[second][0]: value})  # type: ignore[arg-type]  # all are floats
    return (
        replace(other, mu_s=STATIC_OVER_SLIDING * value)
        if second == "mu" and case.law == "stribeck"
        else other
    )


def check(case: Case, second: str) -> None:
    """Raise BadInputError if the case's friction law does not have the parameter."""
    if (second == "mu" and case.law == "viscous") or (second == "b" and case.law != "viscous"):
        raise BadInputError(
            f"--over r,{second} with --law {case.law}: that law has no {second}; "
            "use r,b with viscous, r,mu with coulomb or stribeck"
        )


def axes(second: str, size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the ratios and the values of the second parameter, including the ends of their ranges."""
    _, low, high, _ = SECOND[second]
    return np.linspace(LOW_RATIO, HIGH_RATIO, size), np.linspace(low, high, size)


def starts(case: Case) -> NDArray[np.float64]:
    """Return the start at rest with crank angle 0, then evenly distributed starts; shape (STARTS + 1, 3)."""
    steps = GOLDEN_3D ** -np.arange(1.0, 4.0)
    spread = (0.5 + np.outer(np.arange(1.0, STARTS + 1), steps)) % 1.0
    reach = max(case.gap_m, 0.0)
    fastest = FASTEST_START_M_S * case.natural_rad_s / math.sqrt(70.0 / 0.8)
    low = np.array([-reach, -fastest, 0.0])
    high = np.array([reach, fastest, 2.0 * math.pi])
    return np.vstack((np.zeros(3), low + spread * (high - low)))


def specs(case: Case, second: str, size: int) -> list[dict[str, Any]]:
    """Return the specifications of a map's pieces of work, one for each value of the second parameter."""
    ratios, values = axes(second, size)
    return [
        {
            "case": changed(case, second, float(value)).parameters(),
            "ratios": ratios.tolist(),
            "value": float(value),
        }
        for value in values
    ]


def piece(spec: Mapping[str, Any]) -> tuple[pa.Table, dict[str, Any]]:
    """Compute one row of a map."""
    case = Case(**spec["case"])
    begun = starts(case)
    rows = [_cell(case, ratio, begun) for ratio in spec["ratios"]]
    table = pa.table(
        {
            "ratio": spec["ratios"],
            "value": [spec["value"]] * len(rows),
            "reliability": [row[0] for row in rows],
            "from_rest": [row[1] for row in rows],
            "regime": [row[2] for row in rows],
        }
    )
    return table, {"starts": len(begun) - 1}


def _cell(case: Case, ratio: float, begun: NDArray[np.float64]) -> tuple[float, bool, int]:
    """Return the share of starts that end in impacts, whether the start at rest does, and the main regime.

    The main regime is the most frequent; if any start ends in impacts, only regimes with impacts are counted.
    """
    regimes, impacts = classify(case, ratio, begun, SETTLE)
    regimes = np.where(regimes < 0, -1 - regimes, regimes)
    reaches_stop = impacts > 0.0
    kinds: Sequence[int] = regimes[1:][reaches_stop[1:]].tolist() or regimes[1:].tolist()
    return (
        float(reaches_stop[1:].mean()),
        bool(reaches_stop[0]),
        int(np.bincount(kinds, minlength=len(Regime)).argmax()),
    )
