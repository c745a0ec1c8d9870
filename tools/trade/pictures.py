"""The Pareto plot: error over cost, one panel for each case."""

from collections.abc import Sequence
from pathlib import Path

from tools.plots import drawn
from tools.trade.costs import Cost, pareto

STYLES = {
    "exact": ("tab:green", "*"),
    "adaptive": ("tab:blue", "o"),
    "stepping": ("tab:orange", "s"),
    "heyoka": ("tab:red", "D"),
    "scipy DOP853": ("tab:purple", "^"),
    "scipy RK45": ("tab:gray", "v"),
}

SMALLEST_M = 1e-15
"""Smallest error in the plot, m; smaller errors are drawn at this value."""


def draw(measured: Sequence[Cost], path: Path) -> None:
    """Draw all cases into an SVG or PNG; hollow markers show a wrong number of impacts."""
    from matplotlib.lines import Line2D

    cases = list(dict.fromkeys(each.case for each in measured))
    best = pareto(measured)
    columns = min(3, len(cases))
    rows = -(-len(cases) // columns)
    with drawn(path, 4.6 * columns, 3.5 * rows + 0.6) as figure:
        grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
        for axes, case in zip(grid.flat, cases, strict=False):
            mine = sorted((each for each in measured if each.case is case), key=lambda each: each.least_us_s)
            for method, (colour, marker) in STYLES.items():
                chosen = [each for each in mine if each.method.name == method]
                axes.plot(*points(chosen), "-", color=colour, lw=0.8, alpha=0.6)
                for each in chosen:
                    face = colour if each.is_right else "none"
                    size = 9 if marker == "*" else 6
                    axes.plot(*points([each]), marker, color=colour, mfc=face, ms=size)
            front = [each for each in mine if each in best]
            axes.step(*points(front), where="post", color="black", lw=1.0, ls=":")
            axes.set(xscale="log", yscale="log", title=case.name)
        for axes in list(grid.flat)[len(cases) :]:
            axes.axis("off")
        for axes in grid[-1]:
            axes.set_xlabel("cost [µs per simulated second]")
        for axes in grid[:, 0]:
            axes.set_ylabel("state error at the end [m]")
        handles = [
            Line2D([], [], color=colour, marker=marker, ls="-", lw=0.8, label=method)
            for method, (colour, marker) in STYLES.items()
        ]
        handles.append(Line2D([], [], color="gray", marker="o", mfc="none", ls="", label="wrong impacts"))
        handles.append(Line2D([], [], color="black", ls=":", label="cheapest for its error"))
        figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False)


def points(costs: Sequence[Cost]) -> tuple[list[float], list[float]]:
    """Return the costs and the errors, at least SMALLEST_M."""
    errors = [max(each.errors.error, SMALLEST_M) for each in costs]
    return [each.least_us_s for each in costs], errors
