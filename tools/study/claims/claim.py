"""A claim of the paper: its statement, its measurement, and the rule from the figures to a verdict."""

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
    """A claim. `decide` computes the verdict from nothing but the figures that `measure` returns."""

    id: str
    statement: str
    rule: str
    measure: Callable[[Evidence], dict[str, Any]]
    decide: Callable[[Figures], Verdict]
    judgement: str = ""
    """Our own choices in the rule, which no measured number decides."""

    def judge(self, evidence: Evidence) -> "JudgedClaim":
        """Measure the figures and judge the claim by its rule."""
        value = self.measure(evidence)
        verdict, reason = self.decide(value)
        return JudgedClaim(self.id, self.statement, self.rule, self.judgement, verdict, value, reason)


@dataclass(frozen=True)
class JudgedClaim:
    """A claim with its verdict, the measured figures and the reason for the verdict."""

    id: str
    statement: str
    rule: str
    judgement: str
    verdict: str
    value: dict[str, Any]
    reason: str


def verdict_of(reproduced: bool, under_parameters: bool = False) -> str:
    """Return the strongest verdict that holds."""
    if reproduced:
        return REPRODUCED
    return UNDER_PARAMETERS if under_parameters else CONTRADICTED
