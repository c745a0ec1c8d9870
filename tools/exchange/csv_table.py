"""A table as a CSV file that other programs read with their defaults, and that does nothing in a spreadsheet.

A column of floats has a point, an exponent or NaN in every cell, since readers guess a column's type from its
first rows; whole numbers with gaps are written as floats. No text is a formula, for which spreadsheets take a
cell that begins with =, +, - or @.
"""

import re
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc

from hil.record.new_file import open_anew
from tools.output import BadInputError

FORMULA = re.compile(r"\s*[=+\-@\uff1d\uff0b\uff0d\uff20]")
"""Beginning of a formula; Japanese spreadsheets take wide characters too."""
CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]+")
WITHOUT_POINT = r"^-?\d+$"


def write_csv(table: pa.Table, path: Path) -> None:
    """Write a table; bytes become hexadecimal text. Raises BadInputError for a column of lists."""
    titles = ",".join(quoted(name) for name in table.column_names)
    cells = [cells_of(name, table[name]) for name in table.column_names]
    lines = pc.binary_join_element_wise(*cells, ",") if cells else pa.array([], pa.string())
    with open_anew(path) as file:
        file.writelines(f"{line}\n".encode() for line in (titles, *lines.to_pylist()))


def cells_of(name: str, values: pa.ChunkedArray) -> pa.ChunkedArray:
    """The texts of a column's cells; nothing for a missing text or truth value."""
    if pa.types.is_integer(values.type) and values.null_count:
        values = values.cast(pa.float64(), safe=False)
    kind = values.type
    if pa.types.is_nested(kind):
        raise BadInputError(f"column {name!r} holds several numbers a row; write .parquet or .arrow")
    if pa.types.is_binary(kind) or pa.types.is_string(kind) or pa.types.is_dictionary(kind):
        found = (blob.hex() if isinstance(blob, bytes) else blob for blob in values.to_pylist())
        cells = pa.array([None if text is None else quoted(str(text)) for text in found], pa.string())
    else:
        cells = values.cast(pa.string())
    if pa.types.is_floating(kind):
        is_whole = pc.match_substring_regex(cells, WITHOUT_POINT)
        cells = pc.if_else(is_whole, pc.binary_join_element_wise(cells, "0", "."), cells)
        cells = pc.fill_null(pc.if_else(pc.equal(cells, "nan"), "NaN", cells), "NaN")
    return pc.fill_null(cells, "")


def quoted(text: str) -> str:
    """A text as a cell: in one line without control characters, and no formula.

    >>> print(*(quoted(text) for text in ("ready", "=1+1", " -", "two\\tcells")))
    "ready" "'=1+1" "' -" "two cells"
    """
    text = CONTROL.sub(" ", text).replace('"', '""')
    return f'"\'{text}"' if FORMULA.match(text) else f'"{text}"'
