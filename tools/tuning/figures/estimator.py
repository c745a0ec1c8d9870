"""Q and R in one picture: the likelihood, the errors, and NIS over the parameters that were tried."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from firmware_py.shell.parameters import DEFAULTS
from tools.tuning.estimator import LARGEST_NIS, MEMORY, NOISE, STOP, Combination
from tools.tuning.result import Tuning


def draw_estimator(tuning: Tuning, points: Sequence[Combination], path: Path) -> None:
    """Draw the combinations that were tried into an SVG, PNG or PDF file."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(17.0, 4.4), layout="constrained")
    grid = figure.subplots(1, 4)
    chosen = {**DEFAULTS, **tuning.values}
    stop_m = chosen[STOP]
    shown = [one for one in points if one.parameters[STOP] == stop_m]
    best = max(one.likelihood for one in points)
    _surface(grid[0], shown, chosen, lambda one: one.likelihood - best, "log-likelihood below the best")
    _surface(grid[1], shown, chosen, lambda one: one.x_to_smoother_mm, "x, RMSE to the smoother [mm]")
    known = bool(np.isfinite([one.x_to_truth_mm for one in shown]).all())
    if known:
        _surface(grid[2], shown, chosen, lambda one: one.x_to_truth_mm, "x, RMSE to the truth [mm]")
    else:
        _surface(grid[2], shown, chosen, lambda one: one.nis_flight, "NIS in flight")
    for memory_s in sorted({one.parameters[MEMORY] for one in points}):
        line = [
            one
            for one in points
            if one.parameters[MEMORY] == memory_s and one.parameters[NOISE] == chosen[NOISE]
        ]
        line.sort(key=lambda one: one.parameters[STOP])
        grid[3].loglog(
            [1e3 * one.parameters[STOP] for one in line],
            [one.nis_stop for one in line],
            "o-",
            label=f"{memory_s:g} s",
        )
    grid[3].axhline(1.0, color="black", lw=0.8)
    grid[3].axhline(LARGEST_NIS, color="black", lw=0.8, ls="--")
    grid[3].set(xlabel="the stop is known to [mm]", title="NIS at the stop, by memory")
    grid[3].legend(fontsize=8)
    grid[3].grid(alpha=0.3, which="both")
    figure.suptitle("square: chosen, diamond: default; the stop known to " + f"{1e3 * stop_m:g} mm")
    figure.savefig(path, dpi=110)


def _surface(
    axes: Any,
    points: Sequence[Combination],
    chosen: dict[str, float],
    what: Callable[[Combination], float],
    title: str,
) -> None:
    """Draw a quantity over the model's memory and the velocity's noise, with its values as numbers."""
    memories = sorted({one.parameters[MEMORY] for one in points})
    noises = sorted({one.parameters[NOISE] for one in points})
    found = {(one.parameters[NOISE], one.parameters[MEMORY]): what(one) for one in points}
    table = np.array([[found[noise, memory] for memory in memories] for noise in noises])
    mesh = axes.imshow(table, origin="lower", aspect="auto", cmap="viridis")
    for (noise, memory), value in found.items():
        axes.text(
            memories.index(memory),
            noises.index(noise),
            f"{value:.3g}",
            ha="center",
            va="center",
            fontsize=8,
            color="white",
            weight="bold",
        )
    axes.set(xlabel="memory of the model's error [s]", ylabel="Q of v by tick [m/s]")
    axes.set_xticks(range(len(memories)), [f"{one:g}" for one in memories])
    axes.set_yticks(range(len(noises)), [f"{one:g}" for one in noises])
    for place, marker, colour in ((chosen, "s", "white"), (DEFAULTS, "D", "tab:red")):
        # A value that is not on the grid lies between its neighbours.
        x = np.interp(np.log(place[MEMORY]), np.log(memories), range(len(memories)))
        y = np.interp(np.log(place[NOISE]), np.log(noises), range(len(noises)))
        axes.plot(x, y, marker, mfc="none", mec=colour, ms=34 if marker == "s" else 26, mew=1.5)
    axes.set_title(title, fontsize=10)
    axes.figure.colorbar(mesh, ax=axes)
