"""Tables and pages of the reference in Markdown, and what several of their sections share."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

MADE = "<!-- made by `python -m tools.dev.reference`; change the code it is made from -->"

FEWEST_SECTIONS = 3
"""What has the same name and meaning in this number of sections or more is described once for all of them."""


def repeated(sections: Iterable[Mapping[str, str]]) -> dict[str, str]:
    """The meanings, by their names, that are described once for several sections: one for a name."""
    counts = Counter(meaning for section in sections for meaning in section.items())
    found = [meaning for meaning, count in counts.items() if count >= FEWEST_SECTIONS]
    meanings = Counter(name for name, _ in found)
    return {name: meaning for name, meaning in found if meanings[name] == 1}


def row(*cells: Any) -> str:
    """One row of a Markdown table."""
    return "| " + " | ".join(str(cell).replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"


def table(titles: Sequence[str], rows: Iterator[str]) -> str:
    """A Markdown table."""
    return "\n".join([row(*titles), "|" + "---|" * len(titles), *rows])


def page(title: str, *parts: str) -> str:
    """A page: its title, a note on its origin, and its parts."""
    return "\n\n".join([f"# {title}", MADE, *parts]) + "\n"
