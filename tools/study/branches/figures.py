"""Figures of branches and boundaries, each as SVG and PNG."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tools.study.branches.boundaries import Boundary
from tools.study.branches.branches import Branch
from tools.study.branches.parameters import PARAMETERS
from tools.study.figures import (
    BORDER_COLOUR,
    IMPACT_COLOUR,
    NON_IMPACT_LINE_COLOUR,
    new_figure,
    save,
)

if TYPE_CHECKING:
    from matplotlib.lines import Line2D

LABELS = {
    "ratio": "r = Ω/ω",
    "gap": "gap [mm]",
    "mu": "coefficient of friction μ",
    "b": "viscous coefficient b [N s/m]",
    "amplitude": "amplitude A [mm]",
    "restitution": "restitution k",
}
COLOURS = (IMPACT_COLOUR, "#009e73", "#cc79a7", "#e69f00")
"""Of the kinds of orbits n/m in one figure."""
MARKERS = {"fold": "o", "period-doubling": "s", "grazing": "^", "stick": "x"}
LINES = {
    "fold": {"color": IMPACT_COLOUR, "ls": "-"},
    "grazing": {"color": BORDER_COLOUR, "ls": "--"},
    "period-doubling": {"color": NON_IMPACT_LINE_COLOUR, "ls": ":"},
}


def scale(values: Any, name: str) -> Any:
    """A parameter's values in the unit of its axis: lengths in mm."""
    return np.asarray(values) * (1e3 if PARAMETERS[name].unit == "m" else 1.0)


def branch_figure(found: Sequence[Branch], nominal: float, folder: Path, name: str) -> list[str]:
    """Draw v⁻ and the largest multiplier over the parameter; unstable orbits are dashed."""
    over = found[0].over if found else "ratio"
    figure, grid = new_figure(2, 1, 7.5, 7.0, sharex=True, height_ratios=(2, 1))
    speeds, growth = grid[:, 0]
    kinds = list(dict.fromkeys((branch.turns, branch.impacts) for branch in found))
    labelled: set[str] = set()
    for branch in found:
        colour = COLOURS[kinds.index((branch.turns, branch.impacts)) % len(COLOURS)]
        sizes = np.array([[np.max(np.abs(orbit.multipliers))] for orbit in branch.orbits])
        for stable, style in ((True, "-"), (False, "--")):
            at, v_m_s = _pieces(branch, np.array([orbit.v_m_s for orbit in branch.orbits]), stable)
            curves = speeds.plot(scale(at, over), v_m_s, style, color=colour, lw=1.6)
            at, size = _pieces(branch, sizes, stable)
            growth.plot(scale(at, over), size, style, color=colour, lw=1.6)
            if np.any(np.isfinite(at)):
                stability = "stable" if stable else "unstable"
                _label(curves[0], f"{branch.turns}/{branch.impacts}, {stability}", labelled)
        for kind, marker in MARKERS.items():
            special = [one.orbit for one in branch.special if one.kind == kind]
            if special:
                values = [(orbit.values[over], v) for orbit in special for v in orbit.v_m_s]
                at, v_m_s = np.array(values).T
                points = speeds.plot(scale(at, over), v_m_s, marker, color=BORDER_COLOUR, ms=6)
                _label(points[0], kind.replace("-", " "), labelled)
    growth.set(yscale="log", ylim=(1e-1, 3e1), ylabel="largest |multiplier|", xlabel=LABELS[over])
    growth.axhline(1.0, color="k", lw=0.8)
    speeds.set(ylabel="approach speed v⁻ at the stop [m/s]", ylim=(0.0, None))
    for axes in (speeds, growth):
        axes.axvline(scale(nominal, over), color="k", lw=0.6, ls=":")
    if labelled:
        speeds.legend(loc="best", fontsize=8)
    speeds.set_title("impact orbits: turns of the crank / impacts")
    return save(figure, folder, name)


def _label(line: "Line2D", label: str, labelled: set[str]) -> None:
    """Label a line for the legend unless another one has this label."""
    if label not in labelled:
        line.set_label(label)
        labelled.add(label)


def boundary_figure(
    curves: Sequence[Boundary], over: tuple[str, str], nominal: tuple[float, float], folder: Path, name: str
) -> list[str]:
    """Draw the boundaries over two parameters, and the scene."""
    first, second = over
    figure, grid = new_figure(1, 1, 7.0, 5.5)
    axes = grid[0, 0]
    for place, curve in enumerate(curves):
        seen = curve.kind in {one.kind for one in curves[:place]}
        axes.plot(
            scale(curve.values(first), first),
            scale(curve.values(second), second),
            lw=1.6,
            label=None if seen else curve.kind.replace("-", " "),
            **LINES[curve.kind],
        )
    axes.plot(scale(nominal[0], first), scale(nominal[1], second), "k*", ms=10, label="the scene")
    axes.set(xlabel=LABELS[first], ylabel=LABELS[second])
    axes.set_ylim(scale(max(PARAMETERS[second].low, 0.0), second), None)
    axes.legend(loc="best", fontsize=8)
    return save(figure, folder, name)


def _pieces(
    branch: Branch, values: NDArray[np.float64], stable: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The parameter and values of the orbits of one stability, nan elsewhere; pieces meet."""
    where_it_changes = {id(one.orbit) for one in branch.special if one.kind in ("fold", "period-doubling")}
    drawn = np.array(
        [orbit.is_stable == stable or id(orbit) in where_it_changes for orbit in branch.orbits], np.bool_
    )
    at = np.array([orbit.values[branch.over] for orbit in branch.orbits])
    return np.where(drawn, at, np.nan), np.where(drawn[:, None], values, np.nan)
