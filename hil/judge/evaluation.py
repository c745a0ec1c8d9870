"""The evaluation of checks on the figures of a run.

A figure that is missing or NaN fails its check, and the result says why. If a node has recorded no tick,
every check fails: a firmware that never ran has latched no fault. A figure that is computed from an
incomplete log is not judged.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from hil.figures.gaps import doubt_of
from hil.figures.hold import Window, commanded_end_s
from hil.figures.records import CATALOGUE, Figures, Origin, incomplete, value_of
from hil.judge.verdict import CheckResult, Verdict
from hil.record.run_traces import NOTHING_LEFT, RunTraces
from hil.scenario.checks import LONGEST_S, Bounds, Check, Value

END_TOLERANCE_S = 0.01
"""Time by which a run may end before the window of a check does: some ticks."""


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
    from hil.figures.expression import ExpressionError  # noqa: PLC0415 - most have none
    from hil.figures.own import own_figure  # noqa: PLC0415

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
        reason = None if verdict is Verdict.PASSED else reason
        result = CheckResult.of(check, verdict, value, reason, margin_share(check, value))
        meets = None if doubted else meets_requirement(check, value)
        results.append(replace(result, meets_requirement=meets))
    return results
