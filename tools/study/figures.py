"""The studies' figures, each as SVG and PNG."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from plant_sim.orbits.sections import Regime
from tools.study.basin import Basin
from tools.study.basin import axes as starts_of
from tools.study.cases import Case
from tools.study.intervals import Interval
from tools.study.portraits import Motion, Pair
from tools.study.sweep import HIGH_RATIO, LOW_RATIO, Diagram, Sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

UP_COLOUR, DOWN_COLOUR = "tab:blue", "tab:orange"
IMPACT_COLOUR, NON_IMPACT_COLOUR, BAND_COLOUR = "#0072b2", "#e4e4e4", "#f2d98c"
NON_IMPACT_LINE_COLOUR, BORDER_COLOUR = "#6b6b6b", "#d55e00"
"""Colours from Okabe and Ito's set, which colour-blind readers can distinguish; the impact regime is blue."""
LAW_NAMES = {"viscous": "viscous", "coulomb": "Coulomb", "stribeck": "Coulomb–Stribeck"}


def new_figure(rows: int, columns: int, width: float, height: float, **options: Any) -> tuple["Figure", Any]:
    """Return a figure and its grid of axes, which is always two-dimensional."""
    import matplotlib
    from matplotlib.figure import Figure

    matplotlib.rcParams.update(
        {"svg.hashsalt": "vibrohil", "font.size": 9, "axes.spines.top": False, "axes.spines.right": False}
    )
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def save(figure: "Figure", folder: Path, name: str) -> list[str]:
    """Write the figure as SVG and PNG and return both paths."""
    folder.mkdir(parents=True, exist_ok=True)
    svg, png = folder / f"{name}.svg", folder / f"{name}.png"
    figure.savefig(svg, metadata={"Date": None})
    figure.savefig(png, dpi=130)
    return [str(svg), str(png)]


def shade(axes: "Axes", bands: Iterable[Interval]) -> None:
    """Mark multistable ratios."""
    for low, high in bands:
        axes.axvspan(low, high, color=BAND_COLOUR, alpha=0.45, lw=0, zorder=0)


def _title(case: Case) -> str:
    value = f"b = {case.b_n_s_m:g} N s/m" if case.law == "viscous" else f"μ = {case.mu:g}"
    return f"{LAW_NAMES[case.law]}, {value}, A = {1e3 * case.amplitude_m:g} mm"


def amplitude_frequency(diagrams: Sequence[Diagram], folder: Path, name: str) -> list[str]:
    """Draw a column for each case: extremes, v⁻, energy and impacts over the ratio, run-up and run-down."""
    figure, grid = new_figure(4, len(diagrams), 1.2 + 4.2 * len(diagrams), 9.5, sharex=True, sharey="row")
    for column, diagram in enumerate(diagrams):
        case = diagram.case
        for axes in grid[:, column]:
            shade(axes, diagram.multistable())
            axes.grid(alpha=0.25)
        for sweep, colour, marker, label in (
            (diagram.up, UP_COLOUR, "^", "run-up"),
            (diagram.down, DOWN_COLOUR, "v", "run-down"),
        ):
            _branches(grid[:, column], case, sweep, colour, marker, label)
        grid[0, column].axhline(1e3 * case.gap_m, color="k", lw=0.8, ls="--")
        grid[0, column].set_title(_title(case), fontsize=10)
        grid[-1, column].set(xlabel="Ω/ω", xlim=(LOW_RATIO, HIGH_RATIO))
    labels = (
        "max, min of x − l0 [mm]",
        "v⁻ at the stop [m/s]",
        "energy per cycle [mJ]",
        "impacts per period",
    )
    for axes, label in zip(grid[:, 0], labels, strict=True):
        axes.set_ylabel(label)
    grid[0, 0].legend(loc="upper right", fontsize=8)
    grid[0, 0].annotate("stop", (0.71, 1e3 * diagrams[0].case.gap_m), va="bottom", fontsize=8)
    grid[2, 0].set_ylim(bottom=0)
    figure.suptitle(
        f"{diagrams[0].case.preset}: amplitude–frequency diagrams, k = {diagrams[0].case.restitution:g}; "
        "multistable ratios shaded",
        fontsize=11,
    )
    return save(figure, folder, name)


