"""The verdict as text for the log: the run, whether it passed, and each check with its limit."""

from collections.abc import Mapping, Sequence
from typing import Any

from hil.judge.checks import CheckResult


def verdict_text(
    title: str, run: Mapping[str, Any], results: Sequence[CheckResult], reasons: Sequence[str]
) -> str:
    """The verdict in Markdown; failed checks come first."""
    failed = [result for result in results if not result.passed]
    word = "NOT JUDGED" if not results and not reasons else "FAILED" if failed or reasons else "PASSED"
    changes = "".join(f", {change}" for change in run.get("changes", []))
    lines = [
        f"### {word}: {title}",
        f"{run.get('scenario', '?')}{changes}, {run.get('clock', '?')} clock, seed {run.get('seed', '?')}",
        *(f"**{reason}**" for reason in reasons),
    ]
    rows = [*failed, *(result for result in results if result.passed)]
    if rows:
        table = ["| | check | measured | wanted |", "|---|---|---|---|"]
        table += [
            f"| {word_of(row)} | {row.name} | {measured(row)} | {row.limit} {row.unit} |" for row in rows
        ]
        lines.append("\n".join(table))
    return "\n\n".join(lines)


def word_of(result: CheckResult) -> str:
    """Result of a check as a word, in bold if it failed."""
    return "passed" if result.passed else "**FAILED**"


def measured(result: CheckResult) -> str:
    """A check's value as text; a dash if the run does not have it."""
    if result.value is None:
        return "—"
    return f"{result.value:.4g}" if isinstance(result.value, float) else str(result.value)
