"""Names and comments of C, from Python's."""

from typing import Any

KEYWORDS = """
auto break case char const default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while bool
operator
"""
"""Names that C or C++ reserves; in C they get an underscore."""


def is_record(kind: Any) -> bool:
    """Whether a type is a NamedTuple."""
    return hasattr(kind, "_fields")


def c_identifier(name: str) -> str:
    """A Python name in C."""
    return f"{name}_" if name in KEYWORDS.split() else name


def first_paragraph(document: str | None) -> str:
    """The first paragraph of a docstring, as a C comment; empty without one."""
    text = " ".join((document or "").strip().partition("\n\n")[0].split())
    return f"/* {text} */" if text else ""


def snake(name: str) -> str:
    """A class's name in lower case with underscores.

    >>> snake("NodeState")
    'node_state'
    """
    return "".join(f"_{one.lower()}" if one.isupper() else one for one in name).lstrip("_")
