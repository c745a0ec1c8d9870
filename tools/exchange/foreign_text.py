"""CAN logs in text: python-can's readers get the lines one by one, so that each line is accounted for.

Its readers skip in silence what they do not know. Here a line that a reader takes without returning a message
is counted; one at which it raises is unreadable, and the reading goes on at the next.
"""

import gzip
import io
import re
import zlib
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import can

from hil.record.candump import MOST_BYTES
from tools.exchange import foreign_logs
from tools.exchange.foreign_logs import (
    FORMATS,
    MOST_BAD_LINES,
    SHOWN_CHARACTERS,
    ForeignLog,
    bad_line,
    refuse_large,
    remedy_for_large,
)
from tools.output import BadInputError

TEXT_READERS = {
    ".log": can.CanutilsLogReader,
    ".asc": can.ASCReader,
    ".trc": can.TRCReader,
}
COMMENTS = {".log": ("#", ";", "//"), ".asc": ("//",), ".trc": (";",)}
"""Beginnings of comments; comments and blank lines are not counted."""
MOST_LINES = 450_000
"""Largest number of lines, an eighth more than messages: a line takes some hundred bytes, however short."""
LONGEST_LINE = 4096
LONGEST_HEADER = 1000
"""Largest number of lines in a .trc log's header, which is read again after each unreadable line."""

CANDUMP_LINE = re.compile(
    r"\(\d{1,12}\.\d{1,9}\) \S+ [0-9A-Fa-f]{1,8}#"
    r"(R[0-9A-Fa-f]?|#[0-9A-Fa-f]([0-9A-Fa-f]{2}){0,64}|([0-9A-Fa-f]{2}){0,64})( [RT])?"
)
PLAIN_CANDUMP_LINE = re.compile(r"(\([\d:. -]+\)\s+)?\S+\s+([RT]X\s+\S\s+\S\s+)?[0-9A-Fa-f]{3,8}\s+\[\d+\]")
"""A line of candump without -L, with or without a time and the extra columns of -x."""
DECIMAL_COMMA = {
    ".log": re.compile(r"\s*\(\d+(,)\d+\)"),
    ".asc": re.compile(r"\s*-?\d+(,)\d+\s"),
    ".trc": re.compile(r"(?:\s*\d+\)?\s+\d+|;\$STARTTIME=\d+)(,)\d+"),
}
"""The time at the beginning of a line, as some locales write it."""
ASC_STRUCTURE = re.compile(
    r"date\s|base\s|(no\s+)?internal\s+events\s+logged|(begin|end)\s+triggerblock|"
    r"[\d.]+\s+start of measurement",
    re.IGNORECASE,
)
ASC_BASE = re.compile(r"base\s+(hex|dec)(?:\s+timestamps\s+(absolute|relative))?", re.IGNORECASE)
ASC_EVENT = re.compile(r"(-?\d{1,12}(?:\.\d{1,12})?)(\s.*)", re.DOTALL)
"""An event with its time, which is negative before the trigger."""
TRC_VERSION = re.compile(r";\$FILEVERSION=([\d.]+)")
TRC_VERSIONS = ("1.0", "1.1", "1.2", "1.3", "2.0", "2.1")
TRC_ID_COLUMN = 4
"""Column of the identifier in a .trc log of version 1.2; 1.3 has one more column behind it."""
CAN_FD_FLAG, REMOTE_FLAG = 0x1000, 0x10
"""Bits of the flags in .asc's CANFD notation, which loggers of CAN FD channels use for classic frames too."""


class Line(NamedTuple):
    """A line of the file: its number from 1 on (0: added by us), and the text that the reader gets."""

    number: int
    text: str


class LineFeed(io.TextIOBase):
    """A text file of the given lines for a reader; `taken` are those read since it was last emptied."""

    def __init__(self, lines: Iterator[Line]) -> None:
        super().__init__()
        self.taken: list[Line] = []
        self._lines = lines

    def readline(self, _: int | None = -1) -> str:  # type: ignore[override]  # no reader asks for a part
        """The next line; empty at the end."""
        if (line := next(self._lines, None)) is None:
            return ""
        self.taken.append(line)
        return line.text

    def take(self) -> list[Line]:
        """The lines of the file read since the last call."""
        taken, self.taken = self.taken, []
        return [line for line in taken if line.number > 0]


