"""Results of a campaign: shares with bounds, distributions, goals met or missed."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tools.campaign.campaign import Campaign, Cell, Goal, Outcome
from tools.campaign.sampling import FIRST_CAMPAIGN_SEED
from tools.campaign.statistics import distribution, wilson

LEAST_PROVEN_PERCENT = 90.0
"""A cell whose successes prove less than this share has too few trials."""


def totals_of(outcomes: Sequence[Outcome]) -> dict[str, tuple[int, int]]:
    """Return the part and the whole of each share, summed over the outcomes."""
    parts, wholes = Counter[str](), Counter[str]()
    for outcome in outcomes:
        for name, (part, whole) in outcome.shares.items():
            parts[name] += part
            wholes[name] += whole
    return {name: (parts[name], whole) for name, whole in wholes.items() if whole}


def shares_of(totals: Mapping[str, tuple[int, int]]) -> dict[str, dict[str, float]]:
    """Return the shares with Wilson's bounds, and the F1 score of impact detection."""
    found = {name: {**wilson(*total)._asdict(), "n": total[1]} for name, total in totals.items()}
    hits, touch_downs = totals.get("recall", (0, 0))
    if hits:
        right, detections = totals["precision"]
        wrong = touch_downs - hits + detections - right
        found["f1"] = {"value": 2 * hits / (2 * hits + wrong), "n": hits + wrong}
    return found


def values_of(outcomes: Sequence[Outcome]) -> dict[str, list[float]]:
    """Return the values of each metric over the eligible trials; the samples of a trial are pooled."""
    values: dict[str, list[float]] = {}
    for outcome in outcomes:
        if outcome.eligible:
            for name, value in outcome.metrics.items():
                values.setdefault(name, []).append(value)
            for name, some in outcome.samples.items():
                values.setdefault(name, []).extend(some)
    return values


def figure_of(goal: Goal, result: dict[str, Any]) -> float | None:
    """Return the value to which a goal applies; None if nothing was measured."""
    if goal.figure == "success":
        return result["success"] / result["eligible"] if result["eligible"] else None
    if goal.figure == "eligible":
        return float(result["eligible"])
    if goal.figure in result["shares"]:
        return float(result["shares"][goal.figure]["value"])
    metric = result["metrics"].get(goal.figure)
    return None if metric is None or goal.quantile is None else float(metric[goal.quantile])


def meets_goal(goal: Goal, value: float | None) -> bool | None:
    """Return whether a goal is met; None if nothing was measured."""
    if value is None:
        return None
    above = goal.low is None or value >= goal.low
    below = goal.high is None or value <= goal.high
    return math.isfinite(value) and above and below


def verdict_of(passed: Sequence[bool | None]) -> bool | None:
    """Return False if a goal is missed, None if one is not measured or there are none, else True.

    >>> verdict_of([True, None]), verdict_of([None, False]), verdict_of([])
    (None, False, None)
    """
    if False in passed:
        return False
    return True if passed and None not in passed else None


def why_not_judged(campaign: Campaign, goals: Sequence[Mapping[str, Any]], trials: int) -> list[str]:
    """What is missing for a verdict: the goals without a value, or all of them; a sentence each."""
    unmeasured = [str(goal["figure"]) for goal in goals if goal["passed"] is None]
    if goals:
        return [f"{figure}: no eligible trial of {trials} has this figure" for figure in unmeasured]
    wanted = ", ".join(" ".join(filter(None, (goal.where, goal.figure))) for goal in campaign.goals)
    return [
        f"no goal applies: {wanted} want {campaign.trials} trials, or a condition that --set has left out"
    ]


