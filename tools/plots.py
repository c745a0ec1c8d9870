"""Plots by matplotlib: a figure written into a file, and the plant alone."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hil.record.new_file import open_anew
from plant_sim.result import SimulationResult
from plant_sim.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLOT_WINDOW_S = 5.0
"""Longest time history, up to the end of the run: some ten periods at the module's frequencies."""


def use_style() -> None:
    """Draw as matplotlib does by default, in our size of text, with a grid, without the upper and right line.

    The defaults come first: some packages change them as they are imported.
    """
    import matplotlib

    matplotlib.rcdefaults()
    matplotlib.rc("svg", hashsalt="vibrohil")
    matplotlib.rc("font", size=9)
    matplotlib.rc("axes", grid=True)
    matplotlib.rc("axes.spines", top=False, right=False)
    matplotlib.rc("grid", alpha=0.3)


@contextmanager
def drawn(path: Path, width: float = 14.0, height: float = 4.4) -> Iterator["Figure"]:
    """A figure of this size in inches, written into an SVG, PNG or PDF file at the end."""
    from matplotlib.figure import Figure

    use_style()
    figure = Figure(figsize=(width, height), layout="constrained")
    yield figure
    save(figure, path, 110)


def save(figure: "Figure", path: Path, dpi: int) -> None:
    """Write a figure into a new SVG, PNG or PDF file."""
    kind = path.suffix.lower().removeprefix(".")
    dated = {"Date": None} if kind == "svg" else None  # the same data give the same file
    with open_anew(path) as file:
        figure.savefig(file, format=kind, dpi=dpi, metadata=dated)


def plot_motion(result: SimulationResult, scene: Scene, path: Path) -> None:
    """Draw position and approach speeds of the last seconds, below each other, and the phase portrait.

    The approach speeds of the whole run are added if it is longer.
    """
    samples = result.samples
    if samples is None:
        raise ValueError("plot_motion needs a result with samples; simulate with samples_s")
    end_s = float(samples.t_s[-1])
    begin_s = max(end_s - PLOT_WINDOW_S, float(samples.t_s[0]))
    is_part = begin_s > float(samples.t_s[0])
    shown = samples.t_s >= begin_s
    t_s, v_m_s = result.impacts.t_s, result.impacts.v_m_s
    late = t_s >= begin_s
    stop_m = getattr(scene.parts().stop, "position_m", np.nan)
    with drawn(path, 12.0, 6.0) as figure:
        corner = "whole" if is_part else "portrait"
        panels = figure.subplot_mosaic([["history", "portrait"], ["impacts", corner]], width_ratios=(3, 2))
        history, impacts, portrait = panels["history"], panels["impacts"], panels["portrait"]
        history.sharex(impacts)
        history.plot(samples.t_s[shown], 1e3 * samples.x_m[shown], lw=1.2)
        portrait.plot(1e3 * samples.x_m[shown], samples.v_m_s[shown], lw=0.8)
        if np.isfinite(stop_m):
            history.axhline(1e3 * stop_m, color="tab:red", lw=1, ls="--", label="stop")
            portrait.axvline(1e3 * stop_m, color="tab:red", lw=1, ls="--")
            history.legend(loc="lower right")
        impacts.plot(t_s[late], v_m_s[late], ".", ms=5)
        impacts.set(xlim=(begin_s, end_s), xlabel="time [s]", ylabel="approach speed v⁻ [m/s]")
        window = f"last {PLOT_WINDOW_S:g} s" if is_part else "whole run"
        history.set(ylabel="position [mm]", title=f"position and impacts, {window}")
        portrait.set(xlabel="position [mm]", ylabel="velocity [m/s]", title=f"phase portrait, {window}")
        if is_part:
            panels["whole"].plot(t_s, v_m_s, ".", ms=3)
            panels["whole"].set(
                xlabel="time [s]", ylabel="approach speed v⁻ [m/s]", title="impacts, whole run"
            )
        for one in {panels.get("whole", impacts), impacts}:
            one.set_ylim(0.0, 1.1 * max(v_m_s, default=1.0))
        figure.align_ylabels()
