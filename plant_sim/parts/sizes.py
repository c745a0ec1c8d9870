"""How much a part adds to the integrated state of a module."""

from typing import Any

from plant_sim.kernels import by_part


@by_part
def motion_size(part: Any) -> int:
    """Number of quantities of motion that a drive, wearer or winding adds to the striker's two."""
    return 0


@by_part
def ledger_size(part: Any) -> int:
    """Number of integrals that a stop, housing, wearer or winding adds to the ledger's two, of drive and
    friction."""
    return 0
