"""Which of the two accelerometer channels alike feels the striker, from the frames of a step.

Dry friction may hold the striker in the drive's step, so the sweep below the impacts looks again.
"""

from pathlib import Path

import numpy as np

from tools.bring_up.step import Context, Findings, StepFailedError
from tools.tuning.recordings.readings import read_ticks
from tools.tuning.result import make_value

EXCHANGED = "wiring.low_exchanged"
SHAKEN = 1.5
"""A channel that varies this many times more than at rest has felt the striker."""


def find_channels(context: Context, found: Findings, log: Path) -> None:
    """Find exchanged channels in a step's log; raises StepFailedError if that is not agreed to."""
    moving, rest = read_ticks(log), read_ticks(context.log("at-rest"))
    low, housing = (
        float(np.nanstd(getattr(moving, one)) / np.nanstd(getattr(rest, one)))
        for one in ("low_m_s2", "housing_m_s2")
    )
    found.add("striker's low range, motion over noise", low, "1")
    found.add("housing, motion over noise", housing, "1")
    if context.values[EXCHANGED] == 1.0 or housing < SHAKEN or low > SHAKEN:
        return
    if not context.asks(
        "The housing's channel feels the striker, and the striker's low range does not: the two are "
        f"exchanged. Set {EXCHANGED} = 1?"
    ):
        raise StepFailedError("the striker's low range and the housing are exchanged; exchange their plugs")
    found.parameters[EXCHANGED] = make_value(EXCHANGED, 1.0)