def read_text(path: Path, kind: str, packed: bool, tolerant: bool) -> ForeignLog:
    """Read a log in a text format."""
    text = text_of(path, packed)
    if (count := text.count("\n")) > MOST_LINES:  # before its lines take all memory
        raise BadInputError(
            f"{path} holds {count:,} lines, more than {MOST_LINES:,}; {remedy_for_large(path)}"
        )
    log = ForeignLog(truncated=truncation(kind, text))
    lines = [with_point(kind, line) for line in text.split("\n")]
    del text  # takes as much memory as its lines
    refuse_plain_candump(path, kind, lines)
    header, body = split_header(path, kind, lines)
    if (longest := max((len(line.text) for line in header), default=0)) > LONGEST_LINE:
        raise BadInputError(
            f"{path} has a line of {longest} characters in its header; wanted at most {LONGEST_LINE}"
        )
    if kind == ".asc":
        body = with_positive_times(body, log)
    elif kind == ".trc":
        header, body = as_known_version(path, header, body)
    waiting = readable(kind, body, log)
    while True:
        feed = LineFeed(chain(header, waiting))
        try:
            with TEXT_READERS[kind](feed) as reader:
                take_messages(reader, feed, log, path)
        except BadInputError:
            raise
        except Exception as error:  # whatever a reader of python-can raises on a bad line
            taken = feed.take()
            ignore_all(log, taken[:-1])
            line = taken[-1] if taken else Line(0, "")
            log.left_out.append(bad_line(*line, error))
            header = [one for one in header if one.number != line.number]
            if line.number == 0:
                raise BadInputError(f"{path} cannot be read ({error}); wanted {FORMATS}") from error
        else:
            ignore_all(log, feed.take())
            refuse_bad(path, kind, log, tolerant)
            return log
        refuse_bad(path, kind, log, tolerant)


def take_messages(reader: can.io.generic.MessageReader, feed: LineFeed, log: ForeignLog, path: Path) -> None:
    """Add the reader's messages, each with the line that it was read from, and count the lines between."""
    for message in reader:
        *skipped, line = feed.take()
        ignore_all(log, skipped)
        try:
            log.add(message, line.number, path)
        except ValueError as error:
            if isinstance(error, BadInputError):
                raise
            log.left_out.append(bad_line(*line, error))


def ignore_all(log: ForeignLog, lines: Sequence[Line]) -> None:
    """Count lines that a reader has taken without returning a message; a .trc log's header is none."""
    for number, text in lines:
        if not text.startswith(";"):
            log.ignore(bad_line(number, text, "it is no CAN message"))


def refuse_bad(path: Path, kind: str, log: ForeignLog, tolerant: bool) -> None:
    """Raise `BadInputError` for an unreadable line unless the reading is tolerant, and for too many."""
    if not log.left_out:
        return
    number, text, why = log.left_out[0 if not tolerant else -1]
    where = f"{path}, line {number}: {text!r} cannot be read ({why})"
    if not tolerant:
        raise BadInputError(f"{where}; wanted {FORMATS}; `vibrohil import --tolerant` leaves such lines out")
    if len(log.left_out) > MOST_BAD_LINES:
        raise BadInputError(f"{where}; {len(log.left_out)} such lines: is it a {kind} log? Wanted {FORMATS}")


def text_of(path: Path, packed: bool) -> str:
    """The log's text with \\n as line ends: UTF-8, otherwise cp1252 as many Windows tools write."""
    try:
        with path.open("rb") as stored:
            content = (gzip.GzipFile(fileobj=stored) if packed else stored).read(
                foreign_logs.LARGEST_BYTES + 1
            )
    except (OSError, EOFError, zlib.error) as error:
        raise BadInputError(f"{path} cannot be read as text ({error}); wanted {FORMATS}") from error
    refuse_large(path, len(content))
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def refuse_plain_candump(path: Path, kind: str, lines: Sequence[str]) -> None:
    """Raise `BadInputError` for the output of candump without -L."""
    first = next((line.strip() for line in lines if line.strip()), "")
    if kind == ".log" and PLAIN_CANDUMP_LINE.match(first):
        raise BadInputError(
            f"{path} is candump's output for reading, without full times ({first[:SHOWN_CHARACTERS]!r}); "
            "record with `candump -L`"
        )


def truncation(kind: str, text: str) -> str | None:
    """A sign that a log in a text format is truncated; None without one."""
    if kind == ".asc" and "begin triggerblock" in text.lower() and "end triggerblock" not in text.lower():
        return "its last line is not End TriggerBlock"
    return "its last line has no end" if text and not text.endswith("\n") else None


def split_header(path: Path, kind: str, lines: Sequence[str]) -> tuple[list[Line], list[Line]]:
    """The lines that a reader needs before any message, and the rest."""
    numbered = [Line(number, text) for number, text in enumerate(lines, 1) if text.strip()]
    if kind == ".trc":
        end = next((n for n, line in enumerate(numbered) if not line.text.startswith(";")), len(numbered))
        if end > LONGEST_HEADER:
            raise BadInputError(f"{path} has a header of {end} lines; wanted at most {LONGEST_HEADER}")
        return [Line(number, f"{text}\n") for number, text in numbered[:end]], numbered[end:]
    if kind == ".asc":
        bases = [words for line in numbered if (words := line.text.lower().split())[:1] == ["base"]]
        base = bases[0][1] if bases and len(bases[0]) > 1 else "hex"
        if base not in ("hex", "dec"):
            raise BadInputError(f"{path} has numbers of base {base!r}; wanted base hex or base dec")
        # python-can takes the first line that it does not know as the header's end and drops it
        return [Line(0, f"base {base}\n"), Line(0, "internal events logged\n")], numbered
    return [], numbered


