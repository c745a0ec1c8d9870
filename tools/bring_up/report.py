"""`bring-up.html`: each step with its picture, its figures with intervals, and what was decided."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from hil.record.new_file import write_anew
from tools.output import figure

WIDTH, HEIGHT, LEFT, BOTTOM, TOP = 640, 200, 62, 34, 10
COLOURS = ("#1f5fa8", "#c2571a", "#2d8a4e", "#8a3ea8")
STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:52rem;margin:2rem auto;padding:0 1rem;color:#222}
table{border-collapse:collapse;margin:.6rem 0}td,th{padding:.15rem .8rem .15rem 0;text-align:left}
td.n{text-align:right;font-variant-numeric:tabular-nums}h2{margin-top:2rem}.passed{color:#2d8a4e}
.failed{color:#b3261e}svg{width:100%;height:auto}svg text{font-size:11px;fill:#555}"""


def write_report(path: Path, result: Mapping[str, Any]) -> None:
    """Write the page of a result."""
    parts = [section(step) for step in result["steps"]]
    parameters = [
        (name, value["value"], value["low"], value["high"], value["unit"])
        for name, value in result["parameters"].items()
    ]
    if parameters:
        parts.append("<h2>Parameters</h2>" + interval_table(parameters))
    verdict = "passed" if result["passed"] else "not passed"
    write_anew(
        path,
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Bring-up</title><style>{STYLE}</style>'
        f"<h1>Bring-up: {verdict}</h1>{''.join(parts)}</html>\n",
    )


def section(step: Mapping[str, Any]) -> str:
    """One step."""
    word = "passed" if step["passed"] else "failed"
    lines = [
        f'<h2>{escape(step["name"])} <span class="{word}">{word}</span></h2><p>{escape(step["does"])}</p>',
        f"<p class=failed>{escape(step['reason'])}</p>" if step["reason"] else "",
        picture(step["curves"], step["axes"]),
        seen_table(step["largest"], step["bound"]),
        "".join(f"<p>{escape(note)}</p>" for note in step["notes"]),
    ]
    rows = "".join(
        f"<tr><td>{escape(one['name'])}</td><td class=n>{escape(figure(one['value'], one['unit']))}</td></tr>"
        for one in step["figures"]
    )
    lines.append(f"<table>{rows}</table>" if rows else "")
    found = [
        (name, *(one[key] for key in ("value", "low", "high", "unit")))
        for name, one in step["parameters"].items()
    ]
    lines.append(interval_table(found) if found else "")
    return "".join(lines)


def seen_table(largest: Mapping[str, float], bound: Mapping[str, float]) -> str:
    """The largest values of a step beside their bounds."""
    names = {"force_n": "N", "torque_n_m": "N m", "angle_rad": "rad", "speed_rad_s": "rad/s"}
    rows = "".join(
        f"<tr><td>largest {name.split('_')[0]}</td><td class=n>{escape(figure(largest[name], unit))}</td>"
        f"<td>{'of ' + escape(figure(bound[name], unit)) if bound[name] else ''}</td></tr>"
        for name, unit in names.items()
        if largest[name] or bound[name]
    )
    return f"<table>{rows}</table>" if rows else ""


def interval_table(rows: Sequence[tuple[str, float, float, float, str]]) -> str:
    """Parameters with their 95 % intervals."""
    cells = "".join(
        f"<tr><td>{escape(name)}</td><td class=n>{escape(figure(value, unit))}</td>"
        f"<td>{low:.4g} … {high:.4g}</td></tr>"
        for name, value, low, high, unit in rows
    )
    return f"<table><tr><th>parameter</th><th>value</th><th>95 % interval</th></tr>{cells}</table>"


def picture(curves: Sequence[Mapping[str, Any]], axes: Sequence[str]) -> str:
    """Curves over one pair of axes, as an inline SVG; nothing without points."""
    curves = [curve for curve in curves if curve["x"]]
    if not curves:
        return ""
    low_x, high_x = min(min(one["x"]) for one in curves), max(max(one["x"]) for one in curves)
    low_y, high_y = min(min(one["y"]) for one in curves), max(max(one["y"]) for one in curves)
    wide, tall = float(high_x - low_x) or 1.0, float(high_y - low_y) or 1.0

    def across(x: float) -> float:
        return LEFT + float(x - low_x) / wide * (WIDTH - LEFT - 8)

    def up(y: float) -> float:
        return HEIGHT - BOTTOM - float(y - low_y) / tall * (HEIGHT - BOTTOM - TOP)

    lines = []
    for curve, colour in zip(curves, COLOURS * len(curves), strict=False):
        points = " ".join(f"{across(x):.1f},{up(y):.1f}" for x, y in zip(curve["x"], curve["y"], strict=True))
        lines.append(f'<polyline fill="none" stroke="{colour}" stroke-width="1.2" points="{points}"/>')
    for place, (curve, colour) in enumerate(zip(curves, COLOURS * len(curves), strict=False)):
        lines.append(
            f'<text x="{WIDTH - 8}" y="{TOP + 10 + 14 * place}" text-anchor="end" style="fill:{colour}">'
            f"{escape(curve['name'])}</text>"
        )
    for y in (low_y, high_y):
        lines.append(f'<text x="{LEFT - 6}" y="{up(y) + 4:.1f}" text-anchor="end">{y:.3g}</text>')
    for x, anchor in ((low_x, "start"), (high_x, "end")):
        lines.append(f'<text x="{across(x):.1f}" y="{HEIGHT - 18}" text-anchor="{anchor}">{x:.3g}</text>')
    lines.append(f'<text x="{WIDTH / 2}" y="{HEIGHT - 4}" text-anchor="middle">{escape(axes[0])}</text>')
    middle = f'transform="translate(12 {HEIGHT / 2 - 10}) rotate(-90)" text-anchor="middle"'
    lines.append(f"<text {middle}>{escape(axes[1])}</text>")
    size = f'width="{WIDTH - LEFT - 8}" height="{HEIGHT - BOTTOM - TOP}"'
    frame = f'<rect x="{LEFT}" y="{TOP}" {size} fill="none" stroke="#bbb"/>'
    return f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img">{frame}{"".join(lines)}</svg>'
