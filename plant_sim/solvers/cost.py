"""A bound on the work of a run: steps and events have a cost, which simulated time pays off.

A leaky bucket (Turner, IEEE Commun. Mag. 24, 1986): each step or event costs 1, simulated time reduces
the debt. A burst is accepted; a persistent excess is refused, independent of the length of the run before.
"""

from plant_sim.kernels import subroutine
from text_input import RefusalError

ALLOWANCE = 1_000_000.0
"""Largest debt of a run, about a second of computing. The named scenes stay below a thousandth of it."""

COST_A_RADIAN = 10_000.0
"""Cost paid off by each radian of the fastest of striker, crank, ankle, housing and current."""


class SolverError(RefusalError, RuntimeError):
    """A run that cannot continue; the message states the time, the motion and the remedy."""


@subroutine
def debt(before: float, cost: float, radians: float) -> float:
    """Debt of a run after it has spent `cost` on an interval in which its fastest part turned by
    `radians`."""
    return max(before + cost - COST_A_RADIAN * radians, 0.0)


def too_costly(place: str, remedy: str) -> SolverError:
    """The refusal of a run whose debt exceeds the allowance."""
    return SolverError(
        f"{ALLOWANCE:,.0f} steps and events more than the time they cover allows {place}; {remedy}"
    )
