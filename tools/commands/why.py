"""`vibrohil why RUN`: the cause of a latched fault or of a failed check."""

import shlex
from collections.abc import Set
from typing import TYPE_CHECKING, Any

from rich.markup import escape

from tools.commands.options import Json, Logged
from tools.output import answer, console, figure, figure_table, mark_verdict, table_of

if TYPE_CHECKING:
    from hil.runs.recorded_run import Run

SHOWN_EVENTS = 10
"""Number of events around the cause that are shown."""


def why(run: Logged = None, as_json: Json = False) -> None:
    """Explain a latched fault or a failed check: what was injected, what the firmware saw, and which limit.

    The cause is the first of latched fault and failed checks, or what broke the run off. A limit has its row
    in docs/safety.md.
    """
    from hil.runs.recorded_run import open_run

    logged = open_run(run)
    payload = explain(logged)
    answer(payload, as_json, lambda: show(payload))


def explain(logged: "Run") -> dict[str, Any]:
    """The cause of a run's end, its limit, injected faults, failed checks, and the events around it."""
    from hil.judge.why.cause import find_cause
    from hil.record.run_faults import faults_of
    from hil.show.injected import injected_in, since

    verdict, faults = logged.judged, injected_in(logged.traces.run)
    cause = find_cause(logged.traces, verdict)
    at_s = verdict.figures.duration_s if cause is None else cause.at_s
    sentences = [*verdict.reasons, *verdict.not_judged]
    if cause is not None:
        sentences.insert(0, f"{cause.sentence}{since(faults, at_s)}")
    failed = [check for check in verdict.checks if check.passed is False]
    without_figure = {check.sentence for check in failed if check.value is None}
    return {
        "scenario": verdict.scenario,
        "verdict": verdict.verdict.value,
        "cause": sentences[0] if sentences else None,
        "at_s": None if cause is None else at_s,
        "limit": None if cause is None or cause.limit is None else cause.limit._asdict(),
        "possible_rows": [] if cause is None else list(cause.rows),
        "injected": [
            {"at_s": fault.from_s, "to_s": fault.to_s, "fault": fault.text, "acted_on": fault.acted}
            for fault in sorted(faults_of(logged.traces.run), key=lambda fault: fault.from_s)
        ],
        "failed": [check.sentence for check in failed if check.value is not None],
        "without_figure": verdict.reasons_of_checks,
        "events": events_around(logged, at_s, without_figure),
        "out": str(logged.folder),
    }


def events_around(logged: "Run", at_s: float, left_out: Set[str]) -> list[dict[str, Any]]:
    """The events of the log nearest to a time, in order of time, but for passed checks and `left_out`."""
    if "events" not in logged.names:
        return []
    from hil.show.highlights import PASSED

    table = logged.table("events")
    rows = zip(table["t_s"].to_pylist(), table["text"].to_pylist(), table["level"].to_pylist(), strict=True)
    events = [
        {"t_s": t_s, "text": text.partition("  ")[2], "level": level}
        for t_s, text, level in rows
        if PASSED not in text and text.partition(": ")[2] not in left_out
    ]
    nearest = sorted(events, key=lambda event: abs(event["t_s"] - at_s))[:SHOWN_EVENTS]
    return sorted(nearest, key=lambda event: event["t_s"])


def show(found: dict[str, Any]) -> None:
    """Print the cause with what belongs to it, then the events."""
    console.print(f"{mark_verdict(found['verdict'], loud=True)}  {escape(found['scenario'])}\n")
    console.print(escape(found["cause"] or "no fault was latched, and no check failed"), soft_wrap=True)
    for sentence in (*found["failed"], *found["without_figure"]):
        console.print(f"[red]{escape(sentence)}[/]", soft_wrap=True)
    rows = [
        ("injected fault", f"{one['fault']} at {figure(one['at_s'], 's')}{acted_on(one['acted_on'])}", "")
        for one in found["injected"]
    ]
    if limit := found["limit"]:
        rows += [("value", limit["value"], limit["unit"]), ("limit", limit["bound"], limit["unit"])]
        rows += [("parameter", limit["parameter"], "")] if limit["parameter"] else []
        rows += [("row of docs/safety.md", limit["row"], "")] if limit["row"] else []
    if found["possible_rows"]:
        rows.append(("row of docs/safety.md", f"one of: {'; '.join(found['possible_rows'])}", ""))
    if rows:
        console.print(figure_table(None, rows))
    console.print()
    events = ((f"{one['t_s']:.3f} s", escape(one["text"])) for one in found["events"])
    console.print(table_of((">time", "event"), events))
    console.print(
        f"\n[dim]look at every signal:[/] vibrohil view {escape(shlex.quote(found['out']))}", soft_wrap=True
    )


def acted_on(count: int | None) -> str:
    """How often an injected fault acted, as far as the run has counted."""
    return "" if count is None else f", acted {'once' if count == 1 else f'{count:,} times'}"
