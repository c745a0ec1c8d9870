"""Checks: limits of figures, and their evaluation on a run.

A check takes the limits of the requirement that it names (`hil.scenario.limits`), and may have stricter ones.
A figure that is missing or NaN fails its check, and the result says why. If a node has recorded no tick,
every check fails: a firmware that never ran has latched no fault. A figure that is computed from an
incomplete log is not judged.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from hil.judge.figures.records import CATALOGUE, Figures, Origin, incomplete, value_of
from hil.judge.gaps import doubt_of
from hil.judge.hold import Window, commanded_end_s
from hil.judge.requirements import Bounds, requirements
from hil.judge.verdict import CheckResult, Value, Verdict
from hil.record.run_traces import NOTHING_LEFT, RunTraces
from plant_sim.validation_messages import nearest

LONGEST_S = 86_400.0
"""Longest duration of a run."""
END_TOLERANCE_S = 0.01
"""Time by which a run may end before the window of a check does: some ticks."""
MOST_CHECKS = 500
"""Largest number of checks of a scenario: one of a long expression takes some ten milliseconds."""


class Check(BaseModel):
    """A figure by its dotted name, and either inclusive bounds (`low`, `high`, both) or the required value.

    A check that names a requirement with limits of this figure takes these; its own may only be stricter.
    With an `expression` the figure is the user's own (`hil.judge.figures.own`), with any name and unit,
    evaluated from `from_s` to `to_s`.

    `unit`, if given, must be the figure's unit: a bound in millimetres on a figure in metres is refused.

    >>> Check(name="detector.recall", low=0.9).limit
    '≥ 0.9'
    >>> Check(name="regime", equals="impact").limit
    '= impact'
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, strict=True, use_attribute_docstrings=True
    )

    name: str
    """the figure's dotted name, see docs/reference/figures.md, or a new one for an expression"""
    low: float | None = None
    """the lowest permitted value"""
    high: float | None = None
    """the highest permitted value"""
    equals: Value | None = None
    """the only permitted value: a text, a number, true or false"""
    unit: str | None = None
    """the figure's unit as a text"""
    requirement: str | None = None
    """the id of the requirement that the check proves, see docs/requirements.md"""
    shows_after_s: float = Field(default=0.0, ge=0.0)
    """the time in s that the script's fault takes to show on the bus; it extends the requirement's limit"""
    required: Bounds | None = None
    """the requirement's limit in this scenario, which the bench writes into a run's folder"""
    hold_may_end: bool = False
    """whether fault or wearer may end the hold before the script does; the check covers it up to there"""
    expression: str | None = None
    """a number made of signals, such as max(plant.omega_rad_s)"""
    from_s: float = 0.0
    """the beginning of the expression's window in s"""
    to_s: float = LONGEST_S
    """the end of the expression's window in s"""

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


def margin(check: Check, value: Any) -> float:
    """Distance of a figure inside its limits, in its unit; negative outside, −inf if missing or unequal.

    >>> margin(Check(name="peak_force_n", low=90.0, high=180.0), 175.0)
    5.0
    >>> margin(Check(name="regime", equals="impact"), "lost")
    -inf
    """
    return margin_in(check.bounds, value)


def margin_in(bounds: Bounds, value: Any) -> float:
    """Distance of a value inside bounds, as `margin` gives it."""
    if bounds.equals is not None:
        alike = isinstance(value, bool) == isinstance(bounds.equals, bool)
        return 0.0 if alike and value == bounds.equals else -math.inf
    if value is None or isinstance(value, bool | str) or not math.isfinite(value):
        return -math.inf
    distances = [bounds.high - value] if bounds.high is not None else []
    distances += [value - bounds.low] if bounds.low is not None else []
    return float(min(distances, default=-math.inf))  # a check without a limit never passes


def is_within(check: Check, value: Any) -> bool:
    """Whether `value` meets the check; a missing value or one that is not finite does not."""
    return margin(check, value) >= 0.0


def meets_requirement(check: Check, value: Any) -> bool | None:
    """Whether `value` meets the limit that the check's requirement has of this figure; None without one."""
    return None if check.required is None else margin_in(check.required, value) >= 0.0


def margin_share(check: Check, value: Any) -> float | None:
    """The margin as a share of the limits' half width, or of the only limit; None for texts and a limit of 0.

    A lower limit of a share, such as 0.99, has 1 as its other end. A lower limit of 0 counts as none,
    because the figures that have it (times, counts, errors) are never negative.

    >>> margin_share(Check(name="peak_force_n", low=90.0, high=180.0), 135.0)
    1.0
    >>> margin_share(Check(name="estimate.x_rmse_m", high=0.002), 0.0005)
    0.75
    >>> margin_share(Check(name="detector.recall", low=0.9), 1.0)
    1.0
    """
    low, high, equals = check.bounds.low, check.bounds.high, check.bounds.equals
    if equals is not None or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    if high is not None and low == 0.0:
        return (high - value) / high if high > 0.0 else None
    if high is not None:
        scale = abs(high) if low is None else 0.5 * (high - low)
    elif low is not None:
        scale = 1.0 - low if 0.0 < low < 1.0 and value <= 1.0 else abs(low)
    else:
        return None
    return margin(check, value) / scale if scale > 0.0 else None