def _branches(axes: NDArray[Any], case: Case, sweep: Sweep, colour: str, marker: str, label: str) -> None:
    ratio = sweep.column("ratio")
    style: dict[str, Any] = {"color": colour, "marker": marker, "ms": 2.6, "lw": 0, "mew": 0}
    axes[0].plot(ratio, 1e3 * (sweep.column("x_high_m") - case.rest_length_m), label=label, **style)
    axes[0].plot(ratio, 1e3 * (sweep.column("x_low_m") - case.rest_length_m), **style)
    axes[1].plot(ratio, sweep.column("v_max_m_s"), **style)
    axes[1].plot(ratio, sweep.column("v_min_m_s"), **style)
    axes[2].plot(ratio, 1e3 * sweep.column("drive_j"), **style)
    axes[3].plot(ratio, sweep.column("impacts"), **style)


def regime_bars(diagrams: Sequence[Diagram], folder: Path, name: str) -> list[str]:
    """Draw the ratios with impacts of each case as two bars, run-up above run-down."""
    figure, grid = new_figure(1, 1, 9.0, 0.9 + 0.36 * len(diagrams))
    axes = grid[0, 0]
    for place, diagram in enumerate(diagrams):
        for sweep, colour, shift in ((diagram.up, UP_COLOUR, 0.17), (diagram.down, DOWN_COLOUR, -0.17)):
            axes.barh(-place + shift, HIGH_RATIO - LOW_RATIO, 0.3, left=LOW_RATIO, color=NON_IMPACT_COLOUR)
            for low, high in sweep.with_impacts():
                axes.barh(-place + shift, high - low, 0.3, left=low, color=colour)
        if diagram.onset() is None:
            stuck = set(diagram.up.table["regime"].to_pylist()) == {"stuck"}
            axes.text(
                1.25, -place, "never moves" if stuck else "no impacts", ha="center", va="center", fontsize=8
            )
    axes.set_yticks(
        [-place for place in range(len(diagrams))],
        [f"{diagram.case.preset}, {_title(diagram.case)}" for diagram in diagrams],
    )
    axes.set(
        xlabel="Ω/ω",
        xlim=(LOW_RATIO, HIGH_RATIO),
        title="Where there are impacts: run-up (blue), run-down (orange)",
    )
    axes.axvspan(0.9, 1.1, fill=False, ec="k", lw=0.8, ls=":")
    return save(figure, folder, name)


def basin(found: Basin, caption: str, folder: Path) -> list[str]:
    """Draw a map of starts, coloured by the regime in which they end.

    With a soft start, the starts are outlined that would end in impacts if the crank started at full speed.
    """
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    case, shape = found.case, (found.size, found.size)
    across_m, up = starts_of(case, found.plane, found.size)
    impacts = found.table["impacts"].to_numpy().reshape(shape)
    figure, grid = new_figure(1, 1, 6.4, 5.6)
    axes = grid[0, 0]
    extent = (
        1e3 * (1.5 * across_m[0] - 0.5 * across_m[1]),
        1e3 * (1.5 * across_m[-1] - 0.5 * across_m[-2]),
        1.5 * up[0] - 0.5 * up[1],
        1.5 * up[-1] - 0.5 * up[-2],
    )
    axes.imshow(
        impacts > 0.0,
        origin="lower",
        extent=extent,
        aspect="auto",
        interpolation="nearest",
        cmap=ListedColormap([NON_IMPACT_COLOUR, IMPACT_COLOUR]),
        vmin=0,
        vmax=1,
    )
    ylabel = "v0 [m/s]" if found.plane == "state" else "crank angle at the start θ0 [rad]"
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
    is_soft = found.start == "soft"
    at_once = found.table["instant"].to_numpy(zero_copy_only=False).reshape(shape) if is_soft else impacts
    if is_soft and at_once.any() and not at_once.all():
        axes.contourf(across_m * 1e3, up, at_once, levels=[-0.5, 0.5], hatches=["///"], colors="none")
        axes.contour(across_m * 1e3, up, at_once, levels=[0.5], colors="k", linewidths=1.0)
        handles.append(Patch(fill=False, hatch="///", label="would end without by an instant start"))
    axes.legend(handles=handles, loc="upper left" if is_soft else "lower left", fontsize=8)
    return save(figure, folder, found.name)


REGIME_COLOURS = {
    Regime.NON_IMPACT: NON_IMPACT_COLOUR,
    Regime.IMPACT: IMPACT_COLOUR,
    Regime.PERIOD_N: "#cc79a7",
    Regime.LOST: "#ffffff",
    Regime.CHATTERING: "#56b4e9",
    Regime.STUCK: "#8c8c8c",
    Regime.UNCERTAIN: "#e69f00",
}
"""Colour of each regime in charts."""


