"""One self-contained HTML page a run: the verdict, then what explains it, then what it was made with."""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import tomli_w
from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from hil.figure_records import CATALOGUE, Figures, value_of
from hil.report_plots import plots
from hil.run_traces import RunTraces

HEADLINES = (
    ("regime", "true regime of the hold"),
    ("capture_s", "captured at"),
    ("impact_v_m_s", "impact speed"),
    ("peak_force_n", "peak force on the stop"),
    ("estimate.x_rmse_m", "position estimate, RMS error"),
    ("estimate.v_rmse_m_s", "velocity estimate, RMS error"),
    ("detector.recall", "impacts detected"),
    ("detector.latency_ms.p95", "detection latency, p95"),
    ("speed.ripple", "speed ripple"),
    ("tick_us.p99", "work in a firmware tick, p99"),
    ("overruns", "ticks skipped"),
    ("bus_load", "bus load"),
)
"""What a reader wants to know first."""


def shown(value: Any, unit: str) -> str:
    """A figure as people read it.

    >>> shown(0.02345678, "m"), shown(None, "N"), shown(0.25, ""), shown(True, "")
    ('0.02346 m', '—', '0.25', 'yes')
    """
    if value is None:
        return "—"
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return f"{text} {unit}".rstrip()


@cache
def template(name: str) -> Template:
    """One of the templates beside this module."""
    environment = Environment(
        loader=PackageLoader("hil", "templates"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    return environment.get_template(name)


def write_report(path: Path, traces: RunTraces, figures: Figures, verdict: Mapping[str, Any]) -> None:
    """Write the page of one run."""
    content = figures.as_json()
    rows = [
        (spec.name, shown(value_of(content, spec.name), spec.unit), spec.meaning)
        for spec in CATALOGUE.values()
    ]
    headlines = [(label, shown(value_of(content, name), CATALOGUE[name].unit)) for name, label in HEADLINES]
    page = template("report.html.j2").render(
        verdict=verdict,
        title=traces.scenario.get("title", verdict["scenario"]),
        checks=[{**check, "shown": shown(check["value"], check["unit"])} for check in verdict["checks"]],
        headlines=headlines,
        plots=plots(traces, figures),
        figures=rows,
        scenario=tomli_w.dumps(dict(traces.scenario)),
        run={key: value for key, value in traces.run.items() if key != "versions"},
        versions=traces.run.get("versions", {}),
    )
    path.write_text(page, encoding="utf-8")


def write_suite_report(path: Path, verdicts: Sequence[Mapping[str, Any]]) -> None:
    """Write the page of many runs: a table that links to each one's own."""
    path.write_text(template("suite.html.j2").render(verdicts=verdicts), encoding="utf-8")
