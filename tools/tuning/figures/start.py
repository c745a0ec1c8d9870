"""The picture of a start search: each criterion against time to capture, and the Pareto front."""

from collections.abc import Sequence
from pathlib import Path

from tools.tuning.result import Tuning
from tools.tuning.start import DEFAULT, RISE, Ramp


def draw_start(tuning: Tuning, tried: Sequence[Ramp], path: Path) -> None:
    """Draw the candidates into an SVG, PNG or PDF file."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14.0, 4.4), layout="constrained")
    panels = figure.subplots(1, 3)
    rises = [one.parameters[RISE] for one in tried]
    aims = (
        ([100.0 * one.failures / max(one.eligible, 1) for one in tried], "starts that fail [%]"),
        ([one.overshoot for one in tried], "hardest twentieth of impacts, of the steady one"),
        ([one.energy_p50_j for one in tried], "energy until captured, median [J]"),
    )
    times = [one.capture_p95_s for one in tried]
    marks = (
        ("o", 110, "tab:red", "Pareto front", [one.on_front for one in tried]),
        ("s", 220, "tab:green", "chosen", [one.parameters == tuning.values for one in tried]),
        ("D", 190, "tab:blue", "default", [one.parameters == DEFAULT for one in tried]),
    )
    for axes, (values, name) in zip(panels, aims, strict=True):
        dots = axes.scatter(times, values, c=rises, cmap="viridis", s=28, zorder=2)
        for mark, size, colour, label, is_one in marks:
            rows = [row for row, one in enumerate(is_one) if one]
            axes.scatter(
                [times[row] for row in rows],
                [values[row] for row in rows],
                marker=mark,
                s=size,
                facecolors="none",
                edgecolors=colour,
                linewidths=1.4,
                label=label,
            )
        axes.set(xlabel="95 % are captured within [s]", ylabel=name)
        axes.grid(alpha=0.3)
    panels[0].legend(fontsize=8)
    figure.colorbar(dots, ax=panels, label="rise [s]")
    figure.savefig(path, dpi=110)
