"""Files of finished work, from which work that was interrupted continues."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

Entry = Mapping[str, Any]


@contextmanager
def journal(path: Path) -> Iterator[tuple[list[dict[str, Any]], Callable[[Entry], None]]]:
    """Give the entries of a file with a JSON object per line, and a function that appends an entry.

    Lines that a kill has cut short are ignored. A file without entries is removed at the end.
    """
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    known = []
    for line in text.splitlines():
        with suppress(json.JSONDecodeError):
            known.append(json.loads(line))
    with path.open("a", encoding="utf-8") as file:

        def add(entry: Entry) -> None:
            file.write(f"{json.dumps(entry)}\n")
            file.flush()

        if text and not text.endswith("\n"):
            file.write("\n")
        try:
            yield known, add
        finally:
            if path.stat().st_size == 0:
                path.unlink()
