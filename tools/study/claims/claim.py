"""A claim of the paper: its statement, its measurement, and the rule from the figures to a verdict.

A claim is `reproduced` if it holds as printed, `reproduced-under-parameters` if it holds for stated values
that the paper does not give or gives differently, and `contradicted` if it does not hold or holds only in
part.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from tools.study.claims.evidence import Evidence

REPRODUCED = "reproduced"
UNDER_PARAMETERS = "reproduced-under-parameters"
CONTRADICTED = "contradicted"

Figures = Mapping[str, Any]


class Verdict(NamedTuple):
    """A verdict, and the reason with the figures that decided it."""

    verdict: str
    reason: str


@dataclass(frozen=True)
class Claim:
    """A claim. `parts` states its parts with the figures of `measure` alone, and whether each part holds.

    It is reproduced if all parts hold, reproduced under parameters if `partly` and some hold, and otherwise
    contradicted.
    """

    id: str
    statement: str
    measure: Callable[[Evidence], dict[str, Any]]
    parts: Callable[[Figures], dict[str, bool]]
    partly: bool = False
    judgement: str = ""
    """Our own choices in the parts, which no measured number decides."""
    remark: str = ""
    """Background of the measurement, for the reader of the verdict."""

    def decide(self, found: Figures) -> Verdict:
        """Judge the figures by the rule; the reason states each part."""
        parts = self.parts(found)
        verdict = CONTRADICTED
        if all(parts.values()):
            verdict = REPRODUCED
        elif self.partly and any(parts.values()):
            verdict = UNDER_PARAMETERS
        stated = ""
        for words, which in (("Holds", True), ("Does not hold", False)):
            these = [part for part, holds in parts.items() if bool(holds) is which]
            stated += f"{words}: {'; '.join(these)}. " if these else ""
        return Verdict(verdict, f"{stated}{self.remark}".rstrip())

    def judge(self, evidence: Evidence) -> "JudgedClaim":
        """Measure the figures and judge the claim by its rule."""
        value = self.measure(evidence)
        verdict, reason = self.decide(value)
        return JudgedClaim(self.id, self.statement, self.judgement, verdict, value, reason)


@dataclass(frozen=True)
class JudgedClaim:
    """A claim with its verdict, the measured figures and the reason for the verdict."""

    id: str
    statement: str
    judgement: str
    verdict: str
    value: dict[str, Any]
    reason: str
