"""One self-contained HTML page per run: the verdict, its explanation, and the run's origin."""

import os
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import tomli_w
from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from hil.figures.gaps import longest_gaps, longest_holds
from hil.figures.records import CATALOGUE, Figures, value_of
from hil.figures.text import figure_text, main_figures
from hil.judge.failures import failures_of
from hil.judge.seeds import ScenarioVerdict
from hil.judge.verdict import BY_GRAVITY, RunVerdict, worst
from hil.judge.why.cause import Cause, find_cause
from hil.record.new_file import write_anew
from hil.record.run_faults import EARLIER_VERSION, lacks_faults
from hil.record.run_traces import RunTraces
from hil.run_files import RunFile
from hil.show.injected import injected_in, since
from hil.show.report.picture import shapes
from hil.show.report.run_picture import close_up, whole_run

LINKED = (RunFile.LOG, RunFile.CAN_LOG, RunFile.SCENARIO, RunFile.VERDICT)
"""Files of the run to which the page links."""


@cache
def template(name: str) -> Template:
    """One of the templates beside this module."""
    environment = Environment(
        loader=PackageLoader("hil.show.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    return environment.get_template(name)


def happenings(traces: RunTraces, cause: Cause | None) -> list[str]:
    """The injected faults, and the latched fault or the first failed check, one sentence each."""
    faults = injected_in(traces.run)
    lines = [f"Injected fault at {fault.from_s:g} s: {fault.text}." for fault in faults]
    if lacks_faults(traces.run, traces.scenario):
        lines.append(f"{EARLIER_VERSION}.")
    if cause is None:
        return lines
    return [*lines, f"{cause.sentence[0].upper()}{cause.sentence[1:]}{since(faults, cause.at_s)}."]


def pictures_of(traces: RunTraces, figures: Figures, cause: Cause | None) -> list[tuple[Markup, str]]:
    """The pictures of a run as SVG, with their captions."""
    found = [
        (
            whole_run(traces, figures.duration_s, cause),
            "The whole run; the red line is the cause." if cause else "The whole run.",
        )
    ]
    if cause is not None:
        found.append((close_up(traces, figures.duration_s, cause), f"Close-up around {cause.at_s:.3f} s."))
    svg = template("picture.svg.j2")
    return [(Markup(svg.render(shapes(one))), caption) for one, caption in found if one is not None]


def write_report(path: Path, traces: RunTraces, verdict: RunVerdict) -> None:
    """Write the page of one run."""
    figures, cause = verdict.figures, find_cause(traces, verdict)
    page = template("report.html.j2").render(
        verdict=verdict,
        title=traces.scenario.get("title", verdict.scenario),
        changes=traces.run.get("changes", []),
        main_figures=[(label, figure_text(*shown)) for label, *shown in main_figures(figures)],
        happenings=happenings(traces, cause),
        pictures=pictures_of(traces, figures, cause),
        files=[name for name in LINKED if (path.parent / name).exists()],
        rows=[
            (spec.name, figure_text(value_of(figures, spec.name), spec.unit), spec.meaning)
            for spec in CATALOGUE.values()
        ],
        scenario=tomli_w.dumps(dict(traces.scenario)),
        longest_holds=longest_holds(figures.time_held),
        longest_gaps=longest_gaps(figures.gaps),
        made_with=describe_origin(traces.run),
        text=figure_text,
    )
    write_anew(path, page)


def describe_origin(run: Mapping[str, Any]) -> dict[str, str]:
    """How a run was made, in text: its versions and the single values of its run.json."""
    versions = run.get("versions", {})
    single = {name: value for name, value in run.items() if not isinstance(value, Mapping)}
    return {name: exact_text(value) for name, value in (versions | single).items()}


def exact_text(value: Any) -> str:
    """A value of run.json in text, numbers with all their digits."""
    if isinstance(value, list):
        return ", ".join(map(str, value))
    return figure_text(value) if isinstance(value, bool) else str(value)


def nearest_limit(verdict: RunVerdict) -> tuple[int, str]:
    """The smallest margin of a run's checks in percent, and a sentence on that check; 100 if none has one."""
    bars = [(check.margin_percent, check) for check in verdict.checks if check.margin_percent is not None]
    if not bars:
        return 100, "no check with a margin"
    percent, check = min(bars, key=lambda bar: bar[0])
    return percent, f"nearest to its limit: {check.sentence}"


class Row(NamedTuple):
    """One scenario on the page of a suite; `page`: link to its report, if it has one."""

    verdict: ScenarioVerdict
    page: str | None
    margin: int
    nearest: str


def row_of(verdict: ScenarioVerdict, beside: Path) -> Row:
    """One scenario's row on the page of a suite in the folder `beside`."""
    page = verdict.folder / RunFile.REPORT
    link = quote(os.path.relpath(page, beside)) if page.exists() else None
    return Row(verdict, link, *nearest_limit(verdict))


def by_scenario(changes: Sequence[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    """Changes of a suite by their scenarios, both in the order in which they come."""
    grouped: dict[str, list[Mapping[str, Any]]] = {}
    for one in changes:
        grouped.setdefault(one["scenario"], []).append(one)
    return grouped


def write_suite_report(
    path: Path,
    verdicts: Sequence[ScenarioVerdict],
    requirements: Mapping[str, Any],
    changes: Sequence[Mapping[str, Any]] | None = None,
    settings: Sequence[str] = (),
) -> None:
    """Write the page of a suite: changes, an overview, a row for each run, the worst first, the requirements.

    `changes`: differences from another suite, from `hil.suite.changes`; `settings`: what was set in each
    scenario.
    """
    ordered = sorted(verdicts, key=lambda one: BY_GRAVITY.index(one.verdict))
    page = template("suite.html.j2").render(
        rows=[row_of(one, path.parent) for one in ordered],
        verdict=worst(one.verdict for one in verdicts),
        settings=settings,
        failures=failures_of(verdicts).sentence,
        requirements=requirements,
        changed=None if changes is None else [one for one in changes if not one["equal"]],
        by_scenario=by_scenario,
        text=figure_text,
    )
    write_anew(path, page)
