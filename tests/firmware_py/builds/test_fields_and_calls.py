"""Every field of the core's records is read or plotted; no call takes many values by their position."""

import ast
from collections.abc import Iterator, Set
from pathlib import Path

import firmware_py

FIRMWARE = Path(firmware_py.__file__).parent

PLOTTED = {"error_rad", "error_rad_s", "feedforward_n_m", "swing_m"}
"""Errors and intermediate results of loops and filters, for the log alone."""

MOST_BY_POSITION = 6

NOT_READ_AS_ATTRIBUTES = {
    "measurements.py",  # its two records are iterated over
}


def nodes(folder: Path, without: Set[str] = frozenset()) -> Iterator[ast.AST]:
    for path in sorted(folder.rglob("*.py")):
        if path.name not in without:
            yield from ast.walk(ast.parse(path.read_text("utf-8")))


def fields_of_records() -> set[str]:
    records = [
        node
        for node in nodes(FIRMWARE / "core", NOT_READ_AS_ATTRIBUTES)
        if isinstance(node, ast.ClassDef) and "NamedTuple" in map(ast.unparse, node.bases)
    ]
    return {
        ast.unparse(row.target) for node in records for row in node.body if isinstance(row, ast.AnnAssign)
    }


def test_no_field_of_the_core_is_only_written() -> None:
    read = {
        node.attr
        for node in nodes(FIRMWARE)
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load)
    }
    fields = fields_of_records()
    assert len(fields) > 200
    assert fields - read == PLOTTED


def test_a_call_with_many_values_names_them() -> None:
    calls = [node for node in nodes(FIRMWARE) if isinstance(node, ast.Call)]
    assert len(calls) > 1_000
    assert [ast.unparse(call) for call in calls if len(call.args) > MOST_BY_POSITION] == []
