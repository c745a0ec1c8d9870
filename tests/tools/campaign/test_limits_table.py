"""The table of the campaign `limits` on its page has the counts of docs/data."""

import csv
from pathlib import Path

DOCS = Path(__file__).parents[3] / "docs"


def test_the_pages_table_has_the_counts_of_its_data() -> None:
    table = (DOCS / "safety.md").read_text("utf-8").replace(",", "")
    with (DOCS / "data" / "limits.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for contact in dict.fromkeys(row["contact"] for row in rows):
        first, *others = (row for row in rows if row["contact"] == contact)
        cells = [contact, *(f"{row['missed']} of {row['above']}" for row in (first, *others))]
        cells += [f"{first['tripped']} of {first['below']}"]
        tripped, below = (sum(int(row[name]) for row in others) for name in ("tripped", "below"))
        cells += [f"{tripped} of {below}"]
        assert f"| {' | '.join(cells)} |" in table
