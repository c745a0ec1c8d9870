"""The studies' figures, each as SVG and PNG."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tools import plots
from tools.study.basin import Basin
from tools.study.basin import axes as starts_of
from tools.study.branches.saddle import Portrait
from tools.study.cases import Case
from tools.study.portraits import Motion
from tools.study.sweep import HIGH_RATIO, LOW_RATIO, Diagram

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

UP_COLOUR, DOWN_COLOUR = "tab:blue", "tab:orange"
IMPACT_COLOUR, NON_IMPACT_COLOUR, BAND_COLOUR = "#0072b2", "#e4e4e4", "#f2d98c"
NON_IMPACT_LINE_COLOUR, BORDER_COLOUR = "#6b6b6b", "#d55e00"
"""Colours from Okabe and Ito's set, which colour-blind readers can distinguish; the impact regime is blue."""

SWEPT = (
    ("max, min of x [mm]", 1e3, ("x_high_m", "x_low_m")),
    ("v⁻ at the stop [m/s]", 1.0, ("v_max_m_s", "v_min_m_s")),
    ("energy per cycle [mJ]", 1e3, ("drive_j",)),
    ("impacts per period", 1.0, ("impacts",)),
)
"""Rows of an amplitude–frequency diagram: label, scale, and columns of a sweep."""


def new_figure(rows: int, columns: int, width: float, height: float, **options: Any) -> tuple["Figure", Any]:
    """Return a figure and its grid of axes, which is always two-dimensional."""
    from matplotlib.figure import Figure

    plots.use_style()
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def save(figure: "Figure", folder: Path, name: str) -> list[str]:
    """Write the figure as SVG and PNG and return both paths."""
    folder.mkdir(parents=True, exist_ok=True)
    svg, png = folder / f"{name}.svg", folder / f"{name}.png"
    plots.save(figure, svg, 110)
    plots.save(figure, png, 130)
    return [str(svg), str(png)]


def _title(case: Case) -> str:
    return f"{case.label}, A = {1e3 * case.amplitude_m:g} mm"


def amplitude_frequency(diagrams: Sequence[Diagram], folder: Path, file_name: str) -> list[str]:
    """Draw a column for each case: extremes, v⁻, energy and impacts over the ratio, run-up and run-down."""
    figure, grid = new_figure(
        len(SWEPT), len(diagrams), 1.2 + 4.2 * len(diagrams), 9.5, sharex=True, sharey="row"
    )
    for column, diagram in enumerate(diagrams):
        case = diagram.case
        for axes in grid[:, column]:
            for low, high in diagram.multistable():
                axes.axvspan(low, high, color=BAND_COLOUR, alpha=0.45, lw=0, zorder=0)
        for sweep, colour, marker, label in (
            (diagram.up, UP_COLOUR, "^", "run-up"),
            (diagram.down, DOWN_COLOUR, "v", "run-down"),
        ):
            style: dict[str, Any] = {"color": colour, "marker": marker, "ms": 2.6, "lw": 0, "mew": 0}
            for axes, (_, scale, names) in zip(grid[:, column], SWEPT, strict=True):
                for name in names:
                    axes.plot(sweep.column("ratio"), scale * sweep.column(name), **style)
            grid[0, column].plot([], [], label=label, **style)
        grid[0, column].axhline(1e3 * case.stop_m, color="k", lw=0.8, ls="--")
        grid[0, column].set_title(_title(case), fontsize=10)
        grid[-1, column].set(xlabel="Ω/ω", xlim=(LOW_RATIO, HIGH_RATIO))
    for axes, (label, _, _) in zip(grid[:, 0], SWEPT, strict=True):
        axes.set_ylabel(label)
    grid[0, 0].legend(loc="upper right", fontsize=8)
    grid[0, 0].annotate("stop", (0.71, 1e3 * diagrams[0].case.stop_m), va="bottom", fontsize=8)
    grid[2, 0].set_ylim(bottom=0)
    figure.suptitle(
        f"{diagrams[0].case.preset}: amplitude–frequency diagrams, k = {diagrams[0].case.restitution:g}; "
        "multistable ratios shaded",
        fontsize=11,
    )
    return save(figure, folder, file_name)


def _mark(axes: "Axes", portrait: Portrait) -> list[Any]:
    """Mark rest, attractors and unstable orbits; return the legend's lines."""
    lines = []
    for points, marker, colour, size, label in (
        (np.zeros((1, 2)), "P", "w", 8, "rest"),
        (portrait.attractors, "*", "w", 12, "attractors"),
        (portrait.saddles, "X", BORDER_COLOUR, 9, "unstable orbit"),
    ):
        style: dict[str, Any] = {"ls": "none", "mec": "k", "zorder": 3, "ms": size, "label": label}
        if len(points):
            lines += axes.plot(1e3 * points[:, 0], points[:, 1], marker, color=colour, **style)
    return lines


