"""`bring-up.html`: each step with its picture, its figures with intervals, and what was decided."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from hil.record.new_file import write_anew
from hil.show.report.pages import template
from hil.show.report.picture import Curve, Picture, Plot, shapes
from tools.output import figure

STYLES, HEIGHT = ("truth", "estimate", "target", "bad"), 160.0
"""The curves of a picture in order, and the height of its plot in pixels."""


def write_report(path: Path, result: Mapping[str, Any]) -> None:
    """Write the page of a result."""
    parts = [section(step) for step in result["steps"]]
    if result["parameters"]:
        parts.append("<h2>Parameters</h2>" + interval_table(result["parameters"]))
    verdict = "passed" if result["passed"] else "not passed"
    write_anew(
        path,
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Bring-up</title>'
        f"<style>{template('style.css.j2').render()}</style>"
        f"<h1>Bring-up: {verdict}</h1>{''.join(parts)}</html>\n",
    )


def section(step: Mapping[str, Any]) -> str:
    """One step."""
    mark, word = ("good", "passed") if step["passed"] else ("bad", "failed")
    rows = [(one["name"], figure(one["value"], one["unit"])) for one in step["figures"]]
    lines = [
        f'<h2>{escape(step["name"])} <span class="{mark}">{word}</span></h2><p>{escape(step["does"])}</p>',
        f'<p class="reason">{escape(step["reason"])}</p>' if step["reason"] else "",
        picture(step["curves"], step["axes"][1]),
        table(seen_rows(step["largest"], step["bound"])),
        "".join(f"<p>{escape(note)}</p>" for note in step["notes"]),
        table(rows),
        interval_table(step["parameters"]),
    ]
    return "".join(lines)


def table(rows: Sequence[Sequence[str]], heading: str = "") -> str:
    """A table of texts; nothing without rows."""
    lines = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows)
    return f"<table>{heading}{''.join(f'<tr>{line}</tr>' for line in lines)}</table>" if rows else ""


def seen_rows(largest: Mapping[str, float], bound: Mapping[str, float]) -> list[tuple[str, str, str]]:
    """The largest values of a step beside their bounds."""
    names = {"force_n": "N", "torque_n_m": "N m", "angle_rad": "rad", "speed_rad_s": "rad/s"}
    return [
        (
            f"largest {name.split('_')[0]}",
            figure(largest[name], unit),
            f"of {figure(bound[name], unit)}" if bound[name] else "",
        )
        for name, unit in names.items()
        if largest[name] or bound[name]
    ]


def interval_table(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    """Parameters with their 95 % intervals."""
    rows = [
        (name, figure(one["value"], one["unit"]), f"{one['low']:.6g} … {one['high']:.6g}")
        for name, one in parameters.items()
    ]
    return table(rows, "<tr><th>parameter</th><th>value</th><th>95 % interval</th></tr>")


def picture(curves: Sequence[Mapping[str, Any]], quantity: str) -> str:
    """Curves over time as an inline SVG; nothing without points."""
    shown = [
        Curve(np.array(one["x"]), np.array(one["y"]), STYLES[number], one["name"])
        for number, one in enumerate(curves)
        if one["x"]
    ]
    if not shown:
        return ""
    window_s = min(one.t_s.min() for one in shown), max(one.t_s.max() for one in shown)
    plot = Plot(quantity, shown, height=HEIGHT)
    return template("picture.svg.j2").render(shapes(Picture(quantity, window_s, (), [plot])))
