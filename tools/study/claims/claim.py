"""A claim of the paper with its verdict, and functions that the claims share."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from tools.study.cases import PRESETS
from tools.study.claims.evidence import (
    Evidence,
)
from tools.study.sweep import Diagram

REPRODUCED = "reproduced"


CONTRADICTED = "contradicted"


DAMPED_RATIOS = (1.05, 1.1, 1.2)


@dataclass(frozen=True)
class Claim:
    """The paper's statement, and the finding."""

    id: str
    statement: str
    verdict: str
    value: dict[str, Any]
    reason: str


def in_hz(diagram: Diagram, ratio: float | None) -> float | None:
    """A speed ratio of a diagram as a frequency; None stays None."""
    return None if ratio is None else ratio * diagram.case.natural_rad_s / (2.0 * math.pi)


def per_law(found: Sequence[Diagram], figure: Callable[[Diagram], Any]) -> dict[str, Any]:
    """A figure of each diagram, by its preset and friction law."""
    return {f"{diagram.case.preset} {diagram.case.law}": figure(diagram) for diagram in found}


def nominal(evidence: Evidence) -> list[Diagram]:
    """The diagrams of all presets with their nominal parameters."""
    return [diagram for preset in PRESETS for diagram in evidence.nominal(preset)]


def or_none(value: float) -> float | None:
    """None for what is no finite number, as JSON wants it."""
    return value if math.isfinite(value) else None
