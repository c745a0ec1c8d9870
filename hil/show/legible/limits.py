"""The limits of checks that are drawn in the plots of a log."""

from collections.abc import Sequence
from typing import NamedTuple

from hil.scenario.checks import Check

APPROACH_LIMITS, FORCE_LIMITS = "/limits/approach_speed", "/limits/peak_force"
FIGURES = {APPROACH_LIMITS: ("impact_v_m_s", "largest_v_m_s"), FORCE_LIMITS: ("peak_force_n",)}
"""Figures whose limits a plot has, by the entity of these limits."""


class Limit(NamedTuple):
    """One bound of a check in the figure's unit, and its name in a legend."""

    value: float
    name: str


def limits_of(checks: Sequence[Check], figures: Sequence[str]) -> list[Limit]:
    """The bounds of all checks on some figures, each once.

    >>> limits_of([Check(name="impact_v_m_s", low=0.88, high=0.94)], ["impact_v_m_s"])
    [Limit(value=0.88, name='impact_v_m_s 0.88 … 0.94'), Limit(value=0.94, name='impact_v_m_s 0.88 … 0.94')]
    """
    found = (
        Limit(bound, f"{check.name} {check.limit}")
        for check in checks
        if check.name in figures
        for bound in (check.low, check.high)
        if bound is not None
    )
    return list(dict.fromkeys(found))
