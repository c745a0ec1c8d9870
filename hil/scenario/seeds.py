"""One scenario run with several seeds, which sample noise and fault times."""

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import numpy as np

from hil.scenario.checks import LONGEST_S
from hil.scenario.scenario import Scenario, check_scenario

AS_WRITTEN = 1
"""The seed with which faults begin at the scenario's own times."""
SEED_OF_FAULT_TIMES = 4000
"""Independent of the seeds of all faults."""


def delay_faults(scenario: Scenario, seed: int) -> Scenario:
    """Delay the first fault, all that comes later in script and checks, and the run's end by a sampled time.

    Without a fault the last command is delayed, where the script states its `longest_delay_s`.

    The time is less than the script's `longest_delay_s`, and makes no run longer than a day. The scenario
    is unchanged with the seed `AS_WRITTEN`, if a fault begins at time 0, or if the longest delay is less than
    two ticks.
    """
    first_s = min((fault.at_s for fault in scenario.faults), default=0.0)
    if not scenario.faults and "longest_delay_s" in scenario.document["script"]:
        first_s = max((command.at_s for command in scenario.commands), default=0.0)
    most_s = min(scenario.longest_delay_s, LONGEST_S - scenario.duration_s)
    most_ticks = int(most_s / scenario.period_s)
    if seed == AS_WRITTEN or first_s == 0.0 or most_ticks < 2:
        return scenario
    by_ticks = int(np.random.default_rng([seed, SEED_OF_FAULT_TIMES]).integers(1, most_ticks))
    document = shift_times(scenario.document, first_s, by_ticks * scenario.period_s)
    return check_scenario(document, scenario.name, scenario.changes)


def shift_times(document: Mapping[str, Any], since_s: float, by_s: float) -> dict[str, Any]:
    """A copy of a scenario's tables in which every time t ≥ `since_s` of script and checks is t + `by_s`.

    The run becomes longer by `by_s`. Times keep a resolution of 1 µs.
    """
    moved: dict[str, Any] = deepcopy(dict(document))
    script = moved["script"]
    script["duration_s"] = round(script["duration_s"] + by_s, 6)
    lines = [*script.get("commands", []), *script.get("faults", [])]
    for table, key in [
        *((line, "at_s") for line in lines),
        *((check, key) for check in moved.get("checks", []) for key in ("from_s", "to_s")),
    ]:
        if key in table and table[key] >= since_s:
            table[key] = round(table[key] + by_s, 6)
    return moved