def portraits(pairs: Sequence[Pair], folder: Path, name: str) -> list[str]:
    """Draw, in a row for each law, time histories and phase portraits of impact and non-impact motion."""
    figure, grid = new_figure(len(pairs), 4, 15.0, 0.8 + 2.9 * len(pairs))
    for row, both in zip(grid, pairs, strict=True):
        for axes, motion, kind in (
            (row[:2], both.impact, "impact"),
            (row[2:], both.non_impact, "non-impact"),
        ):
            if motion is None:
                for blank in axes:
                    blank.set_axis_off()
                axes[0].set_title(f"{_title(both.case)}\nno {kind} motion", fontsize=9)
                continue
            _portrait(axes, motion, kind)
        extents = [
            axes.get_xlim() for axes, there in ((row[1], both.impact), (row[3], both.non_impact)) if there
        ]
        speeds = [
            axes.get_ylim() for axes, there in ((row[1], both.impact), (row[3], both.non_impact)) if there
        ]
        for axes, there in ((row[1], both.impact), (row[3], both.non_impact)):
            if there:
                axes.set_xlim(min(low for low, _ in extents), max(high for _, high in extents))
                axes.set_ylim(min(low for low, _ in speeds), max(high for _, high in speeds))
    figure.suptitle(
        f"{pairs[0].case.preset}: both motions of each friction law; points: once per drive period, at the "
        "crank's backward dead centre",
        fontsize=11,
    )
    return save(figure, folder, name)


def _portrait(axes: NDArray[Any], motion: Motion, kind: str) -> None:
    case = motion.case
    colour = IMPACT_COLOUR if motion.reaches_stop else NON_IMPACT_LINE_COLOUR
    y_mm = 1e3 * (motion.x_m - case.rest_length_m)
    gap_mm = 1e3 * case.gap_m
    axes[0].plot(motion.t_s, y_mm, color=colour, lw=1.2)
    axes[0].axhline(gap_mm, color="k", lw=0.8, ls="--")
    axes[0].set(xlabel="t [s]", ylabel="x − l0 [mm]", ylim=(-1.7 * gap_mm, 1.15 * gap_mm))
    axes[0].set_title(f"{_title(case)}\n{kind}, Ω/ω = {motion.ratio:g}", fontsize=9)
    axes[1].plot(y_mm, motion.v_m_s, color=colour, lw=1.0)
    axes[1].plot(1e3 * (motion.points[:, 0] - case.rest_length_m), motion.points[:, 1], "k.", ms=5)
    axes[1].axvline(gap_mm, color="k", lw=0.8, ls="--")
    axes[1].set(xlabel="x − l0 [mm]", ylabel="v [m/s]")
    for one in axes:
        one.grid(alpha=0.25)


def chart(
    case: Case,
    label: str,
    ratios: NDArray[np.float64],
    values: NDArray[np.float64],
    reliability: NDArray[np.float64],
    regimes: NDArray[np.int64],
    from_rest: NDArray[np.bool_],
    folder: Path,
    name: str,
) -> list[str]:
    """Draw the start-up reliability with the border of starts from rest, and beside it the regimes."""
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch

    figure, grid = new_figure(1, 2, 12.5, 5.2, sharey=True)
    extent = (ratios[0], ratios[-1], values[0], values[-1])
    shared: dict[str, Any] = {
        "origin": "lower",
        "extent": extent,
        "aspect": "auto",
        "interpolation": "nearest",
    }
    left, right = grid[0]
    image = left.imshow(100.0 * reliability, cmap="Blues", vmin=0.0, vmax=100.0, **shared)
    figure.colorbar(image, ax=left, label="starts that end in impact motion [%]")
    if from_rest.any() and not from_rest.all():
        left.contour(
            ratios, values, from_rest.astype(float), levels=[0.5], colors=BORDER_COLOUR, linewidths=1.6
        )
    left.set(xlabel="Ω/ω", ylabel=label, title="start-up reliability; orange line: from rest at once")
    colours = ListedColormap([REGIME_COLOURS[regime] for regime in Regime])
    edges = BoundaryNorm(np.arange(len(Regime) + 1) - 0.5, len(Regime))
    right.imshow(regimes, cmap=colours, norm=edges, **shared)
    seen = [regime for regime in Regime if (regimes == regime).any()]
    handles = [
        Patch(
            facecolor=REGIME_COLOURS[one],
            edgecolor=NON_IMPACT_LINE_COLOUR,
            linewidth=0.5,
            label=one.name.lower().replace("_", "-"),
        )
        for one in seen
    ]
    right.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, frameon=False)
    right.set(xlabel="Ω/ω", title="regime (of impact, where any start ends so)")
    figure.suptitle(
        f"{case.preset}, {_title(case)}, k = {case.restitution:g}, but for what the axes vary", fontsize=10
    )
    return save(figure, folder, name)
