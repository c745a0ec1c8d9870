"""One scenario run with several seeds, which sample noise and fault times, and the merged verdict.

The merged verdict has the worst figure of each check.
"""

import copy
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hil.judge.checks import Check, margin
from hil.scenario.scenario import Scenario, check_scenario

AS_WRITTEN = 1
"""The seed with which faults begin at the scenario's own times."""
DRIVE_PERIOD_S = 0.61
"""Drive period at r = 1.1, where faults are injected: a delay by one period does not change the phase."""
SEED_OF_FAULT_TIMES = 4000
"""Independent of the seeds of all faults."""


def at_other_times(scenario: Scenario, seed: int) -> Scenario:
    """Delay the first fault, all later lines of the script and the run's end by a sampled time.

    The time is less than a drive period. The scenario is unchanged with the seed `AS_WRITTEN`, or if a fault
    begins at time 0.
    """
    first_s = min((fault.at_s for fault in scenario.faults), default=0.0)
    if seed == AS_WRITTEN or first_s == 0.0:
        return scenario
    ticks = DRIVE_PERIOD_S / scenario.period_s
    by_ticks = int(np.random.default_rng([seed, SEED_OF_FAULT_TIMES]).integers(1, int(ticks)))
    document = copy.deepcopy(dict(scenario.document))
    script = document["script"]
    for line in [script, *script.get("commands", []), *script["faults"]]:
        key = "duration_s" if line is script else "at_s"
        if line is script or line[key] >= first_s:
            line[key] = round(line[key] + by_ticks * scenario.period_s, 6)
    return check_scenario(document, scenario.name, scenario.changes)


def worst_of(check: Check, results: Mapping[int, Mapping[str, Any]]) -> dict[str, Any]:
    """Merge one check's results by seed into its worst result.

    Adds the worst result's seed, the number of seeds in which the check passed, the lowest and the highest
    value (None if the values are not numbers), and every seed's value and margin (None if it is infinite).
    """
    seed = min(results, key=lambda one: (results[one]["passed"], margin(check, results[one]["value"])))
    values = [results[one]["value"] for one in sorted(results)]
    margins = [margin(check, value) for value in values]
    numbers = [one for one in values if isinstance(one, int | float) and not isinstance(one, bool)]
    return {
        **results[seed],
        "seed": seed,
        "passed_seeds": sum(bool(one["passed"]) for one in results.values()),
        "lowest": min(numbers, default=None),
        "highest": max(numbers, default=None),
        "values": values,
        "margins": [inside if math.isfinite(inside) else None for inside in margins],
    }


def merged(checks: Sequence[Check], verdicts: Mapping[int, Mapping[str, Any]]) -> dict[str, Any]:
    """Merge a scenario's verdicts by seed, based on the first failed run or otherwise on the first run.

    The merged verdict has passed if all have. `checks`: the scenario's, in the order of the verdicts'
    results.
    """
    failed = [seed for seed, verdict in sorted(verdicts.items()) if not verdict["passed"]]
    shown = verdicts[failed[0] if failed else min(verdicts)]
    results = [
        worst_of(check, {seed: verdict["checks"][number] for seed, verdict in verdicts.items()})
        for number, check in enumerate(checks)
    ]
    reasons = [f"seed {seed}: {reason}" for seed in failed for reason in verdicts[seed]["reasons"]]
    return {
        **shown,
        "checks": results,
        "reasons": reasons,
        "passed": not failed,
        "real_time": None
        if shown["real_time"] is None
        else all(one["real_time"] for one in verdicts.values()),
        "seeds": len(verdicts),
        "passed_seeds": len(verdicts) - len(failed),
        "failed_seeds": failed,
        "work_ratios": [work_ratio(verdict) for _, verdict in sorted(verdicts.items())],
    }


def work_ratio(verdict: Mapping[str, Any]) -> float | None:
    """Ratio of the firmware's to the plant's median work per tick; None if either was not timed."""
    firmware, plant = (verdict["loops"][name]["work_us"]["p50"] for name in ("firmware", "plant"))
    return float(firmware / plant) if firmware and plant else None
