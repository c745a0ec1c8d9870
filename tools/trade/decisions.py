"""The decisions of a firmware in a run, and their differences from the decisions in another run."""

from itertools import zip_longest
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

TOLERANCE_TICKS = 1
"""Largest time difference of equal decisions of two builds."""


class Decisions(NamedTuple):
    """Changes of mode or fault, rows of (tick, mode, fault), and detections of impacts, rows of (tick,)."""

    modes: NDArray[np.int64]
    impacts: NDArray[np.int64]

    @property
    def total(self) -> int:
        """Number of decisions."""
        return len(self.modes) + len(self.impacts)


def decisions_of(trace: NDArray[np.void]) -> Decisions:
    """The decisions of a firmware, from its trace."""
    now = np.column_stack([trace["tick"], trace["outputs.mode"], trace["outputs.fault"]]).astype(np.int64)
    changes = np.flatnonzero(np.any(np.diff(now[:, 1:], axis=0) != 0, axis=1)) + 1
    return Decisions(now[changes], now[trace["outputs.impact"], :1])


def differences(python: Decisions, compiled: Decisions) -> list[str]:
    """A sentence for each decision without an equal decision of the other build within the tolerance."""
    found = []
    for kind, ours, others in zip(Decisions._fields, python, compiled, strict=True):
        for one, other in zip_longest(ours.tolist(), others.tolist()):
            same = one is not None and other is not None and one[1:] == other[1:]
            if not same or abs(one[0] - other[0]) > TOLERANCE_TICKS:
                found.append(f"{kind}: python decides {one}, compiled {other}")
    return found
