"""Messages about errors in a user's table: dotted key, value found, values accepted, remedy."""

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from numbers import Real
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from plant_sim.synonyms import synonymous

_WANTED = {
    "greater_than": "a number greater than {gt:g}",
    "greater_than_equal": "a number of at least {ge:g}",
    "less_than": "a number less than {lt:g}",
    "less_than_equal": "a number of at most {le:g}",
    "finite_number": "a finite number",
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "a text",
    "bool_type": "true or false",
    "list_type": "a list",
    "tuple_type": "a list",
    "too_short": "a list of at least {min_length}",
    "too_long": "a list of at most {max_length}",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "literal_error": "{expected}",
    "physical_size": "a size from {smallest} to {largest} ({reason})",
}

MOST_MESSAGES = 10
MOST_CHARACTERS = 80
"""Longest text of a user that a message repeats."""


def messages_of(error: ValidationError, model: type[BaseModel]) -> list[str]:
    """One sentence for each error pydantic found in data meant for `model`, up to `MOST_MESSAGES` of them."""
    details = error.errors(include_url=False)
    found = [_message_of(detail, model) for detail in details[:MOST_MESSAGES]]
    more = len(details) - len(found)
    return [*found, f"and {more} more; correct these first"] if more else found


def nearest(word: str, known: Iterable[str], listing: str = "") -> str:
    """`did you mean …?` if known words are synonyms or close, else `listing` or the known words."""
    words = sorted(known)
    close = synonymous(word, words) or difflib.get_close_matches(word, words, n=1, cutoff=0.6)
    if close:
        return f"did you mean {' or '.join(close)}?"
    return listing or f"known: {', '.join(words)}"


def real(value: object) -> float:
    """A user's number of any real type as a float; nan for anything else.

    A number outside the range of floats is infinite.
    """
    if type(value) is float:
        return value
    if not isinstance(value, Real) or isinstance(value, bool):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf


def shortened(text: str) -> str:
    """A text of at most `MOST_CHARACTERS`; a longer one loses its end.

    >>> shortened(100 * "a") == 79 * "a" + "…"
    True
    """
    return text if len(text) <= MOST_CHARACTERS else f"{text[: MOST_CHARACTERS - 1]}…"


def _message_of(detail: ErrorDetails, model: type[BaseModel]) -> str:
    kind, context, got = detail["type"], detail.get("ctx", {}), detail["input"]
    keys, tables = _walk(detail["loc"], model)
    key = ".".join(keys)
    if kind == "extra_forbidden":
        known = {name for table in tables for name in table.model_fields}
        return f"{key} = {_show(got)} is not a known key{_of(tables)}; {nearest(keys[-1], known)}"
    if kind == "missing":
        return f"{key} is missing; give {_meaning(keys, tables)}"
    if kind == "union_tag_not_found":
        tag = str(context["discriminator"]).strip("'")
        return f"{key}.{tag} is missing; give one of {_tags(tables, tag)}"
    if kind == "union_tag_invalid":
        tag = str(context["discriminator"]).strip("'")
        name, expected = str(context["tag"]), _tags(tables, tag)
        return f"{key}.{tag} = {name!r} is none of {expected}; {nearest(name, expected.split(', '))}"
    if kind == "value_error":
        return str(context["error"])
    wanted = f" is not {_WANTED[kind].format(**context)}" if kind in _WANTED else f": {detail['msg']}"
    remedy = "" if kind == "literal_error" else f"; give {_meaning(keys, tables)}"
    return f"{key} = {_show(got)}{wanted}{remedy}"


def _walk(location: Sequence[int | str], model: type[BaseModel]) -> tuple[list[str], list[type[BaseModel]]]:
    """Dotted key of a location, without pydantic's tags for unions, and the tables that may contain it."""
    keys: list[str] = []
    tables, inner = [model], [model]
    for step in location:
        if isinstance(step, int):  # one of a list: its table is the list's
            keys.append(str(step))
            continue
        tagged = [table for table in inner if _is_tag(step, table)] if len(inner) > 1 else []
        if tagged:
            tables = inner = tagged
            continue
        tables = inner
        keys.append(shortened(step))
        fields = [table.model_fields[step] for table in tables if step in table.model_fields]
        inner = [inside for field in fields for inside in _models(field.annotation)]
    is_union = len(inner) > 1
    return keys, inner if is_union else tables


def _is_tag(step: int | str, table: type[BaseModel]) -> bool:
    return any(step in get_args(field.annotation) for field in table.model_fields.values())


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [inside for part in get_args(annotation) for inside in _models(part)]


def _tags(tables: Sequence[type[BaseModel]], tag: str) -> str:
    return ", ".join(str(get_args(table.model_fields[tag].annotation)[0]) for table in tables)


def _of(tables: Sequence[type[BaseModel]]) -> str:
    tags = [get_args(field.annotation) for table in tables for field in table.model_fields.values()]
    return next((f" of {tag[0]!r}" for tag in tags if len(tag) == 1 and isinstance(tag[0], str)), "")


def _meaning(keys: Sequence[str], tables: Sequence[type[BaseModel]]) -> str:
    for table in tables:
        field = table.model_fields.get(keys[-1])
        if field is not None and field.description:
            return field.description
    return f"the table [{'.'.join(keys)}]"


def _show(value: object) -> str:
    if isinstance(value, Mapping):
        return shortened(f"a table of {', '.join(map(str, value)) or 'nothing'}")
    return shortened(repr(value))
