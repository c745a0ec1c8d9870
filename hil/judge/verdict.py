"""Verdicts: a check, a run, a scenario or a suite has passed, has failed, or was not judged.

`RunVerdict` is the verdict on a run. JSON, JUnit, terminal, report and log are views of it.

Not judged means that a run proves nothing: the bench itself disturbed it or lost data, a fault of its script
acted on nothing, or it has no check. A figure that a judged run does not have fails its check.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple

from hil.figures.records import CATALOGUE, Figures, Number, incomplete, no_figures
from hil.figures.text import figure_text
from hil.record import formats, provenance
from hil.scenario.checks import Check, Value, requirements
from hil.timing.clock import IMPORTED

KILLED = "the run is not finished, or its process was killed before the verdict"
NO_CHECKS = "nothing was checked; give the scenario a table [[checks]]"
NO_SCENARIO = "an imported log has no scenario, and so no checks"


class Verdict(StrEnum):
    """The three answers."""

    PASSED = "passed"
    FAILED = "failed"
    NOT_JUDGED = "not-judged"

    @property
    def passed(self) -> bool | None:
        """True or False; None if not judged."""
        return None if self is Verdict.NOT_JUDGED else self is Verdict.PASSED

    @property
    def words(self) -> str:
        """The verdict for people: passed, failed or not judged."""
        return self.value.replace("-", " ")


BY_GRAVITY = (Verdict.FAILED, Verdict.NOT_JUDGED, Verdict.PASSED)
"""The verdicts, the worst first."""


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """The verdict on a whole from those on its parts: failed, else not judged, else passed.

    >>> worst([Verdict.PASSED, Verdict.NOT_JUDGED]).words
    'not judged'
    >>> worst([Verdict.NOT_JUDGED, Verdict.FAILED]).words
    'failed'
    >>> worst([]).words
    'not judged'
    """
    found = set(verdicts) or {Verdict.NOT_JUDGED}
    return next(one for one in BY_GRAVITY if one in found)


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Result of one check: verdict, measured value, unit and limit.

    `reason` says why the check was not judged, or why the run does not have its figure. `margin_share`:
    distance to the nearest limit as a share of the limits' half width, or of the only limit; None for texts.
    """

    name: str
    verdict: Verdict
    value: Value | None
    unit: str
    limit: str
    requirement: str | None = None
    reason: str | None = None
    margin_share: float | None = None
    required: str | None = None
    """The requirement's limit where the scenario's own is stricter."""
    meets_requirement: bool | None = None
    """Whether the value meets the requirement's limit; None without such a limit, or if not judged."""

    @classmethod
    def of(
        cls,
        check: Check,
        verdict: Verdict,
        value: Value | None,
        reason: str | None,
        margin_share: float | None = None,
    ) -> "CheckResult":
        """The result of a check of a scenario."""
        return cls(
            name=check.name,
            verdict=verdict,
            value=value,
            unit=check.unit or "" if check.expression is not None else CATALOGUE[check.name].unit,
            limit=check.limit,
            requirement=check.requirement,
            reason=reason,
            margin_share=margin_share,
            required=check.required.text if check.required not in (None, check.bounds) else None,
        )

    @property
    def passed(self) -> bool | None:
        """Whether the check has passed; None if not judged."""
        return self.verdict.passed

    @property
    def sentence(self) -> str:
        """The measured value, the limit and the reason: `peak_force_n is 250 N, wanted ≤ 100 N`."""
        found = "not there" if self.value is None else figure_text(self.value, self.unit)
        reason = "" if self.reason is None else f": {self.reason}"
        own = "" if self.required is None else self.of_the_scenario
        return f"{self.name} is {found}, wanted {self.limit} {self.unit}".rstrip() + own + reason

    @property
    def of_the_scenario(self) -> str:
        """Says that the limit is the scenario's own, for its module, and names the requirement's."""
        required = f"{self.required} {self.unit}".rstrip()
        return f" (the scenario's own limit, for its module; {self.requirement} requires {required})"

    @property
    def on_its_requirement(self) -> Verdict:
        """The verdict on the requirement: a value beyond the scenario's own limit alone may meet it.

        If another seed was not judged, it is not known whether the requirement is met.
        """
        if self.meets_requirement is None and self.required is not None:
            return Verdict.NOT_JUDGED
        return Verdict.PASSED if self.meets_requirement else self.verdict

    @property
    def margin_percent(self) -> int | None:
        """The margin in percent: 0 at the limit, 100 in the middle of two limits, down to −100 beyond one."""
        return None if self.margin_share is None else round(100.0 * min(max(self.margin_share, -1.0), 1.0))

    def as_json(self) -> dict[str, Any]:
        """The result in JSON's types, as in verdict.json."""
        return {**asdict(self), "verdict": self.verdict.value, "passed": self.passed}


class FaultEffect(NamedTuple):
    """What a fault of the script acted on: frames, readings, ticks or starts; None if that is unknown."""

    kind: str
    at_s: float
    acted_on: int | None


