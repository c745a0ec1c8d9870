"""CAN logs of other programs: every message is read, or counted with its place and the reason.

A log is somebody else's file. So limits hold for what comes out of it (its messages, its unpacked bytes, the
time that it spans), not only for its size; and a format whose reader evaluates what the file says is refused.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import can

from hil.bus.wire import MAX_STANDARD_ID
from hil.record.candump import MOST_BYTES
from hil.record.run_folder import is_own
from hil.run_files import RunFile
from tools.output import BadInputError

FORMATS = "candump -L's .log, or .asc, .blf or .trc, the text formats also with .gz"
SHOWN_CHARACTERS = 60
SHOWN_LINES = 100
"""Largest number of ignored lines that are listed; the others are only counted."""
LATEST_S = 9e9
"""Latest time of a message: Unix time of the year 2255. A run keeps times in ns, of 63 bits."""
LARGEST_BYTES = 64 << 20
"""Largest log, unpacked."""
MOST_MESSAGES = 400_000
"""Largest number of messages: a hundred seconds of a busy bus; their import takes 0.6 GB of memory."""
TRANSMIT_REQUEST = "transmit request"
"""Kind of a message that its sender has only requested."""
MOST_BAD_LINES = 1000
"""Largest number of unreadable lines; more mean a log of another format."""


class BadLine(NamedTuple):
    """A line that is no message: its number from 1 on, its shortened text, and the reason."""

    number: int
    text: str
    why: str


class LoggedMessage(NamedTuple):
    """A message: time in s, channel, its line (in a .blf log its number), identifier, bytes.

    `kind` says what it is, if it cannot be a frame of the bench; None for a classic 11-bit data frame.
    """

    t_s: float
    channel: str
    place: int
    can_id: int
    data: bytes
    kind: str | None


@dataclass
class ForeignLog:
    """The content of a log, in the file's order."""

    messages: list[LoggedMessage] = field(default_factory=list)
    left_out: list[BadLine] = field(default_factory=list)
    """Lines that are meant as messages but cannot be read."""
    ignored: list[BadLine] = field(default_factory=list)
    """The first lines that are no messages, for example statistics of the bus."""
    ignored_count: int = 0
    other_objects: Counter[str] = field(default_factory=Counter)
    """Counts of a .blf log's objects that are no messages."""
    truncated: str | None = None
    """A sign that the log is cut short; None without one."""
    requests: set[int] = field(default_factory=set)
    """Places of Vector's TxRq events: a transmit request, whose frame follows if it was sent."""
    earlier_s: float = 0.0
    """Time by which an .asc log's reader gets all times later, since it takes none before the trigger."""

    def add(self, message: can.Message, place: int, path: Path) -> None:
        """Append a message; ValueError if it contradicts itself, BadInputError for too many."""
        if len(self.messages) >= MOST_MESSAGES:
            raise too_many(path)
        check(message)
        self.messages.append(
            LoggedMessage(
                float(message.timestamp) - self.earlier_s,
                str(message.channel),
                place,
                message.arbitration_id,
                bytes(message.data),
                TRANSMIT_REQUEST if place in self.requests else kind_of(message),
            )
        )

    @property
    def ignored_share(self) -> float:
        """Share of the lines that were ignored or left out among those that could be messages."""
        ignored = self.ignored_count + len(self.left_out)
        return ignored / max(ignored + len(self.messages), 1)

    def ignore(self, line: BadLine) -> None:
        """Count a line that is no message."""
        self.ignored_count += 1
        if len(self.ignored) < SHOWN_LINES:
            self.ignored.append(line)


def too_many(path: Path) -> BadInputError:
    """The error for a log of more than MOST_MESSAGES."""
    return BadInputError(f"{path} holds more than {MOST_MESSAGES:,} messages; {remedy_for_large(path)}")


def remedy_for_large(path: Path) -> str:
    """What to do with a log that is too large to be imported."""
    if path.name == RunFile.CAN_LOG and is_own(path.parent):
        return f"it is the log of a run: view, inspect or replay {path.parent}, which has no such limit"
    return "cut it and import its parts"


def kind_of(message: can.Message) -> str | None:
    """The kind of a message that cannot be a frame of the bench; None for a classic 11-bit data frame."""
    if message.is_error_frame:
        return "error frame"
    if message.is_remote_frame:
        return "remote frame"
    if message.is_fd:
        return "CAN FD"
    if message.is_extended_id:
        return "29-bit identifier"
    if message.arbitration_id > MAX_STANDARD_ID:
        return "11-bit frame with an identifier above 0x7FF"
    return None


def check(message: can.Message) -> None:
    """Raise ValueError for a message with an invalid time, identifier or number of bytes."""
    if not abs(message.timestamp) < LATEST_S:
        raise ValueError(f"a message has the time {message.timestamp!r}")
    if not 0 <= message.arbitration_id < 1 << 29:
        raise ValueError(f"a message has the identifier {message.arbitration_id!r}")
    if message.is_remote_frame or message.is_error_frame:
        return
    held = len(message.data)
    if not message.is_fd and (held > MOST_BYTES or held != min(message.dlc, MOST_BYTES)):
        raise ValueError(f"a classic frame states {message.dlc} bytes and has {held}; wanted at most 8")


def bad_line(number: int, text: str, why: object) -> BadLine:
    """A line with its text shortened."""
    reason = str(why) or type(why).__name__
    return BadLine(number, text.strip()[:SHOWN_CHARACTERS], reason[: 2 * SHOWN_CHARACTERS])


def refuse_large(path: Path, size: int) -> None:
    """Raise `BadInputError` for a log of more than LARGEST_BYTES, before its messages take all memory."""
    if size > LARGEST_BYTES:
        raise BadInputError(
            f"{path} holds more than {LARGEST_BYTES >> 20} MB once unpacked; {remedy_for_large(path)}"
        )


class ClockJump(NamedTuple):
    """Consecutive messages far apart or in the wrong order: place of the second, times in s."""

    place: int
    from_s: float
    to_s: float


BACKWARD_S = 1e-3
"""Loggers with a thread for each channel write messages a little out of order; more is a jump."""
FORWARD_S = 1.0
"""A longer gap is a jump of the clock or a silence of the bus, which a log does not distinguish."""


def clock_jumps(messages: Iterable[LoggedMessage]) -> list[ClockJump]:
    """The jumps of the clock in the file's order, the silences of the bus included."""
    jumps = []
    before: LoggedMessage | None = None
    for message in messages:
        if before is not None and not -BACKWARD_S <= message.t_s - before.t_s < FORWARD_S:
            jumps.append(ClockJump(message.place, before.t_s, message.t_s))
        before = message
    return jumps
