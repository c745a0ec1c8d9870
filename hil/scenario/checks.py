"""Checks as a scenario states them: limits of figures, and the requirements whose limits they take.

`hil.judge.evaluation` evaluates them on a run. `hil.scenario.limits` completes a check's limits by those of
the requirement that it names; a check may have stricter ones. requirements.toml holds the requirements.
"""

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from hil.figures.records import CATALOGUE
from plant_sim.validation_messages import nearest

Value = bool | int | float | str
LONGEST_S = 86_400.0
"""Longest duration of a run."""
MOST_CHECKS = 500
"""Largest number of checks of a scenario: one of a long expression takes some ten milliseconds."""
STRICT = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)


class Bounds(BaseModel):
    """Inclusive bounds of a figure, or its only permitted value."""

    model_config = STRICT

    low: float | None = Field(default=None, description="the lowest permitted value")
    high: float | None = Field(default=None, description="the highest permitted value")
    equals: Value | None = Field(
        default=None, description="the only permitted value: a text, a number, true or false"
    )

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

    figure: str = Field(description="the figure's dotted name")
    of: str | None = Field(
        default=None, description="a quantity of the scenario, of which `low` and `high` are multiples"
    )
    ticks: int = Field(
        default=0,
        description="control periods added to `high`, and those by which the controller is late",
    )
    when: Mapping[str, Value] = Field(
        default={}, description="what holds in a scenario to which this limit applies, by key"
    )


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


class Check(BaseModel):
    """A figure by its dotted name, and either inclusive bounds (`low`, `high`, both) or the required value.

    A check that names a requirement with limits of this figure takes these; its own may only be stricter.
    With an `expression` the figure is the user's own (`hil.figures.own`), with any name and unit,
    evaluated from `from_s` to `to_s`.

    `unit`, if given, must be the figure's unit: a bound in millimetres on a figure in metres is refused.

    >>> Check(name="detector.recall", low=0.9).limit
    '≥ 0.9'
    >>> Check(name="regime", equals="impact").limit
    '= impact'
    """

    model_config = STRICT

    name: str = Field(
        description="the figure's dotted name, see docs/reference/figures.md, or a new one for an expression"
    )
    low: float | None = Field(default=None, description="the lowest permitted value")
    high: float | None = Field(default=None, description="the highest permitted value")
    equals: Value | None = Field(
        default=None, description="the only permitted value: a text, a number, true or false"
    )
    unit: str | None = Field(default=None, description="the figure's unit as a text")
    requirement: str | None = Field(
        default=None, description="the id of the requirement that the check proves, see docs/requirements.md"
    )
    shows_after_s: float = Field(
        default=0.0,
        ge=0.0,
        description="the time in s that the script's fault takes to show on the bus; it extends the "
        "requirement's limit",
    )
    required: Bounds | None = Field(
        default=None,
        description="the requirement's limit in this scenario, which the bench writes into a run's folder",
    )
    hold_may_end: bool = Field(
        default=False,
        description="whether fault or wearer may end the hold before the script does; the check covers it up "
        "to there",
    )
    expression: str | None = Field(
        default=None, description="a number made of signals, such as max(plant.omega_rad_s)"
    )
    from_s: float = Field(default=0.0, description="the beginning of the expression's window in s")
    to_s: float = Field(default=LONGEST_S, description="the end of the expression's window in s")

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
        from hil.figures.own import refuse_unknown  # noqa: PLC0415 - most scenarios have none

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
        self._refuse_limits_that_mean_nothing(is_text=spec is not None and spec.is_text)
        return self

    def _refuse_limits_that_mean_nothing(self, *, is_text: bool) -> None:
        """Raise ValueError for no limit, two kinds of it, one of another type, or one that nothing meets."""
        bounded = self.low is not None or self.high is not None
        if not bounded and self.equals is None and self.requirement is not None:
            if not requirements()[self.requirement].limits_of(self.name):
                raise ValueError(
                    f"check {self.name!r} has no limit, and its requirement {self.requirement} has none of "
                    "this figure; give low, high or both, or equals"
                )
            return
        if bounded == (self.equals is not None):
            raise ValueError(
                f"check {self.name!r} has no limit, or both kinds; give low, high or both, or equals"
            )
        if is_text != (isinstance(self.equals, str) and not bounded):
            wanted = "a text; give equals and a text" if is_text else "a number; give low, high or a number"
            raise ValueError(f"check {self.name!r} cannot pass: the figure is {wanted}")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"check {self.name!r} cannot pass: low {self.low} is above high {self.high}")

    @property
    def own(self) -> Bounds:
        """The limit that the scenario gives."""
        return Bounds(low=self.low, high=self.high, equals=self.equals)

    @property
    def bounds(self) -> Bounds:
        """The limit that counts: the scenario's own, completed by that of the requirement."""
        if self.required is None or self.equals is not None:
            return self.own
        low = self.required.low if self.low is None else self.low
        high = self.required.high if self.high is None else self.high
        return Bounds(low=low, high=high, equals=self.required.equals)

    @property
    def limit(self) -> str:
        """The limit that counts as text, such as `≥ 0.9`."""
        return self.bounds.text


def checks_of(scenario: Mapping[str, Any]) -> list[Check]:
    """The checks in a scenario's raw tables; raises ValueError for more than MOST_CHECKS."""
    tables = scenario.get("checks", [])
    if len(tables) > MOST_CHECKS:
        raise ValueError(f"it has {len(tables)} checks; wanted {MOST_CHECKS} at most")
    return [Check.model_validate(table) for table in tables]
