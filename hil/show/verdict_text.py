"""The verdict as text for the log: the run, whether it passed, and each check with its limit."""

import re
from collections.abc import Mapping
from typing import Any

from hil.figures.text import figure_text
from hil.judge.verdict import CheckResult, RunVerdict, Verdict

MARKUP = re.compile(r"[\\`*\[\]<>!|&~#]")


def verdict_text(title: str, run: Mapping[str, Any], verdict: RunVerdict) -> str:
    """The verdict in Markdown; failed checks come first, then those that were not judged."""
    changes = "".join(f", {plain(change)}" for change in run.get("changes", []))
    name, clock, seed = (plain(run.get(key, "?")) for key in ("scenario", "clock", "seed"))
    lines = [
        f"### {verdict.verdict.words.upper()}: {plain(title)}",
        f"{name}{changes}, {clock} clock, seed {seed}",
        *(f"**{plain(reason)}**" for reason in verdict.reasons),
        *(f"**not judged: {plain(reason)}**" for reason in verdict.not_judged),
    ]
    rows = verdict.by_gravity
    if rows:
        table = ["| | check | measured | wanted |", "|---|---|---|---|"]
        table += [
            f"| {word_of(row)} | {plain(row.name)} | {figure_text(row.value)} | {row.limit} {row.unit} |"
            for row in rows
        ]
        lines.append("\n".join(table))
        lines += map(plain, verdict.reasons_of_checks)
    return "\n\n".join(lines)


def plain(text: object) -> str:
    """A text of a scenario as Markdown that shows it: no picture or HTML, which the viewer would fetch.

    >>> print(plain("![x](http://a/b.png) <img>"))
    \\!\\[x\\](http://a/b.png) \\<img\\>
    """
    return MARKUP.sub(r"\\\g<0>", " ".join(str(text).split()))


def word_of(result: CheckResult) -> str:
    """Verdict on a check in words, in bold unless it passed."""
    words = result.verdict.words
    return words if result.verdict is Verdict.PASSED else f"**{words.upper()}**"
