"""The feasibility table as a chart and as a page."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tools.study.feasibility import feasibility
from tools.study.feasibility.feasibility import (
    AXES,
    FEASIBLE,
    LEG_IMPACTS,
    LOST,
    NO_REGION,
    NO_TURNS,
    REASONS,
    TOO_HARD,
    TOO_SOFT,
)
from tools.study.figures import new_figure, save

Row = dict[str, Any]

COLOURS = {
    FEASIBLE: "#4c9f70",
    NO_REGION: "#404040",
    NO_TURNS: "#8c8c8c",
    LEG_IMPACTS: "#c44e52",
    LOST: "#8172b3",
    TOO_HARD: "#e8a33d",
    TOO_SOFT: "#9cc4e4",
}
MARKS = {
    FEASIBLE: "**yes**",
    NO_REGION: "region",
    NO_TURNS: "n",
    LEG_IMPACTS: "leg",
    LOST: "lost",
    TOO_HARD: "hard",
    TOO_SOFT: "soft",
}

INTRODUCTION = """\
# Which settings suit a walk

This page shows for which module, axis, stop, wearer and cadence the module gives a suitable pulse in every
turn. It is written by `vibrohil study feasibility --page docs/feasibility.md`; every cell comes from that
run. A cell is **yes** if all conditions hold. Otherwise it names the first condition that fails:

| mark | failed condition |
|---|---|
| region | no r has exactly one impact a turn: a stiff foot plate rebounds and the striker meets it twice |
| n | no whole number n of crank turns per stride puts r = n f 2π/ω into the measured region |
| leg | the leg's motion alone causes impacts, even with the crank at rest |
| lost | more than 1 % of the turns have no impact |
| hard, soft | the peak of some felt pulse is above 40 N, or below 10 N |

**Simulation.** The plant runs alone, with an ideal crank at n turns per mean stride and a walk of 2 %
variability. In a run the crank's speed rises for 6 s and is then held for 30 s, of which the last 24 s are
judged. If the n whose r is nearest to 1.12 fails, the n with the softest impacts is tried too. The region
is measured for each module, stop and wearer on a standing leg, from r = 0.97 on.

| module | c | gap | A |
|---|---:|---:|---:|
| `table1` | 70 N/m | 60 mm | 20 mm (viscous), 30 mm (dry) |
| `gait` | 505 N/m | 60 mm | 12 mm |
| `walking` | 720 N/m | 22 mm | 6.5 mm |

All modules have m_B = 0.8 kg, k = 0.5, and b = 0.2 N s/m or μ = 0.15 with μ_s = 4/3 μ. Axes refer to the
shank: *up* along it, *forward* and *outward* across it. Wearers are a foot plate of 1 kg on 10 kN/m and 100
N s/m (stiff) or 2 kN/m and 40 N s/m (compliant). The felt pulse is the ankle's force above its value at
touch-down. With dry friction the plant has no compliant wearer: there the force is that of the bare stop,
and the compliant wearer is omitted. [The gait](explanation/gait.md) describes how the crank is locked to
the stride and puts one impact into the push-off window.
"""


def write(rows: Sequence[Row], path: Path, picture: str | None) -> None:
    """Write the page as Markdown."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines(rows, picture)) + "\n", encoding="utf-8")


def lines(rows: Sequence[Row], picture: str | None) -> Iterator[str]:
    """Yield the lines of the page."""
    yield INTRODUCTION
    if picture is not None:
        yield f"![Verdicts over cadence for every module, axis, guide, stop and wearer]({picture})\n"
    yield "| preset | axis | cells | " + " | ".join(MARKS[reason].strip("*") for reason in REASONS) + " |"
    yield "|---|---|---|" + "---|" * len(REASONS)
    for preset in presets_of(rows):
        for axis in AXES:
            chosen = [row for row in rows if row["preset"] == preset and row["axis"] == axis]
            counts = Counter(row["verdict"] for row in chosen)
            yield (
                f"| {preset} | {axis} | {len(chosen)} | "
                + " | ".join(str(counts[reason]) for reason in REASONS)
                + " |"
            )
    yield from short(rows)
    yield from claims(rows)
    for preset in presets_of(rows):
        yield from _section([row for row in rows if row["preset"] == preset])


def short(rows: Sequence[Row]) -> Iterator[str]:
    """Yield, for each preset, the settings that suit most cadences, and the cadences that none suits."""
    yield "\n## In short\n"
    for preset in presets_of(rows):
        settings: dict[str, set[float]] = {}
        cadences = set()
        for row in rows:
            if row["preset"] == preset:
                cadences.add(row["stride_hz"])
                served = settings.setdefault(f"axis {row['axis']}: {stop_of(row)}", set())
                if row["verdict"] == FEASIBLE:
                    served.add(row["stride_hz"])
        most = max(len(served) for served in settings.values())
        best = [name for name, served in settings.items() if len(served) == most > 0]
        never = sorted(cadences - set().union(*settings.values()))
        yield (
            f"- `{preset}`: {most} of {len(cadences)} cadences at best ({'; '.join(best) or 'nothing'}). "
            f"Cadences without a suitable setting: {', '.join(f'{hz:g} Hz' for hz in never) or 'none'}."
        )


