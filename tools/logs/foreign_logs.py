"""CAN logs of other programs, read by python-can's readers: text formats line by line.

The error for an unreadable line has the line's number; a tolerant reading lists such lines and leaves them
out. A truncated log is reported, because python-can's readers end without an error there.
"""

import gzip
import io
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import can

from tools.output import BadInputError

TEXT_READERS = {
    ".log": can.CanutilsLogReader,
    ".asc": can.ASCReader,
    ".trc": can.TRCReader,
    ".csv": can.CSVReader,
}
FORMATS = "candump's .log, or .asc, .blf, .trc, .csv, .db or .mf4, the text formats also with .gz"
COMMENTS = ("#", ";", "//")
"""Beginnings of a comment in candump's log; comments and blank lines are left out."""
MOST_BAD_LINES = 100
"""Largest number of unreadable lines: each restarts the reading, and more mean a log of another format."""
SHOWN_CHARACTERS = 60
LATEST_S = 1e11
"""Latest time of a message: Unix time of the year 5138."""
LARGEST_BYTES = 64 << 20
"""Largest unpacked log: a quarter of an hour of the bus, which takes python-can a gigabyte of memory."""


class BadLine(NamedTuple):
    """An unreadable line: its number from 1 on, its shortened text, and the reason."""

    number: int
    text: str
    why: str


class ForeignLog(NamedTuple):
    """All messages of a log in the file's order, the lines left out, and a sign of truncation, if any."""

    messages: list[can.Message]
    left_out: list[BadLine]
    truncated: str | None


class CountedLines(io.TextIOBase):
    """A text file from lines that leaves some lines out; `number` is the last line that was read."""

    def __init__(self, lines: Sequence[str], left_out: set[int]) -> None:
        super().__init__()
        self.number = 0
        self._lines = lines
        self._left_out = left_out

    def readline(self, _: int | None = -1) -> str:  # type: ignore[override]  # no reader asks for a part
        """The next line; empty at the end."""
        while self.number < len(self._lines):
            self.number += 1
            if self.number not in self._left_out:
                return self._lines[self.number - 1]
        return ""

    def read(self, _: int | None = -1) -> str:
        """All remaining lines."""
        return "".join(self)


def read_log(path: Path, tolerant: bool = False) -> ForeignLog:
    """Read a log in the format given by its name's ending; `BadInputError` if it cannot be read."""
    suffixes = [suffix.lower() for suffix in path.suffixes]
    packed = suffixes[-1:] == [".gz"]
    kind = suffixes[-2] if packed and len(suffixes) > 1 else path.suffix.lower()
    if kind in TEXT_READERS:
        return read_text(path, kind, packed, tolerant)
    if packed:
        raise BadInputError(f"{path}: of packed logs only text is read; wanted {FORMATS}")
    return read_binary(path, tolerant)


def read_text(path: Path, kind: str, packed: bool, tolerant: bool) -> ForeignLog:
    """Read a log in a text format."""
    try:
        with path.open("rb") as stored:
            content = (gzip.GzipFile(fileobj=stored) if packed else stored).read(LARGEST_BYTES + 1)
        refuse_large(path, len(content))
        text = content.decode()
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise BadInputError(f"{path} cannot be read as text ({error}); wanted {FORMATS}") from error
    lines = text.splitlines(keepends=True)
    left_out: set[int] = set()
    if kind == ".log":
        left_out = {n for n, line in enumerate(lines, 1) if not line.strip() or line.startswith(COMMENTS)}
    bad: list[BadLine] = []
    while True:
        file = CountedLines(lines, left_out)
        try:
            with TEXT_READERS[kind](file) as reader:
                return ForeignLog(list(map(timed, reader)), bad, text_truncation(kind, text))
        except Exception as error:  # whatever a reader of python-can raises on a bad line
            line = lines[file.number - 1].strip()[:SHOWN_CHARACTERS] if file.number else ""
            bad.append(BadLine(file.number, line, str(error) or type(error).__name__))
            left_out.add(file.number)
        worst = bad[-1]
        where = f"{path}, line {worst.number}: {worst.text!r} cannot be read ({worst.why})"
        if not tolerant:
            raise BadInputError(f"{where}; wanted {FORMATS}; --tolerant leaves such lines out")
        if len(bad) > MOST_BAD_LINES or worst.number == 0:
            raise BadInputError(f"{where}; {len(bad)} such lines: is it a {kind} log? Wanted {FORMATS}")


def text_truncation(kind: str, text: str) -> str | None:
    """A sign that a log in a text format is truncated; None without one."""
    if kind == ".asc" and "begin triggerblock" in text.lower() and "end triggerblock" not in text.lower():
        return "its last line is not End TriggerBlock"
    return "its last line has no end" if text and not text.endswith("\n") else None


def timed(message: can.Message) -> can.Message:
    """Return the message; `ValueError` if its time is invalid, as in a damaged file."""
    if not (isinstance(message.timestamp, int | float) and abs(message.timestamp) < LATEST_S):
        raise ValueError(f"a message has the time {message.timestamp!r}")
    return message


def refuse_large(path: Path, size: int) -> None:
    """Raise `BadInputError` for a log of more than LARGEST_BYTES, before its messages take all memory."""
    if size > LARGEST_BYTES:
        raise BadInputError(f"{path} holds more than {LARGEST_BYTES >> 20} MB; cut it and import its parts")


def read_binary(path: Path, tolerant: bool) -> ForeignLog:
    """Read a log in a binary format; a tolerant reading keeps the messages before an error."""
    messages: list[can.Message] = []
    refuse_large(path, path.stat().st_size)
    try:
        with can.LogReader(path) as reader:
            truncated = blf_truncation(path, reader) if isinstance(reader, can.BLFReader) else None
            messages.extend(map(timed, reader))
    except Exception as error:  # whatever a reader of python-can raises on a bad file
        if not (tolerant and messages):
            hint = "; --tolerant keeps what comes before" if messages else ""
            raise BadInputError(
                f"{path} cannot be read as a CAN log ({error}) after {len(messages)} messages; wanted "
                f"{FORMATS}{hint}"
            ) from error
        truncated = str(error) or type(error).__name__
    return ForeignLog(messages, [], truncated)


def blf_truncation(path: Path, reader: can.BLFReader) -> str | None:
    """The sizes of a .blf file that is shorter than its header states; None for a complete file."""
    there, wanted = path.stat().st_size, reader.file_size
    return f"it has {there} of {wanted} bytes" if there < wanted else None
