"""Basins of attraction: the starts that end in impact motion, and the smoothness of the basins' border.

A map is in one of two planes: (x0, v0) at crank angle 0, or (x0, crank angle) at v0 = 0. Its figures are:

- uncertainty exponent α (McDonald, Grebogi, Ott, Yorke, Physica D 17, 1985): the share of cells with a cell
  of the other kind at distance ε grows as ε^α; α = 1 is a smooth border, α < 1 a fractal border;
- basin entropy (Daza, Wagemakers, Georgeot, Guéry-Odelin, Sanjuán, Scientific Reports 6, 2016): mean entropy
  of all boxes of cells, and of the boxes on the border; if the latter is above ln 2, the border is fractal;
- basin stability: the share of starts that end in impacts, with bounds from a bootstrap over blocks of cells,
  which allows for the correlation of neighbouring cells.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from tools.study import work
from tools.study.cases import Case
from tools.study.orbits import classify

PLANES = ("state", "phase")

LOWEST_START_M = -0.1
FASTEST_START_M_S = 0.8
"""Range of starts about the rest length, as wide as the module's motion; speeds are table1's, scaled by ω."""

ROWS_AT_ONCE = 25
"""Number of rows of the map in a piece of work."""

RESAMPLES = 400
BLOCK = 10
FARTHEST = 16
"""Largest distance for the uncertainty exponent, in cells; within it a curved border is nearly straight."""

SMALLEST_FOR_EXPONENT = 36
"""Fewest cells along a side for the exponent, which needs three distances up to a twelfth of the side."""

BOX = 5
"""Number of cells along the side of an entropy box."""


def axes(case: Case, plane: str, size: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the cell centres: positions less rest length (columns), and speeds or crank angles (rows)."""
    centres = (np.arange(size) + 0.5) / size
    y_m = LOWEST_START_M + centres * (case.gap_m - LOWEST_START_M)
    if plane == "phase":
        return y_m, centres * 2.0 * math.pi
    fastest = FASTEST_START_M_S * case.natural_rad_s / math.sqrt(70.0 / 0.8)
    return y_m, -fastest + centres * 2.0 * fastest


@dataclass(frozen=True)
class Basin:
    """A map: the cycle (0: none) and the impacts a turn of each cell, both of shape (size, size).

    The last turns decide for a cell whose impacts did not repeat by the end of the run.
    """

    case: Case
    ratio: float
    plane: str
    cycles: NDArray[np.int64]
    impacts: NDArray[np.float64]

    @property
    def size(self) -> int:
        """Number of cells along a side."""
        return len(self.impacts)

    @cached_property
    def statistics(self) -> dict[str, Any]:
        """The figures of the map."""
        return statistics(self.impacts > 0.0)

    @property
    def name(self) -> str:
        """Name of the map's files."""
        return f"basin-{self.case.name}-r{self.ratio:.12g}-{self.plane}-{self.size}"

    def as_json(self) -> dict[str, Any]:
        """Return the basin's parameters and figures as a JSON object."""
        return {
            "law": self.case.law,
            "preset": self.case.preset,
            "parameters": self.case.parameters(),
            "ratio": self.ratio,
            "plane": self.plane,
            "size": self.size,
            "uncertain": int((self.cycles == 0).sum()),
            **self.statistics,
        }


class Rows(NamedTuple):
    """Rows of a map to compute: `first` to `last` − 1."""

    case: Case
    ratio: float
    plane: str
    size: int
    first: int
    last: int


def compute(case: Case, ratio: float, plane: str, size: int, where: work.Where) -> Basin:
    """Compute the whole map and write it as one file."""
    firsts = range(0, size, ROWS_AT_ONCE)
    tasks = [Rows(case, ratio, plane, size, first, min(first + ROWS_AT_ONCE, size)) for first in firsts]
    pieces = work.run(f"basin-{plane}", piece, tasks, where)
    cycles, impacts = (np.concatenate(some).reshape(size, size) for some in zip(*pieces, strict=True))
    found = Basin(case, ratio, plane, cycles, impacts)
    write(found, where.out / f"{found.name}.parquet")
    return found


def write(found: Basin, path: Path) -> None:
    """Write a map as a table with a row for each cell, map row by map row; its metadata has the figures."""
    columns = dict(
        zip(("x_m", "v_m_s", "crank_rad"), starts_of(found.case, found.plane, found.size).T, strict=True)
    )
    columns["x_m"] = columns["x_m"] + found.case.rest_length_m
    table = pa.table({**columns, "cycle": found.cycles.ravel(), "impacts": found.impacts.ravel()})
    work.write_table(path, table, found.as_json())


