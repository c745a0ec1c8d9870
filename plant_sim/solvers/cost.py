"""A bound on a run's computing: what its steps and events cost, and what the time that they cover pays for.

A leaky bucket (Turner, IEEE Commun. Mag. 24, 1986): each step or event adds its cost, simulated time takes
away. A burst is free; whatever goes on for ever is refused, however long the run was before.
"""

from plant_sim.kernels import shared

ALLOWANCE = 1_000_000.0
"""What a run may be behind; about a second of computing. Named scenes stay below a thousandth of it."""

COST_A_RADIAN = 10_000.0
"""Paid for by each radian of the fastest of striker, crank, ankle, housing and current; 300 are common."""

TIME_STEP = 0.01
"""What a step of time stepping costs, beside one of the adaptive solver or an event, each 1."""


class SolverError(RuntimeError):
    """A run that cannot be carried on; the message says where it stands and what to change."""


@shared
def debt(before: float, cost: float, radians: float) -> float:
    """What a run is behind after spending `cost` on time in which its fastest part turned by `radians`."""
    return max(before + cost - COST_A_RADIAN * radians, 0.0)


def too_costly(place: str, remedy: str) -> SolverError:
    """The refusal of a run that is behind by more than the allowance."""
    return SolverError(
        f"{ALLOWANCE:,.0f} steps and events more than the time they cover allows {place}; {remedy}"
    )