def note_few_trials(cells: Sequence[Mapping[str, Any]]) -> list[str]:
    """What the cell with the fewest trials leaves open, in a sentence; none if that is little.

    >>> note_few_trials([{"cell": "r=1.3", "eligible": 2}])
    ['too few trials: if all 2 of r=1.3 succeed, the true share of successes may still be 34 %']
    >>> note_few_trials([{"cell": "r=1.3", "eligible": 40}]), note_few_trials([{"cell": "a", "eligible": 0}])
    ([], ['too few trials: none of a'])
    """
    fewest = min(cells, key=lambda cell: int(cell["eligible"]))
    trials = int(fewest["eligible"])
    percent = 100.0 * wilson(trials, trials).low
    if percent >= LEAST_PROVEN_PERCENT:
        return []
    if trials == 0:
        return [f"too few trials: none of {fewest['cell']}"]
    return [
        f"too few trials: if all {trials} of {fewest['cell']} succeed, the true share of successes may still "
        f"be {percent:.0f} %"
    ]


def summary(campaign: Campaign, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return the numbers of trials, the shares and the metrics of the outcomes."""
    eligible = [one for one in outcomes if one.eligible]
    success = sum(one.why == "" for one in eligible)
    spreads = {name: distribution(np.array(values)) for name, values in values_of(outcomes).items()}
    return {
        "trials": len(outcomes),
        "eligible": len(eligible),
        "success": success,
        "success_share": wilson(success, len(eligible))._asdict(),
        "shares": shares_of(totals_of(outcomes)),
        "metrics": {
            name: {**spread._asdict(), "unit": campaign.units.get(name, "1")}
            for name, spread in spreads.items()
            if spread is not None
        },
    }


def result_of(
    campaign: Campaign,
    cells: Sequence[Cell],
    outcomes: Sequence[Outcome],
    seed: int,
    wall_s: float,
    changed: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the JSON object of a campaign; `changed`: its parameter files and settings."""
    by_cell = [[outcome for outcome in outcomes if outcome.cell == number] for number in range(len(cells))]
    goals: list[dict[str, Any]] = []
    for goal in campaign.goals:
        some = [
            outcome
            for cell, part in zip(cells, by_cell, strict=True)
            if cell.name.startswith(goal.where)
            for outcome in part
        ]
        has_cell = any(cell.name.startswith(goal.where) for cell in cells)  # --set may leave conditions out
        if not has_cell or (goal.full_size and len(outcomes) < campaign.trials):
            continue
        value = figure_of(goal, summary(campaign, some)) if some else None
        goals.append(
            {
                "figure": " ".join(word for word in (goal.where, goal.figure, goal.quantile) if word),
                "value": value,
                "unit": campaign.units.get(goal.figure, ""),
                "low": goal.low,
                "high": goal.high,
                "passed": meets_goal(goal, value),
                "wanted": goal.wanted,
                "reason": goal.reason,
            }
        )
    summaries = [
        {"cell": cell.name, **summary(campaign, part)} for cell, part in zip(cells, by_cell, strict=True)
    ]
    simulated_s = sum(outcome.simulated_s for outcome in outcomes)
    # The median is not affected by the few trials that compiled or loaded kernels.
    speeds = [outcome.simulated_s / outcome.compute_s for outcome in outcomes if outcome.compute_s > 0.0]
    return {
        "campaign": campaign.name,
        "title": campaign.title,
        "changed": list(changed),
        "seed": seed,
        "tuning_seed": seed < FIRST_CAMPAIGN_SEED,
        **summary(campaign, outcomes),
        "failures": [
            {"trial": outcome.trial, "seed": seed, "cell": cells[outcome.cell].name, "why": outcome.why}
            for outcome in outcomes
            if outcome.eligible and outcome.why
        ],
        "ineligible": dict(Counter(outcome.why for outcome in outcomes if not outcome.eligible)),
        "cells": summaries,
        "notes": note_few_trials(summaries),
        "goals": goals,
        "passed": verdict_of([goal["passed"] for goal in goals]),
        "not_judged": why_not_judged(campaign, goals, len(outcomes)),
        "wall_s": wall_s,
        "simulated_s": simulated_s,
        "realtime_factor_a_core": float(np.median(speeds)) if speeds else math.nan,
    }
