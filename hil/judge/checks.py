"""Checks: limits of figures, and their evaluation on a run.

A figure that is missing, NaN, or computed from an incomplete log never passes. If a node has recorded no
tick, no figure passes: a firmware that never ran has latched no fault.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, model_validator

from hil.judge.figures.records import CATALOGUE, incomplete, value_of
from hil.judge.requirements import requirements
from hil.record.run_traces import NOTHING_LEFT, RunTraces
from plant_sim.validation_messages import nearest

LONGEST_S = 86_400.0
"""Longest duration of a run."""

Value = bool | int | float | str


class Check(BaseModel):
    """A figure by its dotted name, and either inclusive bounds (`low`, `high`, both) or the required value.

    With an `expression` the figure is the user's own (`hil.judge.figures.own`), with any name and unit,
    evaluated from `from_s` to `to_s`.

    `unit`, if given, must be the figure's unit: a bound in millimetres on a figure in metres is refused.

    >>> Check(name="detector.recall", low=0.9).limit
    '≥ 0.9'
    >>> Check(name="regime", equals="impact").limit
    '= impact'
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    name: str
    low: float | None = None
    high: float | None = None
    equals: Value | None = None
    unit: str | None = None
    requirement: str | None = None
    """Id of the requirement that the check proves; see docs/requirements.md."""
    expression: str | None = None
    from_s: float = 0.0
    to_s: float = LONGEST_S

    @model_validator(mode="after")
    def _an_expression_can_be_worked_out(self) -> Self:
        if self.expression is None:
            if {"from_s", "to_s"} & self.model_fields_set:
                raise ValueError(f"check {self.name!r} has a window but no expression; give both or none")
            return self
        if self.name in CATALOGUE:
            raise ValueError(f"check {self.name!r}: a run has such a figure already; give yours another name")
        if not self.from_s < self.to_s:
            raise ValueError(f"check {self.name!r}: from_s = {self.from_s} is not before to_s = {self.to_s}")
        from hil.judge.figures.own import refuse_unknown  # noqa: PLC0415 - most scenarios have none

        refuse_unknown(self.expression)
        return self

    @model_validator(mode="after")
    def _names_a_figure_and_one_limit(self) -> Self:
        spec = CATALOGUE.get(self.name)
        if spec is None and self.expression is None:
            known = nearest(self.name, CATALOGUE, "docs/reference/figures.md lists all of them")
            raise ValueError(f"check {self.name!r} names no figure of a run; {known}")
        if spec is not None and self.unit is not None and self.unit != spec.unit:
            raise ValueError(f"check {self.name!r} has unit {self.unit!r}; the figure is in {spec.unit!r}")
        if self.requirement is not None and self.requirement not in requirements():
            known = ", ".join(requirements())
            raise ValueError(
                f"check {self.name!r} proves {self.requirement!r}, no requirement; wanted {known}"
            )
        bounded = self.low is not None or self.high is not None
        if bounded == (self.equals is not None):
            raise ValueError(
                f"check {self.name!r} has no limit, or both kinds; give low, high or both, or equals"
            )
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"check {self.name!r} cannot pass: low {self.low} is above high {self.high}")
        return self

    @property
    def limit(self) -> str:
        """The limit as text, such as `≥ 0.9`."""
        if self.equals is not None:
            return f"= {str(self.equals).lower() if isinstance(self.equals, bool) else self.equals}"
        if self.low is None:
            return f"≤ {self.high:g}"
        return f"≥ {self.low:g}" if self.high is None else f"{self.low:g} … {self.high:g}"


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Result of one check: measured value, unit and limit."""

    name: str
    passed: bool
    value: Value | None
    unit: str
    limit: str
    requirement: str | None = None


def margin(check: Check, value: Any) -> float:
    """Distance of a figure inside its limits, in its unit; negative outside, −inf if missing or unequal.

    >>> margin(Check(name="peak_force_n", low=90.0, high=180.0), 175.0)
    5.0
    >>> margin(Check(name="regime", equals="impact"), "lost")
    -inf
    """
    if check.equals is not None:
        alike = isinstance(value, bool) == isinstance(check.equals, bool)
        return 0.0 if alike and value == check.equals else -math.inf
    if value is None or isinstance(value, bool | str) or not math.isfinite(value):
        return -math.inf
    below = math.inf if check.high is None else check.high - value
    return float(min(below, math.inf if check.low is None else value - check.low))


def within(check: Check, value: Any) -> bool:
    """Whether `value` meets the check; a missing value or one that is not finite does not."""
    return margin(check, value) >= 0.0


def own_value(check: Check, traces: RunTraces) -> float | None:
    """The value of a check's own expression."""
    from hil.judge.figures.own import Window, own_figure  # noqa: PLC0415 - most scenarios have none

    assert check.expression is not None
    return own_figure(check.expression, Window(check.from_s, check.to_s), traces.plant, traces.firmware)


def left_no_tick(figures: Mapping[str, Any]) -> bool:
    """Whether the loop of plant or firmware has recorded no tick."""
    return any(loop["ticks"] == 0 for loop in figures["loops"].values())


def evaluate(
    checks: Iterable[Check], figures: Mapping[str, Any], traces: RunTraces = NOTHING_LEFT
) -> list[CheckResult]:
    """Evaluate each check on the figures, given as `Figures.as_json()`, and own expressions on `traces`."""
    doubtful, nothing_ran = incomplete(figures), left_no_tick(figures)
    results = []
    for check in checks:
        if check.expression is None:
            value, unit = value_of(figures, check.name), CATALOGUE[check.name].unit
        else:
            value, unit = own_value(check, traces), check.unit or ""
        if nothing_ran:
            value = None
        passed = within(check, value) and check.name not in doubtful
        results.append(CheckResult(check.name, passed, value, unit, check.limit, check.requirement))
    return results


def checks_of(scenario: Mapping[str, Any]) -> list[Check]:
    """The checks in a scenario's raw tables."""
    return [Check.model_validate(table) for table in scenario.get("checks", [])]