def measure(check: Check, figures: Figures, traces: RunTraces) -> tuple[Value | None, str | None]:
    """The value of a check's figure, or None and the reason why the run does not have it."""
    if silent := [name for name in ("plant", "firmware") if getattr(figures.loops, name).ticks == 0]:
        return None, f"{' and '.join(silent)} recorded no tick"
    if check.expression is not None:
        return measure_own(check, check.expression, figures, traces)
    value = value_of(figures, check.name)
    spec = CATALOGUE[check.name]
    if spec.origin is Origin.HOLD:
        if figures.hold_start_s is None:
            return value, "the firmware never reached mode RUN, so the run has no hold"
        if not check.hold_may_end and (early := early_end(figures, traces)) is not None:
            return None, early
    if value is None:
        return None, f"the run does not have this figure ({spec.meaning})"
    return value, None


def early_end(figures: Figures, traces: RunTraces) -> str | None:
    """Says that the hold ended before the script ended it: its figures do not cover the whole hold."""
    start_s, end_s = figures.hold_start_s, figures.hold_end_s
    if start_s is None or end_s is None:
        return None
    commanded_s = commanded_end_s(traces.scenario, start_s)
    if commanded_s is None or end_s >= commanded_s - END_TOLERANCE_S:
        return None
    return f"the hold ended at {end_s:.2f} s, before the script ends it at {commanded_s:g} s"


def measure_own(
    check: Check, expression: str, figures: Figures, traces: RunTraces
) -> tuple[Value | None, str | None]:
    """The value of an own figure over the check's window, or None and the reason."""
    from hil.judge.figures.expression import ExpressionError  # noqa: PLC0415 - most have none
    from hil.judge.figures.own import own_figure  # noqa: PLC0415

    try:
        value = own_figure(expression, Window(check.from_s, check.to_s), traces.plant, traces.firmware)
    except ExpressionError as error:
        return None, str(error)
    if check.to_s < LONGEST_S and figures.duration_s + END_TOLERANCE_S < check.to_s:
        return None, f"the run ended at {figures.duration_s:g} s, before the window's end, {check.to_s:g} s"
    return value, None


def doubt(check: Check, figures: Figures) -> str | None:
    """The reason why a check cannot be judged; None if it can."""
    if check.name in incomplete(figures):
        return f"can.log lacks {figures.log.frames_lost} frames, from which this figure is computed"
    if check.expression is None and CATALOGUE[check.name].describes_the_bench:
        return None
    return doubt_of(window_s(check, figures), figures.gaps)


def window_s(check: Check, figures: Figures) -> tuple[float, float]:
    """The interval in s over which a check's figure is taken: its own, the hold, or the whole run."""
    if check.expression is not None:
        return check.from_s, check.to_s
    if CATALOGUE[check.name].origin is Origin.HOLD and figures.hold_start_s is not None:
        return figures.hold_start_s, figures.hold_end_s or LONGEST_S
    return 0.0, LONGEST_S


def evaluate(
    checks: Iterable[Check], figures: Figures, traces: RunTraces = NOTHING_LEFT
) -> list[CheckResult]:
    """Evaluate each check on the figures, and own expressions on `traces`."""
    results = []
    for check in checks:
        value, reason = measure(check, figures, traces)
        verdict = Verdict.PASSED if is_within(check, value) else Verdict.FAILED
        if (doubted := doubt(check, figures)) is not None:
            verdict, reason = Verdict.NOT_JUDGED, doubted
        unit = check.unit or "" if check.expression is not None else CATALOGUE[check.name].unit
        reason = None if verdict is Verdict.PASSED else reason
        share = margin_share(check, value)
        results.append(
            CheckResult(
                name=check.name,
                verdict=verdict,
                value=value,
                unit=unit,
                limit=check.limit,
                requirement=check.requirement,
                reason=reason,
                margin_share=share,
                required=check.required.text if check.required not in (None, check.bounds) else None,
                meets_requirement=None if doubted else meets_requirement(check, value),
            )
        )
    return results


def checks_of(scenario: Mapping[str, Any]) -> list[Check]:
    """The checks in a scenario's raw tables; raises ValueError for more than MOST_CHECKS."""
    tables = scenario.get("checks", [])
    if len(tables) > MOST_CHECKS:
        raise ValueError(f"it has {len(tables)} checks; wanted {MOST_CHECKS} at most")
    return [Check.model_validate(table) for table in tables]
