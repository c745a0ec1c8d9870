"""What the failures of a suite mean: requirements broken, or only limits that scenarios have of their own."""

from collections.abc import Iterable
from typing import Any, NamedTuple

from hil.judge.verdict import RunVerdict, Verdict


class Failures(NamedTuple):
    """The failed scenarios by the gravest meaning of a check that they fail."""

    broken: dict[str, list[str]]
    """By the requirement whose limit they break."""
    without_limit: dict[str, list[str]]
    """By the requirement without a limit of the figure, for which they fail one of their own."""
    own_limits: list[str]
    """They fail only limits of their own, stricter than a requirement's or without one."""
    other: list[str]
    """They fail regardless of their checks."""

    @property
    def sentence(self) -> str:
        """The failures in one sentence; empty without any.

        >>> Failures({"P-07": ["c"], "S-01": ["c", "d"]}, {"S-11": ["e"]}, ["a"], []).sentence
        'failed: 2 broke P-07, S-01; 1 missed own limits for S-11; 1 missed only own limits'
        >>> Failures({}, {}, ["a", "b"], []).sentence
        'failed: 2 missed only own limits; none broke a requirement'
        >>> Failures({}, {}, [], []).sentence
        ''
        """
        broken, without_limit = (
            (len({one for names in by_id.values() for one in names}), ", ".join(sorted(by_id)))
            for by_id in (self.broken, self.without_limit)
        )
        parts = [
            (broken[0], f"broke {broken[1]}"),
            (without_limit[0], f"missed own limits for {without_limit[1]}"),
            (len(self.own_limits), "missed only own limits"),
            (len(self.other), "regardless of checks"),
        ]
        found = [f"{number} {text}" for number, text in parts if number]
        if found and not (self.broken or self.other):
            found.append("none broke a requirement")
        return f"failed: {'; '.join(found)}" if found else ""

    def as_json(self) -> dict[str, Any]:
        """The failures and their sentence, as in suite.json."""
        return {**self._asdict(), "sentence": self.sentence}


def failures_of(verdicts: Iterable[RunVerdict]) -> Failures:
    """The failures among these verdicts."""
    found = Failures({}, {}, [], [])
    for run in (one for one in verdicts if one.verdict is Verdict.FAILED):
        failed = [one for one in run.checks if one.verdict is Verdict.FAILED]
        broken = {one.requirement for one in failed if one.requirement and one.meets_requirement is False}
        without_limit = {
            one.requirement
            for one in failed
            if one.requirement and one.meets_requirement is None and one.required is None
        }
        if run.reasons:
            found.other.append(run.scenario)
        elif broken or without_limit:
            place = found.broken if broken else found.without_limit
            for name in broken or without_limit:
                place.setdefault(name, []).append(run.scenario)
        else:
            found.own_limits.append(run.scenario)
    return found
