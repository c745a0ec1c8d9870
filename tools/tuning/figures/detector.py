"""The detector's characteristic: misses against false alarms, latency and cost against the floor."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tools.tuning.detector import PARAMETER, Operating
from tools.tuning.result import Tuning


def draw_detector(tuning: Tuning, points: Sequence[Operating], path: Path) -> None:
    """Draw the characteristic into an SVG, PNG or PDF file."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14.0, 4.4), layout="constrained")
    roc, latency, cost = figure.subplots(1, 3)
    value = tuning.parameters[PARAMETER]
    floors = np.array([point.floor_m_s2 for point in points])
    alarms = [point.false_alarms_1_h for point in points]
    roc.errorbar(
        alarms,
        [100.0 * (1.0 - point.recall) for point in points],
        yerr=[
            [100.0 * (point.recall_high - point.recall) for point in points],
            [100.0 * (point.recall - point.recall_low) for point in points],
        ],
        fmt="o-",
        capsize=3,
    )
    for point in points:
        roc.annotate(
            f"{point.floor_m_s2:g}",
            (point.false_alarms_1_h, 100.0 * (1.0 - point.recall)),
            textcoords="offset points",
            xytext=(5, 4),
            fontsize=8,
        )
    roc.set(xlabel="false alarms [1/h]", ylabel="impacts missed [%], 95 % bounds", title="by floor in m/s²")
    latency.semilogx(floors, [point.latency_p50_ms for point in points], "o-", label="median")
    latency.semilogx(floors, [point.latency_p95_ms for point in points], "s--", label="95 %")
    latency.set(xlabel="floor [m/s²]", ylabel="latency [ms]", title="from touch-down to its report")
    latency.legend(fontsize=8)
    cost.errorbar(
        floors,
        [point.cost_1_h for point in points],
        yerr=[point.cost_error_1_h for point in points],
        fmt="o-",
        capsize=3,
    )
    cost.set(xscale="log", xlabel="floor [m/s²]", ylabel="cost [1/h]", title="cost, as stated")
    for axes in (latency, cost):
        axes.axvspan(value.low, value.high, color="tab:green", alpha=0.15)
        axes.axvline(value.value, color="tab:green")
    for axes in (roc, latency, cost):
        axes.grid(alpha=0.3, which="both")
    figure.savefig(path, dpi=110)