def starts_of(case: Case, plane: str, size: int, rows: slice = slice(None)) -> NDArray[np.float64]:
    """Return the starts of all cells, map row by map row: position less l0, velocity, crank angle."""
    y_m, other = axes(case, plane, size)
    starts = np.zeros((len(other[rows]) * size, 3))
    starts[:, 0] = np.tile(y_m, len(other[rows]))
    starts[:, 1 if plane == "state" else 2] = np.repeat(other[rows], size)
    return starts


def piece(rows: Rows) -> list[list[Any]]:
    """Compute the cycles and the impacts a turn of some rows of a map."""
    starts = starts_of(rows.case, rows.plane, rows.size, slice(rows.first, rows.last))
    return [found.tolist() for found in classify(rows.case.scene(rows.ratio), starts)]


def statistics(in_impacts: NDArray[np.bool_]) -> dict[str, Any]:
    """Return the figures of a map; `in_impacts` has the shape (rows, columns)."""
    exponent, exponent_bounds = uncertainty_exponent(in_impacts)
    entropy, border = basin_entropy(in_impacts)
    return {
        "impact_fraction": float(in_impacts.mean()),
        "impact_fraction_bootstrap": block_bounds(in_impacts),
        "uncertainty_exponent": exponent,
        "uncertainty_exponent_bounds": exponent_bounds,
        "basin_entropy": entropy,
        "border_entropy": border,
    }


def block_bounds(in_impacts: NDArray[np.bool_]) -> list[float]:
    """Return the 95 % bounds of the share of impact motion by resampling blocks of cells (fixed seed)."""
    if min(in_impacts.shape) < 2 * BLOCK:
        return [math.nan, math.nan]
    shares = block_shares(in_impacts, BLOCK)
    means = np.random.default_rng(1).choice(shares, (RESAMPLES, len(shares))).mean(axis=1)
    return [float(bound) for bound in np.quantile(means, (0.025, 0.975))]


def block_shares(in_impacts: NDArray[np.bool_], side: int) -> NDArray[np.float64]:
    """Return the share of impact motion in each whole block of `side` × `side` cells, row by row."""
    rows, columns = (length // side for length in in_impacts.shape)
    blocks = in_impacts[: rows * side, : columns * side].reshape(rows, side, columns, side)
    shares: NDArray[np.float64] = blocks.mean(axis=(1, 3)).ravel()
    return shares


def uncertain_shares(in_impacts: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return distances in cells, and for each distance and line of the map the share of uncertain cells.

    A cell is uncertain at distance ε if the cell ε before or after it in the line is of the other kind. The
    lines are the rows and columns of the map. Shape of the shares: (distances, lines).
    """
    size = min(in_impacts.shape)
    square = in_impacts[:size, :size]
    lags = np.unique(np.geomspace(1, min(size // 12, FARTHEST), 8).astype(np.int64))
    shares = np.empty((len(lags), 2 * size))
    lines, edge = np.concatenate((square, square.T)), int(lags[-1])
    middle = lines[:, edge : size - edge]
    for place, lag in enumerate(lags):
        left, right = lines[:, edge - lag : size - edge - lag], lines[:, edge + lag : size - edge + lag]
        shares[place] = ((middle != left) | (middle != right)).mean(axis=1)
    return lags, shares


def uncertainty_exponent(in_impacts: NDArray[np.bool_]) -> tuple[float, list[float]]:
    """Return α by least squares in the logarithms, with 95 % bounds by resampling rows and columns.

    All values are NaN if the map is too small for three distances or if no cell is uncertain.
    """
    if min(in_impacts.shape) < SMALLEST_FOR_EXPONENT:
        return math.nan, [math.nan, math.nan]
    lags, shares = uncertain_shares(in_impacts)
    mean = shares.mean(axis=1)
    if not np.all(mean > 0.0):
        return math.nan, [math.nan, math.nan]
    exponent = float(np.polyfit(np.log(lags), np.log(mean), 1)[0])
    chosen = np.random.default_rng(1).integers(0, shares.shape[1], (RESAMPLES, shares.shape[1]))
    resampled = shares[:, chosen].mean(axis=2)
    resampled = resampled[:, np.all(resampled > 0.0, axis=0)]
    slopes = np.polyfit(np.log(lags), np.log(resampled), 1)[0]
    return exponent, [float(bound) for bound in np.quantile(slopes, (0.025, 0.975))]


def basin_entropy(in_impacts: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the mean entropy of all boxes of BOX × BOX cells, and of the boxes with both kinds of cells.

    A mean is nan if there is no such box.
    """
    boxes = block_shares(in_impacts, BOX)
    mixed = boxes[(boxes > 0.0) & (boxes < 1.0)]
    entropies = -(mixed * np.log(mixed) + (1.0 - mixed) * np.log(1.0 - mixed))
    if len(boxes) == 0:
        return math.nan, math.nan
    return float(entropies.sum() / len(boxes)), float(entropies.mean()) if len(mixed) else math.nan
