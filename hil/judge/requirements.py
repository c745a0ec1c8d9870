"""The requirements in requirements.toml with their limits, and their traceability to the checks."""

import tomllib
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from hil.judge.verdict import RunVerdict, Value, Verdict, worst


class Bounds(BaseModel):
    """Inclusive bounds of a figure, or its only permitted value."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, strict=True, use_attribute_docstrings=True
    )

    low: float | None = None
    """the lowest permitted value"""
    high: float | None = None
    """the highest permitted value"""
    equals: Value | None = None
    """the only permitted value: a text, a number, true or false"""

    @property
    def text(self) -> str:
        """The bounds as text.

        >>> Bounds(low=0.9).text, Bounds(low=1.0, high=2.5).text, Bounds(equals=True).text
        ('≥ 0.9', '1 … 2.5', '= true')
        """
        return self.written("g")

    def written(self, form: str) -> str:
        """The bounds as text, with numbers in a format as `.12g`, which distinguishes more."""
        if self.equals is not None:
            return f"= {str(self.equals).lower() if isinstance(self.equals, bool) else self.equals}"
        if self.low is None:
            return "no limit" if self.high is None else f"≤ {self.high:{form}}"
        return f"≥ {self.low:{form}}" if self.high is None else f"{self.low:{form}} … {self.high:{form}}"


class Limit(Bounds):
    """A requirement's limit of a figure.

    A scenario's check takes the last limit of its figure whose conditions hold; `hil.scenario.limits` knows
    the conditions and the quantities.
    """

    figure: str
    """the figure's dotted name"""
    of: str | None = None
    """a quantity of the scenario, of which `low` and `high` are multiples"""
    ticks: int = 0
    """control periods added to `high`: from frame to tick, and from tick to torque"""
    when: Mapping[str, Value] = {}
    """what holds in a scenario to which this limit applies, by key"""


class Requirement(BaseModel):
    """A requirement in one sentence, and the limits of the figures by which it is judged."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    text: str
    source: str
    """The page under docs that states the requirement, with its section."""
    limits: tuple[Limit, ...] = ()

    def limits_of(self, figure: str) -> list[Limit]:
        """The limits of a figure, in the order of the file."""
        return [limit for limit in self.limits if limit.figure == figure]


@cache
def requirements() -> Mapping[str, Requirement]:
    """Every requirement by its id."""
    document = tomllib.loads((Path(__file__).parent / "requirements.toml").read_text(encoding="utf-8"))
    return {name: Requirement.model_validate(table) for name, table in document.items()}


@cache
def size_of(figure: str) -> float:
    """The smallest bound other than 0 that a requirement sets for a figure in its unit; 0 without one."""
    limits = [limit for one in requirements().values() for limit in one.limits_of(figure) if limit.of is None]
    bounds = [abs(bound) for limit in limits for bound in (limit.low, limit.high) if bound]
    return min(bounds, default=0.0)


def trace(verdicts: Iterable[RunVerdict]) -> dict[str, Any]:
    """For each requirement the checks that prove it, and the verdict on it (None if none has run).

    A run that fails or is not judged regardless of its checks proves no requirement. A value beyond the
    scenario's own limit alone meets the requirement.
    """
    proofs: dict[str, list[tuple[Verdict, dict[str, Any]]]] = {name: [] for name in requirements()}
    for run in verdicts:
        of_run = Verdict.FAILED if run.reasons else Verdict.NOT_JUDGED if run.not_judged else None
        for check in run.checks:
            if check.requirement is not None:
                verdict = of_run or (Verdict.PASSED if check.meets_requirement else check.verdict)
                proof: dict[str, Any] = {"scenario": run.scenario, "name": check.name, "limit": check.limit}
                proof |= {"passed": verdict.passed, "verdict": verdict.value}
                proofs[check.requirement].append((verdict, proof))
    return {
        name: {
            "text": requirements()[name].text,
            "passed": worst(verdict for verdict, _ in found).passed,
            "verdict": worst(verdict for verdict, _ in found).value if found else None,
            "checks": [proof for _, proof in found],
        }
        for name, found in proofs.items()
    }
