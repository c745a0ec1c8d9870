"""A claim of the paper with its verdict, and functions that the claims share."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from tools.study.cases import PRESETS
from tools.study.claims.evidence import Evidence
from tools.study.sweep import Diagram

REPRODUCED = "reproduced"
CONTRADICTED = "contradicted"
DAMPED_RATIOS = (1.05, 1.1, 1.2)


@dataclass(frozen=True)
class Claim:
    """A statement of the paper with its verdict, measured figures and the reason for the verdict."""

    id: str
    statement: str
    verdict: str
    value: dict[str, Any]
    reason: str


def in_hz(diagram: Diagram, ratio: float | None) -> float | None:
    """Return the frequency in Hz of a speed ratio of a diagram; None for None."""
    return None if ratio is None else ratio * diagram.case.natural_rad_s / (2.0 * math.pi)


def per_law(found: Sequence[Diagram], figure: Callable[[Diagram], Any]) -> dict[str, Any]:
    """Return a figure of each diagram, keyed by preset and friction law."""
    return {f"{diagram.case.preset} {diagram.case.law}": figure(diagram) for diagram in found}


def nominal(evidence: Evidence) -> list[Diagram]:
    """Return the diagrams of all presets with their nominal parameters."""
    return [diagram for preset in PRESETS for diagram in evidence.nominal(preset)]
