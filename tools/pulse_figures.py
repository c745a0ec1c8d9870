"""What came of one pulse a stride: two tables and a chart."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from tools.output import figure as number
from tools.study.figures import new_figure, save
from tools.study.pulse import GATED, STARTS, TURN, WALK, Band

Row = Mapping[str, Any]


def bands_table(bands: Sequence[Band]) -> Table:
    """The widest bands of each number of turns."""
    table = Table(title="subharmonics on a standing leg: widest bands", title_justify="left", box=None)
    for name in ("turns a blow", "gap/A", "r", "± of the cadence", "of the starts", "v/(ω gap)"):
        table.add_column(name)
    for turns in sorted({band.turns for band in bands}):
        own = sorted((band for band in bands if band.turns == turns), key=lambda band: -band.width)
        for band in own[:3]:
            table.add_row(
                str(turns),
                f"{band.gap_over_amplitude:g}",
                f"{band.low:.2f}–{band.high:.2f}",
                f"{100 * band.width:.1f} %",
                f"{100 * band.share:.0f} %",
                f"{band.v_share:.2f}",
            )
    return table


def rows_table(rows: Sequence[Row]) -> Table:
    """A line a module, ground and cadence."""
    table = Table(title="strides with one blow, in the window", title_justify="left", box=None)
    for name in ("way", "module", "axis", "turns", "ground", "Hz", "strides", "right", "none", "several"):
        table.add_column(name)
    for name in ("phase σ", "N s", "felt N", "leg alone 1/s", "W drive", "W copper"):
        table.add_column(name)
    for row in rows:
        if row["strides"] == 0:
            table.add_row(*_named(row), "no such orbit")
            continue
        table.add_row(
            *_named(row),
            str(row["strides"]),
            *(f"{100 * row[name]:.1f} %" for name in ("right", "without", "several", "phase_std")),
            number(row["impulse_n_s"]),
            f"{row['felt_low_n']:.1f}–{row['felt_high_n']:.1f}",
            *(number(row[name]) for name in ("leg_alone_hz", "drive_w", "copper_w")),
        )
    return table


def _named(row: Row) -> list[str]:
    return [
        row["way"],
        row["module"],
        row["axis"],
        str(row["turns"] or "—"),
        row["ground"],
        f"{row['stride_hz']:g}",
    ]


def label_of(row: Row) -> str:
    """A kind of module."""
    if row["way"] == GATED:
        return f"gated: {row['module']}"
    if row["way"] == TURN:
        return f"1 turn: gap {row['module']}, {row['axis']}"
    return f"{row['turns']} turns: {row['module']}"


def chart(rows: Sequence[Row], bands: Sequence[Band], folder: Path, name: str) -> list[str]:
    """Strides that come out right, a row a module, a column a cadence; beside it where subharmonics are."""
    walks = [row for row in rows if row["ground"] == WALK.name]
    labels = list(dict.fromkeys(label_of(row) for row in walks))
    figure, grid = new_figure(1, 2 if bands else 1, 13.0 if bands else 7.0, 1.4 + 0.3 * len(labels))
    _shares(grid[0, 0], walks, labels)
    if bands:
        _bands(grid[0, 1], bands)
    return save(figure, folder, name)


def _shares(axes: Any, walks: Sequence[Row], labels: Sequence[str]) -> None:
    cadences = sorted({row["stride_hz"] for row in walks})
    shares = np.full((len(labels), len(cadences)), np.nan)
    for row in walks:
        if row["strides"] > 0:
            place = labels.index(label_of(row)), cadences.index(row["stride_hz"])
            shares[place] = 100.0 * row["right"]
            # In print 100 is all of them.
            text = "100" if row["right"] == 1.0 else f"{min(shares[place], 99.9):.3g}"
            axes.text(place[1], place[0], text, ha="center", va="center", fontsize=8)
    axes.imshow(shares, cmap="RdYlGn", vmin=0.0, vmax=100.0, alpha=0.6, aspect="auto")
    axes.set_xticks(range(len(cadences)), [f"{hz:g}" for hz in cadences])
    axes.set_yticks(range(len(labels)), labels, fontsize=8)
    axes.set(xlabel="strides a second [Hz]", title="strides with one blow, in the window [%]: walks")


def _bands(axes: Any, bands: Sequence[Band]) -> None:
    """Each band as a bar over its ratios, the thicker the more starts end there."""
    gaps = sorted({band.gap_over_amplitude for band in bands})
    for band in bands:
        axes.plot(
            [band.low, band.high],
            [gaps.index(band.gap_over_amplitude)] * 2,
            color=f"C{band.turns - 2}",
            lw=1.5 + 8.0 * band.share,
            solid_capstyle="butt",
        )
    for turns in sorted({band.turns for band in bands}):
        axes.plot([], [], color=f"C{turns - 2}", lw=5, label=f"one blow in {turns} turns")
    axes.set_yticks(range(len(gaps)), [f"{gap:g}" for gap in gaps])
    axes.set(
        xlabel="Ω/ω",
        ylabel="gap/A",
        title=f"subharmonics on a standing leg; thickness: share of {STARTS} starts",
    )
    axes.grid(alpha=0.25)
    axes.legend(fontsize=8)
