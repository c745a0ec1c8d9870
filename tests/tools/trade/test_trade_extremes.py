"""The page of extremes holds: every extreme has its row, and each cell is what is measured now."""

import math
import re
from pathlib import Path

import pytest

from tools.trade.extremes import EXTREMES, METHODS, Cell, Extreme, measure

ROW = re.compile(r"^\| ([^|]+) \| ([^|]+) \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", re.MULTILINE)
SENTENCE = re.compile(r"^(\d+)\. (.+)$", re.MULTILINE)


def read(page: Path) -> dict[tuple[str, str], dict[str, Cell]]:
    """The cells of a page by extreme case and value."""
    text = page.read_text(encoding="utf-8")
    sentences = dict(SENTENCE.findall(text))
    rows = {}
    for what, value, *cells in ROW.findall(text)[1:]:
        read_cells = [
            Cell(math.nan, sentences[cell[len("refused [") : -1]])
            if cell.startswith("refused")
            else Cell(float(cell), "")
            for cell in cells
        ]
        rows[what, value] = dict(zip(METHODS, read_cells, strict=True))
    return rows


PAGE = read(Path(__file__).parents[3] / "docs" / "extremes.md")

FACTOR, FLOOR_M = 10.0, 1e-11
"""By how much another machine's rounding may change an error, and below which it is rounding alone."""


def without_numbers(sentence: str) -> str:
    """Where a solver gave up depends on the machine's rounding."""
    return re.sub(r"[-+]?\d[\d.e+-]*", "…", sentence)


def test_every_extreme_has_a_row_and_no_cell_is_empty() -> None:
    assert list(PAGE) == [(extreme.what, extreme.value) for extreme in EXTREMES]
    for cells in PAGE.values():
        assert tuple(cells) == METHODS
        assert all(cell.refusal or cell.error_m >= 0.0 for cell in cells.values())


@pytest.mark.parametrize(
    "extreme",
    EXTREMES,
    ids=lambda extreme: f"{extreme.what}: {extreme.value}",
)
def test_an_extreme_is_as_the_page_says(extreme: Extreme) -> None:
    for method, cell in measure(extreme).items():
        said = PAGE[extreme.what, extreme.value][method]
        assert without_numbers(cell.refusal) == without_numbers(said.refusal)
        if not said.refusal:
            assert cell.error_m <= FACTOR * said.error_m + FLOOR_M
