"""Costs of methods: errors from one call, times as the minimum of interleaved repeats."""

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from tools.trade import own
from tools.trade.cases import Case, Errors, Method, errors_of
from tools.trade.peers import heyoka_peer, scipy_peer
from tools.trade.peers.automaton import has_peers

REPEATS, QUICK_REPEATS = 7, 3

ROW_US = 5e3
"""Shortest total time of a row of calls from which the cost of a call is computed, µs."""

COST_UNIT = "µs of processor per simulated second"
STATE_UNIT = "m (state at the end; velocity over ω)"

Progress = Callable[[str], None]


class Cost(NamedTuple):
    """Errors and time of one method on one case."""

    case: Case
    method: Method
    errors: Errors
    least_us_s: float

    @property
    def is_right(self) -> bool:
        """Whether the number of impacts is right."""
        return self.errors.impacts == self.errors.impacts_wanted

    def row(self) -> dict[str, Any]:
        """Return the cost as a JSON object."""
        return {
            "what": f"{self.case.name}: {self.method.name} {self.method.setting}".rstrip(),
            "kind": "solver",
            "case": self.case.name,
            "method": self.method.name,
            "setting": self.method.setting,
            **self.errors._asdict(),
            "cost": self.least_us_s,
            "unit": f"{STATE_UNIT}; {COST_UNIT}",
        }


def methods_of(case: Case, quick: bool) -> list[Method]:
    """Return all methods that are compared on a case."""
    found = own.methods(case, quick)
    if has_peers(case.parts):
        found += scipy_peer.methods(case)
        if heyoka_peer.is_installed():
            found += heyoka_peer.methods(case, quick)
    return found


def measure(case: Case, methods: Sequence[Method], repeats: int, progress: Progress) -> list[Cost]:
    """Measure the errors of all methods first, which also compiles them, then their times."""
    truth = own.truth(case)
    errors = []
    for method in methods:
        progress(f"{case.name}: {method.name} {method.setting}")
        errors.append(errors_of(case, method.solve(), truth))
    times = interleave([partial(spent_us, method.solve) for method in methods], repeats)
    return [
        Cost(case, method, error, least / case.until_s)
        for method, error, least in zip(methods, errors, times, strict=True)
    ]


def interleave(measurements: Sequence[Callable[[], float]], repeats: int) -> list[float]:
    """Repeat measurements of time, and return the least time of each; every repeat runs all of them in turn.

    The times are this thread's processor time, not wall time, because it depends less on other programs'
    load. The minimum is closest to the time on an idle machine.
    """
    rounds = [[measure() for measure in measurements] for _ in range(repeats)]
    return [min(row) for row in zip(*rounds, strict=True)]


def spent_us(solve: Callable[[], object]) -> float:
    """Processor time of a call, µs: of a row of calls that takes ROW_US in all, after a first call.

    At a first call the processor's caches hold another method's code. A first call of this length replaces
    the row.
    """
    begun = time.thread_time_ns()
    solve()
    first = (time.thread_time_ns() - begun) * 1e-3
    if first >= ROW_US:
        return first
    calls = math.ceil(ROW_US / first)
    begun = time.thread_time_ns()
    for _ in range(calls):
        solve()
    return (time.thread_time_ns() - begun) * 1e-3 / calls


def mean(values: Any) -> float:
    """Return the mean; nan of no values."""
    return float(np.mean(values)) if len(values) else math.nan


def pareto(costs: Sequence[Cost]) -> list[Cost]:
    """Return the costs that no other cost of the same case beats in both error and time.

    Methods with a wrong number of impacts are left out.
    """
    right = [cost for cost in costs if cost.is_right]
    return [
        cost
        for cost in right
        if not any(
            other.case is cost.case
            and other.errors.error <= cost.errors.error
            and other.least_us_s < cost.least_us_s
            for other in right
        )
    ]