@dataclass(frozen=True, slots=True)
class RunVerdict:
    """The verdict on one run, its figures, and what it rests on."""

    figures: Figures
    checks: tuple[CheckResult, ...] = ()
    reasons: tuple[str, ...] = ()
    """Reasons why the run fails regardless of its checks, one sentence each."""
    doubts: tuple[str, ...] = ()
    """Reasons why the run is not judged, one sentence each."""
    faults: tuple[FaultEffect, ...] = ()
    first_failure_s: Number = None
    """Time in s of the first failed check; None without one."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    folder: Path = Path()

    @property
    def scenario(self) -> str:
        """The scenario's name."""
        return self.figures.scenario

    @property
    def verdict(self) -> Verdict:
        """The verdict on the run."""
        if self.reasons:
            return Verdict.FAILED
        doubted = [Verdict.NOT_JUDGED] * len(self.doubts)
        return worst([*doubted, *(check.verdict for check in self.checks)])

    @property
    def passed(self) -> bool | None:
        """Whether the run has passed; None if not judged."""
        return self.verdict.passed

    @property
    def not_judged(self) -> tuple[str, ...]:
        """The doubts, or that nothing was checked."""
        if self.checks or self.reasons:
            return self.doubts
        return (*self.doubts, NO_SCENARIO if self.figures.clock == IMPORTED else NO_CHECKS)

    @property
    def why_not_passed(self) -> list[str]:
        """All reasons why the run has not passed, one sentence each."""
        doubts = [f"not judged: {reason}" for reason in self.not_judged]
        return [*self.reasons, *doubts, *(check.sentence for check in self.checks if not check.passed)]

    @property
    def by_gravity(self) -> list[CheckResult]:
        """The checks, those that have failed first, then those that were not judged."""
        return sorted(self.checks, key=lambda check: BY_GRAVITY.index(check.verdict))

    @property
    def reasons_of_checks(self) -> list[str]:
        """Why checks have no figure or are not judged: one sentence for all checks with the same reason."""
        reasons = dict.fromkeys(check.reason for check in self.checks if check.reason is not None)
        return [
            f"{', '.join(check.name for check in self.checks if check.reason == reason)}: {reason}"
            for reason in reasons
        ]

    @property
    def incomplete(self) -> list[str]:
        """Names of the figures that are computed from a log which lacks frames."""
        return incomplete(self.figures)

    @property
    def lost_frames(self) -> str | None:
        """The frames that can.log lacks, and the figures that are incomplete; None if no loss is known."""
        if not self.incomplete:
            return None
        return (
            f"can.log lacks {self.figures.log.frames_lost} frames; incomplete: {', '.join(self.incomplete)}"
        )

    def as_json(self) -> dict[str, Any]:
        """The content of verdict.json, with the path of the run's folder as `out`."""
        return {
            formats.KEY: formats.VERDICT,
            **self.figures.as_json(),
            "provenance": dict(self.provenance),
            "first_failure_s": self.first_failure_s,
            "incomplete": self.incomplete,
            "faults": [effect._asdict() for effect in self.faults],
            "checks": [check.as_json() for check in self.checks],
            "reasons": list(self.reasons),
            "not_judged": list(self.not_judged),
            "verdict": self.verdict.value,
            "passed": self.passed,
            "out": str(self.folder),
        }


def without_records(run: Mapping[str, Any], checks: Iterable[Check], reason: str, folder: Path) -> RunVerdict:
    """The failed verdict on a run of which nothing is recorded; `run` is the content of its `run.json`."""
    return RunVerdict(
        figures=replace(no_figures(Figures), scenario=str(run["scenario"]), clock=str(run["clock"])),
        checks=tuple(CheckResult.of(check, Verdict.FAILED, None, "nothing is recorded") for check in checks),
        reasons=(reason,),
        provenance={key: run.get(key) for key in provenance.KEYS},
        folder=folder,
    )


def failed_for(verdict: RunVerdict, reasons: Sequence[str]) -> RunVerdict:
    """The verdict with the same figures that fails for these reasons."""
    return replace(verdict, reasons=tuple(reasons), doubts=())


def trace(verdicts: Iterable[RunVerdict]) -> dict[str, Any]:
    """For each requirement the checks that prove it, and the verdict on it (None if none has run).

    A run that fails or is not judged regardless of its checks proves no requirement. A value beyond the
    scenario's own limit alone meets the requirement.
    """
    proofs: dict[str, list[tuple[Verdict, dict[str, Any]]]] = {name: [] for name in requirements()}
    for run in verdicts:
        of_run = Verdict.FAILED if run.reasons else Verdict.NOT_JUDGED if run.not_judged else None
        for check in run.checks:
            if check.requirement is not None:
                verdict = of_run or check.on_its_requirement
                proof: dict[str, Any] = {"scenario": run.scenario, "name": check.name, "limit": check.limit}
                proof |= {"passed": verdict.passed, "verdict": verdict.value}
                proofs[check.requirement].append((verdict, proof))
    return {
        name: {
            "text": requirements()[name].text,
            "passed": worst(verdict for verdict, _ in found).passed,
            "verdict": worst(verdict for verdict, _ in found).value if found else None,
            "checks": [proof for _, proof in found],
        }
        for name, found in proofs.items()
    }
