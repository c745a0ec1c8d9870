"""Results of the study of one pulse a stride: two tables and a chart."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from tools.output import table_of
from tools.study.figures import new_figure, save
from tools.study.pulse.judging import GATED, TURN
from tools.study.pulse.orbits import STARTS, Band
from tools.study.pulse.turns import WALK

Row = Mapping[str, Any]


def bands_table(bands: Sequence[Band]) -> Table:
    """Return the table of the bands of subharmonics."""
    rows = (
        (
            str(band.turns),
            f"{band.gap_over_amplitude:g}",
            f"{band.low:.2f}–{band.high:.2f}",
            f"{100 * band.width:.1f} %",
            f"{100 * band.share:.0f} %",
            f"{band.v_share:.2f}",
        )
        for band in sorted(bands, key=lambda one: (one.turns, one.low))
    )
    titles = ("n", "gap/A", "r", "± of the cadence", "of the starts", "v/(ω gap)")
    return table_of(titles, rows, title="one impact in n turns, standing leg, hard stop")


def rows_table(rows: Sequence[Row]) -> Table:
    """Return the table of the share of right strides and the range of felt pulses in N.

    It has a row for each module and ground, and a column for each cadence.
    """
    cadences = sorted({row["stride_hz"] for row in rows})
    titles = ("", *(f"{hz:g} Hz" for hz in cadences), "felt [N]")
    table = table_of(titles, title="strides with one impact, in the window [%]")
    kinds = dict.fromkeys((label_of(row), row["ground"]) for row in rows)
    for label, ground in kinds:
        own = [row for row in rows if (label_of(row), row["ground"]) == (label, ground)]
        shares = {row["stride_hz"]: share_text(row) for row in own}
        felt = [row[name] for row in own for name in ("felt_low_n", "felt_high_n") if is_known(row[name])]
        table.add_row(
            label if ground == WALK.name else f"{label}, {ground}",
            *(shares.get(hz, "") for hz in cadences),
            f"{min(felt):.1f}–{max(felt):.1f}" if felt else "—",
        )
    return table


def is_known(value: float | None) -> bool:
    """Return whether a figure was measured."""
    return value is not None and not math.isnan(value)


def share_text(row: Row) -> str:
    """Return the share of right strides in per cent: 100 only if all are right, a dash without an orbit."""
    if row["strides"] == 0:
        return "—"
    return "100" if row["right"] == 1.0 else f"{min(100.0 * row['right'], 99.9):.3g}"


def label_of(row: Row) -> str:
    """Return the displayed name of a row's kind of module."""
    if row["way"] == GATED:
        return f"gated: {row['module']}"
    if row["way"] == TURN:
        return f"1 turn: gap {row['module']}, {row['axis']}"
    return f"{row['turns']} turns: {row['module']}"


def chart(rows: Sequence[Row], bands: Sequence[Band], folder: Path, name: str) -> list[str]:
    """Draw the shares of right strides by module and cadence, and beside them the bands of subharmonics."""
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
        place = labels.index(label_of(row)), cadences.index(row["stride_hz"])
        shares[place] = 100.0 * row["right"] if row["strides"] > 0 else math.nan
        axes.text(place[1], place[0], share_text(row), ha="center", va="center", fontsize=8)
    axes.imshow(shares, cmap="RdYlGn", vmin=0.0, vmax=100.0, alpha=0.6, aspect="auto")
    axes.set_xticks(range(len(cadences)), [f"{hz:g}" for hz in cadences])
    axes.set_yticks(range(len(labels)), labels, fontsize=8)
    axes.set(xlabel="stride frequency [Hz]", title="strides with one impact, in the window [%]: walks")


def _bands(axes: Any, bands: Sequence[Band]) -> None:
    """Draw each band as a bar over its ratios; its thickness shows the share of starts that end in it."""
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
        axes.plot([], [], color=f"C{turns - 2}", lw=5, label=f"1 impact in {turns} turns")
    axes.set_yticks(range(len(gaps)), [f"{gap:g}" for gap in gaps])
    axes.set(
        xlabel="Ω/ω",
        ylabel="gap/A",
        title=f"subharmonics on a standing leg; thickness: share of {STARTS} starts",
    )
    axes.grid(alpha=0.25)
    axes.legend(fontsize=8)
