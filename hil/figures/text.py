"""Figures as text, the same in terminal, report, JUnit and log."""

import math
from typing import Any

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