def basin(found: Basin, folder: Path, portrait: Portrait | None = None) -> list[str]:
    """Draw a map of starts, coloured by the regime in which they end.

    `portrait`: attractors and unstable orbits, to mark in the plane of states.
    """
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    case, reaches_stop = found.case, found.impacts > 0.0
    across_m, up = starts_of(case, found.plane, found.size)
    figure, grid = new_figure(1, 1, 6.4, 5.6)
    axes = grid[0, 0]
    axes.grid(visible=False)
    extent = (
        1e3 * (1.5 * across_m[0] - 0.5 * across_m[1]),
        1e3 * (1.5 * across_m[-1] - 0.5 * across_m[-2]),
        1.5 * up[0] - 0.5 * up[1],
        1.5 * up[-1] - 0.5 * up[-2],
    )
    axes.imshow(
        reaches_stop,
        origin="lower",
        extent=extent,
        aspect="auto",
        interpolation="nearest",
        cmap=ListedColormap([NON_IMPACT_COLOUR, IMPACT_COLOUR]),
        vmin=0,
        vmax=1,
    )
    ylabel = "v0 [m/s]" if found.plane == "state" else "crank angle at the start θ0 [rad]"
    share, exponent = (found.statistics[name] for name in ("impact_fraction", "uncertainty_exponent"))
    caption = f"{100 * share:.1f} % end in impacts, uncertainty exponent {exponent:.3f}"
    axes.set(
        xlabel="x0 − l0 [mm]",
        ylabel=ylabel,
        title=f"{case.preset}, {_title(case)}, Ω/ω = {found.ratio:g}\n{caption}",
    )
    axes.title.set_fontsize(9)
    handles = [
        Patch(color=IMPACT_COLOUR, label="ends in impact motion"),
        Patch(color=NON_IMPACT_COLOUR, label="ends without"),
    ]
    if portrait is not None:
        handles += _mark(axes, portrait)
        if len(portrait.saddles):
            style = {"colors": BORDER_COLOUR, "linewidths": 1.5}
            axes.contour(1e3 * across_m, up, reaches_stop, levels=[0.5], **style)
            manifold = "its stable manifold, the border"
            handles += axes.plot([], [], color=BORDER_COLOUR, lw=1.5, label=manifold)
    axes.legend(handles=handles, loc="lower left", fontsize=8)
    return save(figure, folder, found.name)


def portraits(pairs: Sequence[tuple[Motion, Motion]], folder: Path, name: str) -> list[str]:
    """Draw, in a row for each law, time histories and phase portraits of impact and non-impact motion."""
    figure, grid = new_figure(len(pairs), 4, 15.0, 0.8 + 2.9 * len(pairs))
    for row, (impact, non_impact) in zip(grid, pairs, strict=True):
        row[3].sharex(row[1])
        row[3].sharey(row[1])
        _portrait(row[:2], impact, "impact")
        _portrait(row[2:], non_impact, "non-impact")
    figure.suptitle(
        f"{pairs[0][0].case.preset}: both motions of each friction law; points: once per drive period, at "
        "the crank's backward dead centre",
        fontsize=11,
    )
    return save(figure, folder, name)


def _portrait(axes: NDArray[Any], motion: Motion, kind: str) -> None:
    case = motion.case
    colour = IMPACT_COLOUR if kind == "impact" else NON_IMPACT_LINE_COLOUR
    samples, points = motion.samples, motion.points
    y_mm = 1e3 * (samples.x_m - case.rest_length_m)
    gap_mm = 1e3 * case.gap_m
    axes[0].plot(samples.t_s, y_mm, color=colour, lw=1.2)
    axes[0].axhline(gap_mm, color="k", lw=0.8, ls="--")
    axes[0].set(xlabel="t [s]", ylabel="x − l0 [mm]", ylim=(-1.7 * gap_mm, 1.15 * gap_mm))
    axes[0].set_title(f"{_title(case)}\n{kind}, Ω/ω = {motion.ratio:g}", fontsize=9)
    axes[1].plot(y_mm, samples.v_m_s, color=colour, lw=1.0)
    axes[1].plot(1e3 * (points.x_m - case.rest_length_m), points.v_m_s, "k.", ms=5)
    axes[1].axvline(gap_mm, color="k", lw=0.8, ls="--")
    axes[1].set(xlabel="x − l0 [mm]", ylabel="v [m/s]")
