"""One self-contained HTML page per run: the verdict, its explanation, and the run's origin."""

import os
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import tomli_w
from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from hil.judge import junit
from hil.judge.figures.records import CATALOGUE, Figures, FigureSpec, value_of
from hil.record.run_traces import RunTraces
from hil.show.report.plots import plots


class Headline(NamedTuple):
    """A main figure of the report, shown in `unit` after multiplication by `factor`."""

    name: str
    label: str
    factor: float = 1.0
    unit: str = ""


HEADLINES = (
    Headline("regime", "true regime of the hold"),
    Headline("capture_s", "captured at", unit="s"),
    Headline("impact_v_m_s", "impact speed", unit="m/s"),
    Headline("peak_force_n", "peak force on the stop", unit="N"),
    Headline("estimate.x_rmse_m", "position estimate, RMS error", 1e3, "mm"),
    Headline("estimate.v_rmse_m_s", "velocity estimate, RMS error", 1e3, "mm/s"),
    Headline("detector.recall", "impacts detected", 100.0, "%"),
    Headline("detector.latency_ms.p95", "detection latency, p95", unit="ms"),
    Headline("speed.ripple", "speed ripple", 100.0, "%"),
    Headline("tick_us.p99", "work in a firmware tick, p99", unit="µs"),
    Headline("overruns", "ticks skipped"),
    Headline("bus_load", "bus load", 100.0, "%"),
)
WALK_HEADLINES = (
    Headline("gait.in_window", "strides with a pulse in the window", 100.0, "%"),
    Headline("gait.outside_per_stride", "other pulses a stride"),
    Headline("gait.phase_rmse_percent", "gait phase, RMS error of the cycle", unit="%"),
)
"""The headlines of runs with a walk."""


LINKED = ("run.rrd", "can.log", "scenario.toml", "verdict.json")
"""Files of the run to which the page links."""


def shown(value: Any, unit: str) -> str:
    """A figure as text.

    >>> shown(0.02345678, "m"), shown(None, "N"), shown(0.25, ""), shown(True, "")
    ('0.02346 m', '—', '0.25', 'yes')
    """
    if value is None:
        return "—"
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return f"{text} {unit}".rstrip()


def described(spec: FigureSpec, verdict: Mapping[str, Any]) -> str:
    """The meaning of a figure, and whether the figure is incomplete."""
    return f"{spec.meaning}; incomplete: frames lost" if spec.name in verdict["incomplete"] else spec.meaning


def tile(headline: Headline, content: Mapping[str, Any]) -> tuple[str, str]:
    """A headline's label and its value as text."""
    value = value_of(content, headline.name)
    scaled = value if headline.factor == 1.0 or value is None else headline.factor * value
    return headline.label, shown(scaled, headline.unit)


@cache
def template(name: str) -> Template:
    """One of the templates beside this module."""
    environment = Environment(
        loader=PackageLoader("hil.show.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    return environment.get_template(name)


@cache
def library() -> str:
    """The charts' library: plotly.js, the unchanged npm package plotly.js-basic-dist-min (MIT licence)."""
    return (resources.files("hil.show.report") / "templates" / "plotly-basic.min.js").read_text("utf-8")


def write_report(path: Path, traces: RunTraces, figures: Figures, verdict: Mapping[str, Any]) -> None:
    """Write the page of one run."""
    content = figures.as_json()
    rows = [
        (spec.name, shown(value_of(content, spec.name), spec.unit), described(spec, verdict))
        for spec in CATALOGUE.values()
    ]
    page = template("report.html.j2").render(
        verdict=verdict,
        title=traces.scenario.get("title", verdict["scenario"]),
        changes=traces.run.get("changes", []),
        checks=[{**check, "shown": shown(check["value"], check["unit"])} for check in verdict["checks"]],
        headlines=[
            tile(headline, content)
            for headline in (*HEADLINES, *(WALK_HEADLINES if traces.is_walked else ()))
        ],
        plots=plots(traces, figures),
        library=library(),
        files=[name for name in LINKED if (path.parent / name).exists()],
        figures=rows,
        scenario=tomli_w.dumps(dict(traces.scenario)),
        run={key: value for key, value in traces.run.items() if key != "versions"},
        versions=traces.run.get("versions", {}),
    )
    path.write_text(page, encoding="utf-8")


def row_of(verdict: Mapping[str, Any], beside: Path) -> dict[str, Any]:
    """One run's row on the page of a suite: link to its own page, checks, and reasons for failure."""
    failed = [check for check in verdict["checks"] if not check["passed"]]
    page = Path(verdict["out"]) / "report.html"
    return {
        "seeds": 1,
        **verdict,
        "page": quote(os.path.relpath(page, beside)) if page.exists() else None,
        "worst": [
            {
                **check,
                "shown": shown(check["value"], check["unit"]),
                "range": [shown(check.get(side), check["unit"]) for side in ("lowest", "highest")],
            }
            for check in verdict["checks"]
        ],
        "wrong": [
            *verdict["reasons"],
            *filter(None, [verdict.get("host_stall")]),
            *(f"{check['name']} is {junit.measured(check)}" for check in failed),
        ],
        "passed_checks": len(verdict["checks"]) - len(failed),
    }


def write_suite_report(
    path: Path,
    verdicts: Sequence[Mapping[str, Any]],
    requirements: Mapping[str, Any],
    changes: Sequence[Mapping[str, Any]] | None = None,
) -> None:
    """Write the page of a suite: a row with a link for each run, failed runs first, and the requirements.

    `changes`: differences from another suite, from `hil.bench.changes`.
    """
    rows = sorted((row_of(verdict, path.parent) for verdict in verdicts), key=lambda row: bool(row["passed"]))
    changed = None
    if changes is not None:
        sides = ("before", "after", "margin_before", "margin_after")
        differing = [one for one in changes if not one["equal"]]
        changed = [{**one, **{side: shown(one[side], one["unit"]) for side in sides}} for one in differing]
    page = template("suite.html.j2").render(rows=rows, requirements=requirements, changed=changed)
    path.write_text(page, encoding="utf-8")