def with_point(kind: str, line: str) -> str:
    """The line with a decimal point in its time, for which some locales write a comma."""
    found = DECIMAL_COMMA[kind].match(line)
    return line if found is None else f"{line[: found.start(1)]}.{line[found.end(1) :]}"


def as_known_version(
    path: Path, header: Sequence[Line], body: Sequence[Line]
) -> tuple[list[Line], list[Line]]:
    """A .trc log's header and lines in a version that python-can knows: 1.3 for 1.2, which it does not.

    Raises BadInputError for a version that is not read.
    """
    version = next((found[1] for _, text in header if (found := TRC_VERSION.match(text))), "1.0")
    if version not in TRC_VERSIONS:
        raise BadInputError(
            f"{path} is a .trc log of version {version}; wanted one of {', '.join(TRC_VERSIONS)}: save it as "
            "version 1.1 or 2.1"
        )
    header = [
        Line(number, f"{text.strip().rstrip(';')}\n" if text.startswith(";$") else text)
        for number, text in header
    ]
    if version != "1.2":
        return header, list(body)
    header = [Line(number, text.replace("=1.2", "=1.3", 1)) for number, text in header]
    columns = ((number, text.split()) for number, text in body)
    return header, [
        Line(number, " ".join([*words[: TRC_ID_COLUMN + 1], "-", *words[TRC_ID_COLUMN + 1 :]]))
        for number, words in columns
    ]


def with_positive_times(lines: Sequence[Line], log: ForeignLog) -> list[Line]:
    """An .asc log's lines with absolute times, which begin at 0 if there are events before the trigger.

    Relative times count from the event before, of whatever kind.
    """
    bases = (ASC_BASE.match(line.text.strip()) for line in lines[:LONGEST_HEADER])
    is_relative = any(found[2] is not None and found[2].lower() == "relative" for found in bases if found)
    times: dict[int, float] = {}
    elapsed_s = 0.0
    for number, text in lines:
        if event := ASC_EVENT.match(text.strip()):
            elapsed_s = float(event[1]) + (elapsed_s if is_relative else 0.0)
            times[number] = elapsed_s
    log.earlier_s = max(0.0, -min(times.values(), default=0.0))
    if not (is_relative or log.earlier_s):
        return list(lines)
    return [
        Line(number, f"{times[number] + log.earlier_s:.9f} {text.split(None, 1)[1]}")
        if number in times
        else Line(number, text)
        for number, text in lines
    ]


def readable(kind: str, lines: Sequence[Line], log: ForeignLog) -> Iterator[Line]:
    """The lines that may hold messages, as the reader understands them."""
    for number, text in lines:
        if len(log.left_out) > MOST_BAD_LINES:
            return
        stripped = text.strip()
        if stripped.startswith(COMMENTS[kind]) or (kind == ".asc" and ASC_STRUCTURE.match(stripped)):
            continue
        if len(text) > LONGEST_LINE:
            log.left_out.append(bad_line(number, text, f"it has {len(text)} characters"))
            continue
        if kind == ".log" and not CANDUMP_LINE.fullmatch(stripped):
            log.left_out.append(bad_line(number, text, "wanted (SECONDS) CHANNEL ID#DATA"))
            continue
        if kind == ".asc" and (event := ASC_EVENT.match(stripped)):
            stamp, rest = event[1], event[2]
            if [word.lower() for word in rest.split(None, 3)[2:3]] == ["txrq"]:
                log.requests.add(number)
            stripped = f"{stamp if '.' in stamp else stamp + '.0'}{classic(rest)}"
        yield Line(number, f"{stripped}\n")


def classic(rest: str) -> str:
    """An .asc event without its time; a classic frame in CANFD notation in that of classic frames."""
    words = rest.split()
    if words[:1] != ["CANFD"] or len(words) < 8:
        return rest
    named = 0 if words[4] in ("0", "1") and words[5] in ("0", "1") else 1
    try:
        channel, direction, can_id = words[1:4]
        dlc, length = words[6 + named], int(words[7 + named])
        data = words[8 + named : 8 + named + length]
        flags = int(words[8 + named + length + 2], 16)
    except (ValueError, IndexError):
        return rest
    if flags & CAN_FD_FLAG or length > MOST_BYTES:
        return rest
    if flags & REMOTE_FLAG:
        return f" {channel} {can_id} {direction} r {dlc}"
    return f" {channel} {can_id} {direction} d {length} {' '.join(data)}"