def claims(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the evidence of the cells for three of the paper's claims."""
    yield "\n## The paper's C3, C7 and C12\n"
    yield (
        "[The claims](claims.md) are judged for the module alone; this table adds the results for a walk. "
        "Crank frequencies are n f. Pulses are judged in the cells in which the impacts last.\n"
    )
    yield "| preset | crank, Hz (C3, C12) | strides, Hz | cells with impacts | all pulses in 10–40 N (C7) |"
    yield "|---|---|---|---|---|"
    for preset in presets_of(rows):
        chosen = [row for row in rows if row["preset"] == preset]
        good = [row for row in chosen if row["verdict"] == FEASIBLE]
        with_impacts = [row for row in chosen if row["verdict"] in (FEASIBLE, TOO_HARD, TOO_SOFT)]
        cranks = [row["harmonic"] * row["stride_hz"] for row in good]
        strides = sorted({row["stride_hz"] for row in good})
        yield (
            f"| {preset} | {_span(cranks)} | {', '.join(f'{hz:g}' for hz in strides) or 'none'} | "
            f"{len(with_impacts)} | {len(good)} |"
        )
    yield (
        "\nC3 and C12 assign a crank frequency to each cadence. A walk does not require this, because n can "
        "be chosen to suit the cadence. The region must be wide enough to contain a whole multiple of the "
        "cadence, which is more likely if a stride has more turns. C7 depends on the stop and the wearer: it "
        "holds if they are soft, but not for a module in general."
    )


def _span(values: Sequence[float]) -> str:
    return f"{min(values):.1f}–{max(values):.1f}" if values else "none"


def presets_of(rows: Sequence[Row]) -> list[str]:
    """Return the presets of the rows in the order of the study."""
    return [preset for preset in feasibility.MODULES if any(row["preset"] == preset for row in rows)]


def stop_of(row: Row) -> str:
    """Return the displayed name of a row's friction law, contact time and wearer."""
    wearer = row["wearer"] if row["law"] == "viscous" else "bare stop"
    return f"{row['law']}, {1e3 * row['contact_s']:.0f} ms, {wearer}"


def _section(rows: Sequence[Row]) -> Iterator[str]:
    cadences = sorted({row["stride_hz"] for row in rows})
    yield f"\n## {rows[0]['preset']}\n"
    yield (
        "A cell gives n, r and the smallest and largest felt pulse in N; a cell *leg* gives the impacts per "
        "second.\n"
    )
    yield (
        "| axis | guide, contact, wearer | r of impact | "
        + " | ".join(f"{hz:g} Hz" for hz in cadences)
        + " |"
    )
    yield "|---|---|---|" + "---|" * len(cadences)
    for axis in AXES:
        for name in dict.fromkeys(stop_of(row) for row in rows):
            chosen = [row for row in rows if row["axis"] == axis and stop_of(row) == name]
            cells = [text_of(next(row for row in chosen if row["stride_hz"] == hz)) for hz in cadences]
            low, high = chosen[0]["region_low"], chosen[0]["region_high"]
            region = f"{low:.2f}–{high:.2f}" if low <= high else "none"
            yield f"| {axis} | {name} | {region} | " + " | ".join(cells) + " |"


def text_of(row: Row) -> str:
    """Return the text of a cell: its mark and its measured figures."""
    mark = MARKS[row["verdict"]]
    if row["harmonic"] == 0:
        return mark
    text = f"{mark} {row['harmonic']}×, r {row['ratio']:.2f}"
    if row["verdict"] == LEG_IMPACTS:
        return f"{text}, {row['idle_impacts_hz']:.1f}/s"
    if np.isfinite(row["felt_high_n"]):
        text += f", {row['felt_low_n']:.0f}–{row['felt_high_n']:.0f}"
    return text


def chart(rows: Sequence[Row], folder: Path, name: str) -> list[str]:
    """Draw the verdicts as colours, a row of maps for each preset, a column for each axis."""
    from matplotlib.patches import Patch

    presets = presets_of(rows)
    figure, grid = new_figure(len(presets), len(AXES), 12.5, 3.1 * len(presets) + 0.6, sharex=True)
    names = list(dict.fromkeys(stop_of(row) for row in rows))
    cadences = sorted({row["stride_hz"] for row in rows})
    for across, preset in enumerate(presets):
        for down, axis in enumerate(AXES):
            axes = grid[across][down]
            for row in rows:
                if row["preset"] != preset or row["axis"] != axis:
                    continue
                place = (cadences.index(row["stride_hz"]), names.index(stop_of(row)))
                axes.add_patch(_square(place, COLOURS[row["verdict"]]))
                if row["harmonic"] > 0:
                    axes.text(*place, str(row["harmonic"]), ha="center", va="center", fontsize=7)
            axes.set(
                xlim=(-0.5, len(cadences) - 0.5),
                ylim=(len(names) - 0.5, -0.5),
                xticks=range(len(cadences)),
                xticklabels=[f"{hz:g}" for hz in cadences],
                yticks=range(len(names)),
                title=f"{preset}, axis {axis}",
            )
            axes.set_yticklabels(names if down == 0 else [], fontsize=7)
            if across == len(presets) - 1:
                axes.set_xlabel("stride frequency [Hz]")
    handles = [Patch(color=COLOURS[reason], label=reason) for reason in REASONS]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(REASONS), frameon=False, fontsize=8)
    figure.suptitle(
        "Where a module suits a walk, and which condition fails first; the numbers are crank turns per stride"
    )
    return save(figure, folder, name)


def _square(place: tuple[int, int], colour: str) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((place[0] - 0.48, place[1] - 0.46), 0.96, 0.92, color=colour, lw=0)
