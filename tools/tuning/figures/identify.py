"""The picture of an identification: residuals by law, the friction force, the impacts."""

from pathlib import Path
from typing import Any

import numpy as np

from tools.tuning.identification.identify import Identified, friction_points
from tools.tuning.identification.laws import Law
from tools.tuning.recordings.readings import Readings

COLOURS = {Law.VISCOUS: "tab:blue", Law.COULOMB: "tab:orange", Law.BOTH: "tab:green", Law.STRIBECK: "tab:red"}


def draw_identified(found: Identified, readings: Readings, path: Path) -> None:
    """Draw the identification into an SVG, PNG or PDF file."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14.0, 4.4), layout="constrained")
    axes = figure.subplots(1, 3)
    striker = found.fit.striker
    figure.suptitle(
        f"{found.law.value} friction: c/m = {striker.stiffness_1_s2:.3f} 1/s², A = "
        f"{1e3 * striker.amplitude_m:.3f} mm, b/m = {abs(striker.damping_1_s):.4f} 1/s, "
        f"μg = {abs(striker.dry_m_s2):.4f} m/s²"
    )
    _friction(axes[0], found)
    _laws(axes[1], found)
    _impacts(axes[2], found)
    figure.savefig(path, dpi=110)


def _friction(axes: Any, found: Identified) -> None:
    """Draw the friction (the reading less spring and crank) against v, and the fitted laws."""
    v, left = friction_points(found)
    axes.plot(v, left, ",", color="gray", alpha=0.5, rasterized=True)
    grid = np.linspace(np.min(v), np.max(v), 400)
    for law, fit in found.fits.items():
        d, f, h = fit.striker.damping_1_s, fit.striker.dry_m_s2, fit.striker.rise_m_s2
        width = 2.5 if law == found.law else 1.0
        dry = f + h * np.exp(-((np.abs(grid) / fit.rise.v_s_m_s) ** fit.rise.delta))
        axes.plot(grid, d * grid + dry * np.sign(grid), color=COLOURS[law], lw=width, label=law.value)
    axes.set(xlabel="v [m/s]", ylabel="friction by mass [m/s²]", title="what slows the striker")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)


def _laws(axes: Any, found: Identified) -> None:
    names = [law.value.replace(" and ", "\nand ") for law in found.fits]
    residuals = [1e3 * fit.residual_m_s2 for fit in found.fits.values()]
    axes.bar(names, residuals, color=[COLOURS[law] for law in found.fits])
    axes.set(yscale="log", ylabel="residual [mm/s²]", title=f"residual by law; chosen: {found.law.value}")
    axes.grid(alpha=0.3, axis="y", which="both")


def _impacts(axes: Any, found: Identified) -> None:
    if not found.impacts:
        axes.set_title("no impacts")
        return
    table = np.array(found.impacts)
    axes.plot(table[:, 1], 1e3 * table[:, 0], ".", color="tab:red", label="stop past l0 [mm]")
    axes.set(xlabel="approach speed v⁻ [m/s]", ylabel="stop past l0 [mm]", title="impacts")
    other = axes.twinx()
    other.plot(table[:, 1], table[:, 2], "x", color="tab:purple", ms=4)
    other.set_ylabel("restitution (×)", color="tab:purple")
    axes.grid(alpha=0.3)
