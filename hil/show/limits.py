"""The limits of a scenario's checks in plots: for each figure the plot and the time window.

Only figures that are an extreme or a typical value of a plotted signal have a place; a share has none.
"""

from collections.abc import Sequence
from typing import NamedTuple

from hil.judge.checks import Check
from hil.judge.figures.records import Figures

WHOLE, HOLD, AFTER_FAULT, AFTER_STOP = "whole run", "hold", "after the fault", "after the stop"


class Place(NamedTuple):
    """A plot by its name under `limits/`, and the part of the run.

    `typical`: the figure is a typical value of the plotted signal, not its largest, so that a lower bound is
    also drawn. `signed`: the figure is the largest magnitude, so that its bound is drawn on both sides of 0.
    `scale`: the plot's values over the figure's: 1000 for millimetres.
    """

    plot: str
    stretch: str
    typical: bool = False
    signed: bool = False
    scale: float = 1.0


PLACES = {
    "impact_v_m_s": Place("impact_speed", HOLD, typical=True),
    "largest_v_m_s": Place("impact_speed", WHOLE),
    "impact_impulse_n_s": Place("impulse", HOLD, typical=True),
    "peak_force_n": Place("peak_force", WHOLE),
    "after_fault.peak_force_n": Place("peak_force", AFTER_FAULT),
    "felt.peak_n": Place("felt", WHOLE),
    "after_fault.largest_torque_n_m": Place("torque", AFTER_FAULT, signed=True),
    "motor_torque_after_stop_n_m": Place("torque", AFTER_STOP, signed=True),
    "after_fault.largest_speed_rad_s": Place("speed", AFTER_FAULT),
    "speed.mean_rad_s": Place("speed", HOLD, typical=True),
    "estimate.x_worst_m": Place("x_error", HOLD, signed=True, scale=1e3),
    "tick_us.max": Place("work", WHOLE),
    "bus_load": Place("load", WHOLE),
}


class Limit(NamedTuple):
    """One bound of a check: plot, name of the check, value, and the interval in s in which it is drawn."""

    plot: str
    name: str
    value: float
    from_s: float
    to_s: float


def limits(checks: Sequence[Check], figures: Figures, fault_s: float | None) -> list[Limit]:
    """The bounds of figures that have a place; `fault_s`: beginning of the first injected fault."""
    stretches = {
        WHOLE: (0.0, figures.duration_s),
        HOLD: (figures.hold_start_s, figures.hold_end_s),
        AFTER_FAULT: (fault_s, figures.duration_s),
        AFTER_STOP: (figures.safe_state.at_s, figures.duration_s),
    }
    found = []
    for check in checks:
        place = PLACES.get(check.name)
        if place is None:
            continue
        from_s, to_s = stretches[place.stretch]
        if from_s is None or to_s is None or from_s >= to_s:
            continue
        for bound in (check.high, check.low if place.typical else None):
            if bound is None:
                continue
            sides = (bound, -bound) if place.signed and bound else (bound,)
            found += [Limit(place.plot, check.name, place.scale * side, from_s, to_s) for side in sides]
    return sorted(found)
