"""Figures as text, the same in terminal, report, JUnit and log."""

import math
from typing import Any

from hil.figures.records import Figures

Row = tuple[str, Any, str]
"""A figure for people: its label, its value, and the unit of the value."""
NO_VALUE = "—"
"""Text of a figure that a run does not have."""


def figure_text(value: Any, unit: str = "") -> str:
    """A figure with four significant digits and its unit; NO_VALUE for a missing figure.

    >>> figure_text(0.02345678, "m"), figure_text(None, "N"), figure_text(0.25), figure_text(True)
    ('0.02346 m', '—', '0.25', 'yes')
    """
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return NO_VALUE
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return text if unit in ("", "1") else f"{text} {unit}"


def main_figures(figures: Figures) -> list[Row]:
    """The main figures that a run has."""
    estimate, detector, gait = figures.estimate, figures.detector, figures.gait
    timing = {True: "yes", False: "no; the verdict does not judge the timing"}
    left_out = ", lost frames left out" if figures.log.frames_lost else ""
    rows: list[Row] = [
        ("clock, bus", f"{figures.clock}, {figures.bus}", ""),
        ("duration", figures.duration_s, "s"),
        *impact_rows(figures),
        ("last approach speed", figures.impacts[-1].v_m_s if figures.impacts else None, "m/s"),
        ("peak stop force", figures.peak_force_n, "N"),
        ("peak felt force", figures.felt.peak_n, "N"),
        ("strides with a pulse in the window", scale(100.0, gait.in_window), "%"),
        ("position error, RMS", scale(1e3, estimate.x_rmse_m), "mm"),
        ("velocity error, RMS", scale(1e3, estimate.v_rmse_m_s), "mm/s"),
        ("impacts detected", scale(100.0, detector.recall), "%"),
        ("detections that are impacts", scale(100.0, detector.precision), "%"),
        ("detection latency, median", detector.latency_ms.p50, "ms"),
        ("speed ripple", scale(100.0, figures.speed.ripple), "%"),
        ("firmware's work a tick, 99 %", figures.tick_us.p99, "µs"),
        ("skipped ticks", figures.overruns or None, ""),
        ("skipped by a bare sleep loop", figures.baseline_overruns or None, ""),
        ("held up by the host", scale(1e3, figures.held_s), "ms"),
        ("met its timing", None if figures.real_time is None else timing[figures.real_time], ""),
        ("simulated time / elapsed time", figures.realtime_factor, ""),
        ("frames that nodes could not send", figures.log.frames_unsent or None, ""),
        (f"bus load{left_out}", scale(100.0, figures.bus_load), "%"),
    ]
    return [row for row in rows if figure_text(row[1]) != NO_VALUE]


def impact_rows(figures: Figures) -> list[Row]:
    """Regime and number of impacts: the true ones, or without truth those that the firmware reported."""
    if figures.impact_count is None:
        rows = [
            ("regime reported", figures.regime_estimated, ""),
            ("impacts reported", figures.impacts_reported, ""),
        ]
        return rows if figures.ticks else []
    return [("regime", figures.regime, ""), ("impacts", figures.impact_count, "")]


def scale(factor: float, value: float | None) -> float | None:
    """A figure in a unit for display; None if the run does not have it."""
    return None if value is None else factor * value
