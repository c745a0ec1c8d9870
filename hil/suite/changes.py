"""The effect of a change of the code: the checks of two suites with their margins, better or worse.

Runs are paired by scenario and seed. A figure is better if its margin, the distance to its nearest limit, has
grown significantly over the seeds: by Wilcoxon's two-sided signed-rank test of the paired differences, then
by Benjamini and Hochberg's bound on the false discovery rate among all figures that differ.

Checks whose verdict differs come first, then figures that exceed their tolerance.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy  # it loads `stats` at the first use, which takes longer than a short run
from numpy.typing import NDArray

from hil.judge.tolerance import Tolerance, tolerance_of

FALSE_ALARMS = 0.01
"""False discovery rate among the figures called better or worse; for equal builds, probability of any."""
FEWEST_PAIRS = 8
"""Lowest number of pairs n: the test's least p-value is 2^(1 − n), and fewer cannot be significant."""
BEYOND = 1e300
"""Replaces the infinite margin of a missing figure when differences are ranked."""

Numbers = NDArray[np.float64]


class Baseline(NamedTuple):
    """Another suite's result, and the tolerances within which figures count as equal to it."""

    suite: Mapping[str, Any]
    tolerances: Mapping[str, Tolerance]


def numbers(values: Sequence[float | None]) -> Numbers:
    """Margins as numbers; a missing margin becomes the lowest."""
    return np.array([-BEYOND if value is None else value for value in values])


def p_value(before: Numbers, after: Numbers) -> float | None:
    """p-value of the paired differences; None if there are too few pairs.

    >>> p_value(np.arange(10.0), np.arange(10.0))
    1.0
    >>> round(p_value(np.arange(10.0), np.arange(10.0) + np.linspace(1, 2, 10)), 4)
    0.002
    """
    if np.array_equal(before, after):
        return 1.0
    if len(before) < FEWEST_PAIRS:
        return None
    return float(scipy.stats.wilcoxon(after - before, zero_method="zsplit").pvalue)


def middle(values: Sequence[Any]) -> Any:
    """The median of numbers, or the most frequent of other values."""
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        return float(np.median(values))
    counts = Counter(map(repr, values))
    return max(values, key=lambda value: counts[repr(value)])


def pair_seeds(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[tuple[int, int]]:
    """Indices in both suites of the seeds that both have."""
    of_before = {seed: place for place, seed in enumerate(before["seeds"])}
    return [(of_before[seed], place) for place, seed in enumerate(after["seeds"]) if seed in of_before]


def row(
    before: Mapping[str, Any],
    after: Mapping[str, Any],
    places: Sequence[tuple[int, int]],
    tolerance: Tolerance,
) -> dict[str, Any]:
    """One check before and after, in the seeds at `places`; `judge` adds the verdict from all p-values."""
    values, margins = (
        ([before[key][first] for first, _ in places], [after[key][last] for _, last in places])
        for key in ("values", "margins")
    )
    inside = [numbers(one) for one in margins]
    flipped = before["passed"] != after["passed"]
    return {
        "figure": after["name"],
        "unit": after["unit"],
        "limit": after["limit"],
        "before": middle(values[0]),
        "after": middle(values[1]),
        "margin_before": middle(margins[0]),
        "margin_after": middle(margins[1]),
        "grows": float(np.median(inside[1] - inside[0])),
        "p": p_value(*inside),
        "passed_before": before["passed"],
        "passed_after": after["passed"],
        "flipped": flipped,
        "equal": not flipped and all(map(tolerance.holds, *values)),
    }


def size(one: Mapping[str, Any]) -> float:
    """Relative change of a figure; a changed word counts as the largest change."""
    before, after = one["before"], one["after"]
    if before == after:
        return 0.0
    if not all(isinstance(value, float) for value in (before, after)):
        return np.inf
    return float(abs(after - before) / max(abs(before), abs(after)))


def judge(rows: Sequence[dict[str, Any]]) -> None:
    """Add each row's verdict: better, worse, same, or differs if there are too few seeds for a test."""
    tested = [one for one in rows if one["p"] is not None and not one["equal"]]
    adjusted = scipy.stats.false_discovery_control([one["p"] for one in tested]).tolist() if tested else []
    for one in rows:
        one["verdict"] = "same" if one["equal"] else "differs"
    for one, p in zip(tested, adjusted, strict=True):
        significant = p < FALSE_ALARMS and one["grows"] != 0.0
        one["verdict"] = ("better" if one["grows"] > 0.0 else "worse") if significant else "same"


def urgency(one: Mapping[str, Any]) -> tuple[Any, ...]:
    """Sorting key: newly missed checks, other flips, significant changes, other changes, equal figures."""
    newly_missed = one["flipped"] and one["passed_after"] is not True
    return not newly_missed, not one["flipped"], one["equal"], one["verdict"] == "same", -size(one)


def index_by_name(suite: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The scenarios of a suite by their names."""
    return {one["name"]: one for one in suite["scenarios"]}


def find_only_in(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """The scenarios of one suite that the other has not run, and of the others the checks that it lacks."""
    found, run = [], index_by_name(other)
    for name, scenario in index_by_name(one).items():
        if name not in run:
            found.append(name)
            continue
        known = {(check["name"], check["limit"]) for check in run[name]["checks"]}
        checks = [(check["name"], check["limit"]) for check in scenario["checks"]]
        found += [f"{name}: {figure} {limit}" for figure, limit in checks if (figure, limit) not in known]
    return found


def changes(
    before: Mapping[str, Any], after: Mapping[str, Any], tolerances: Mapping[str, Tolerance] | None = None
) -> list[dict[str, Any]]:
    """Every check of scenarios and seeds that both suites have, in the order of `urgency`.

    Both suites are results of `run_suite`. A check is identified by its figure and its limit.
    """
    places = pair_seeds(before, after)
    of_before = index_by_name(before)
    rows = []
    for one in after["scenarios"]:
        known = {
            (check["name"], check["limit"]): check
            for check in of_before.get(one["name"], {"checks": []})["checks"]
        }
        for check in one["checks"]:
            other = known.get((check["name"], check["limit"]))
            if other is not None and places:
                tolerance = tolerance_of(tolerances or {}, check["name"])
                rows.append({"scenario": one["name"], **row(other, check, places, tolerance)})
    judge(rows)
    return sorted(rows, key=urgency)
