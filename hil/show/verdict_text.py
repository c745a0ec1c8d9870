"""The verdict as text for the log: the run, whether it passed, and each check with its limit."""

from collections.abc import Mapping
from typing import Any

from hil.judge.figures.text import figure_text
from hil.judge.verdict import CheckResult, RunVerdict, Verdict


def verdict_text(title: str, run: Mapping[str, Any], verdict: RunVerdict) -> str:
    """The verdict in Markdown; failed checks come first, then those that were not judged."""
    changes = "".join(f", {change}" for change in run.get("changes", []))
    lines = [
        f"### {verdict.verdict.words.upper()}: {title}",
        f"{run.get('scenario', '?')}{changes}, {run.get('clock', '?')} clock, seed {run.get('seed', '?')}",
        *(f"**{reason}**" for reason in verdict.reasons),
        *(f"**not judged: {reason}**" for reason in verdict.not_judged),
    ]
    rows = verdict.by_gravity
    if rows:
        table = ["| | check | measured | wanted |", "|---|---|---|---|"]
        table += [
            f"| {word_of(row)} | {row.name} | {figure_text(row.value)} | {row.limit} {row.unit} |"
            for row in rows
        ]
        lines.append("\n".join(table))
        lines += [f"{row.name}: {row.reason}" for row in rows if row.reason is not None]
    return "\n\n".join(lines)


def word_of(result: CheckResult) -> str:
    """Verdict on a check in words, in bold unless it passed."""
    words = result.verdict.words
    return words if result.verdict is Verdict.PASSED else f"**{words.upper()}**"
