"""The verdict on a scenario in one or several seeds, with the worst figure of each check."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from hil.judge.evaluation import margin
from hil.judge.verdict import BY_GRAVITY, CheckResult, RunVerdict, Verdict
from hil.scenario.checks import Check, Value


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioCheck(CheckResult):
    """The worst result of a check over the seeds, which is that of `seed`.

    `lowest` and `highest` are None if the values are not numbers. `values` and `margins` are in the order of
    the seeds; an infinite margin is None.
    """

    seed: int
    passed_seeds: int
    lowest: float | None
    highest: float | None
    values: tuple[Value | None, ...]
    margins: tuple[float | None, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioVerdict(RunVerdict):
    """The verdict on a scenario: the worst result of each check, and figures and folder of one worst run."""

    checks: tuple[ScenarioCheck, ...] = ()
    seeds: int
    failed_seeds: tuple[int, ...]
    not_judged_seeds: tuple[int, ...]

    @property
    def passed_seeds(self) -> int:
        """Number of seeds in which the scenario has passed."""
        return self.seeds - len(self.failed_seeds) - len(self.not_judged_seeds)

    def summary(self) -> dict[str, Any]:
        """The scenario in suite.json; `out` is the path of the shown run's folder."""
        checks = [check.as_json() for check in self.checks]
        return {
            "name": self.scenario,
            "passed": self.passed,
            "verdict": self.verdict.value,
            "seeds": self.seeds,
            "passed_seeds": self.passed_seeds,
            "failed_seeds": list(self.failed_seeds),
            "not_judged_seeds": list(self.not_judged_seeds),
            "real_time": self.figures.real_time,
            "reasons": list(self.reasons),
            "not_judged": list(self.not_judged),
            "failed": [check for check in checks if check["verdict"] == Verdict.FAILED],
            "checks": checks,
            "out": str(self.folder),
        }


def worst_of(check: Check, results: Mapping[int, CheckResult]) -> ScenarioCheck:
    """Merge one check's results by seed into its worst result."""
    seed = min(
        results,
        key=lambda one: (BY_GRAVITY.index(results[one].verdict), margin(check, results[one].value)),
    )
    values = tuple(results[one].value for one in sorted(results))
    margins = (margin(check, value) for value in values)
    numbers = [one for one in values if isinstance(one, int | float) and not isinstance(one, bool)]
    worst_result = {one.name: getattr(results[seed], one.name) for one in fields(CheckResult)}
    met = {one.meets_requirement for one in results.values()}
    worst_result["meets_requirement"] = False if False in met else None if None in met else True
    return ScenarioCheck(
        **worst_result,
        seed=seed,
        passed_seeds=sum(one.verdict is Verdict.PASSED for one in results.values()),
        lowest=min(numbers, default=None),
        highest=max(numbers, default=None),
        values=values,
        margins=tuple(inside if math.isfinite(inside) else None for inside in margins),
    )


def merge(checks: Sequence[Check], verdicts: Mapping[int, RunVerdict]) -> ScenarioVerdict:
    """Merge a scenario's verdicts by seed; `checks`: its checks, in the order of the verdicts' results."""
    seeds = sorted(verdicts)
    failed = tuple(seed for seed in seeds if verdicts[seed].verdict is Verdict.FAILED)
    not_judged = tuple(seed for seed in seeds if verdicts[seed].verdict is Verdict.NOT_JUDGED)
    shown = verdicts[[*failed, *not_judged, *seeds][0]]
    in_time = shown.figures.real_time
    if in_time is not None:
        in_time = all(one.figures.real_time for one in verdicts.values())
    known = {one.name: getattr(shown, one.name) for one in fields(RunVerdict)}
    known |= {
        "figures": replace(shown.figures, real_time=in_time),
        "checks": tuple(
            worst_of(check, {seed: verdict.checks[number] for seed, verdict in verdicts.items()})
            for number, check in enumerate(checks)
        ),
        "reasons": tuple(f"seed {seed}: {reason}" for seed in seeds for reason in verdicts[seed].reasons),
        "doubts": merge_doubts(verdicts),
    }
    return ScenarioVerdict(
        **known,
        seeds=len(verdicts),
        failed_seeds=failed,
        not_judged_seeds=not_judged,
    )


def merge_doubts(verdicts: Mapping[int, RunVerdict]) -> tuple[str, ...]:
    """The doubts, each once if all seeds give it, else with its seed."""
    seeds = sorted(verdicts)
    lines: list[str] = []
    for reason in dict.fromkeys(reason for seed in seeds for reason in verdicts[seed].doubts):
        its_seeds = [seed for seed in seeds if reason in verdicts[seed].doubts]
        lines += [reason] if its_seeds == seeds else [f"seed {seed}: {reason}" for seed in its_seeds]
    return tuple(lines)
