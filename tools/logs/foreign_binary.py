"""CAN logs in binary formats: Vector's .blf by python-can's reader, and python-can's SQLite .db.

python-can's reader of .blf does not end on an object of size 0 and unpacks without limit. So the file's
structure is walked first: every object has a header and a size, and what is unpacked has a limit.
"""

import sqlite3
import struct
import time
import zlib
from collections.abc import Generator, Iterator
from contextlib import closing
from pathlib import Path
from typing import BinaryIO, NamedTuple

import can

from tools.logs import foreign_logs
from tools.logs.foreign_logs import FORMATS, LARGEST_BYTES, ForeignLog, refuse_large, too_many
from tools.output import BadInputError

BLF_FILE = struct.Struct("<4sL8BQ")
"""Signature, size of this header, versions, size of the file."""
BLF_OBJECT = struct.Struct("<4sHHLL")
"""Signature, size of the header, its version, size of the object, its type."""
BLF_CONTAINER = struct.Struct("<H6xL4x")
"""Method of compression, size once unpacked."""
CONTAINER = 10
CONTAINED_HEADER_BYTES = {1: 32, 2: 40}
"""Size of a contained object's header by its version."""
CAN_OBJECTS = {1: 16, 73: 32, 86: 16, 100: 84, 101: 40}
"""Smallest size of a message after its header, by the object's type: classic, error, classic, FD, FD."""
MARK = b"LOBJ"
PADDING = 8
"""Largest distance from the end of an object to the next."""
MOST_CARRIED_BYTES = 1 << 30
"""Limit on what is carried over from container to container: an object of a bench lies in two at most."""
UNPACKED, DEFLATED = 0, 2

SQLITE_STEPS = 100
"""SQLite's instructions between two looks at the clock; one of them may read some hundred pages."""
LONGEST_READING_S = 6.0
"""Longest time of computing for a database: several times what the most messages need."""
LONGEST_VALUE_BYTES = 1 << 14
"""Longest value that SQLite reads, and its longest text of the schema."""
MOST_FD_BYTES = 64
REFUSALS = {
    sqlite3.SQLITE_INTERRUPT: f"its rows take more than {LONGEST_READING_S:g} s of computing to read",
    sqlite3.SQLITE_TOOBIG: f"a value has more than {LONGEST_VALUE_BYTES} bytes",
}
"""What SQLite's errors mean that come from the limits."""
COLUMNS = ("ts", "arbitration_id", "extended", "remote", "error", "dlc", "data")
TABLE = "messages"


class LogError(ValueError):
    """A binary log is damaged; the message says where."""


def read_binary(path: Path, kind: str, tolerant: bool) -> ForeignLog:
    """Read a log in a binary format; a tolerant reading keeps the messages before an error."""
    refuse_large(path, path.stat().st_size)
    log = ForeignLog()
    try:
        for place, message in enumerate(BINARY_READERS[kind](path, log), 1):
            log.add(message, place, path)
    except BadInputError:
        raise
    except Exception as error:  # whatever a reader raises on a bad file
        if not (tolerant and log.messages):
            hint = "; --tolerant keeps what comes before" if log.messages else ""
            raise BadInputError(
                f"{path} cannot be read as a CAN log ({error}) after {len(log.messages)} messages; wanted "
                f"{FORMATS}{hint}"
            ) from error
        log.truncated = str(error) or type(error).__name__
    return log


def blf_messages(path: Path, log: ForeignLog) -> Iterator[can.Message]:
    """The messages of a .blf log; those before a damaged place are returned before the error."""
    damage = walk_blf(path, log)
    with can.BLFReader(path) as reader:
        there, wanted = path.stat().st_size, reader.file_size
        if there < wanted:
            log.truncated = f"it has {there} of {wanted} bytes"
        if damage is None:
            yield from reader
        else:
            for _, message in zip(range(damage.messages), reader, strict=False):
                yield message
    if damage is not None:
        raise LogError(damage.why)


class Damage(NamedTuple):
    """Where a .blf log ceases to make sense: the number of whole messages before, and the reason."""

    messages: int
    why: str


def walk_blf(path: Path, log: ForeignLog) -> Damage | None:
    """Walk all objects; count those that are no messages in `log`; return the first damage."""
    messages = 0
    try:
        with path.open("rb") as file:
            for version, kind, size in contained_objects(path, file):
                if size < BLF_OBJECT.size:
                    raise LogError(f"after {messages} messages an object has the size {size}")
                if version not in CONTAINED_HEADER_BYTES:
                    log.other_objects[f"header version {version}"] += 1
                elif kind not in CAN_OBJECTS:
                    log.other_objects[f"object type {kind}"] += 1
                else:
                    if size < CONTAINED_HEADER_BYTES[version] + CAN_OBJECTS[kind]:
                        raise LogError(f"after {messages} messages an object of type {kind} has {size} bytes")
                    messages += 1
                    if messages > foreign_logs.MOST_MESSAGES:
                        raise too_many(path)
    except LogError as error:
        return Damage(messages, str(error))
    return None


def contained_objects(path: Path, file: BinaryIO) -> Iterator[tuple[int, int, int]]:
    """Header version, type and size of each object within the containers.

    An object of impossible size is yielded last. What is not whole at the end is left to `truncated`.
    """
    signature, header_bytes, *_ = BLF_FILE.unpack(file.read(BLF_FILE.size))
    if signature != b"LOGG" or header_bytes < BLF_FILE.size:
        raise BadInputError(f"{path} is no .blf log: it begins with {signature!r}; wanted {FORMATS}")
    file.seek(header_bytes)
    left = b""
    unpacked = carried = 0
    while len(head := file.read(BLF_OBJECT.size)) == BLF_OBJECT.size:
        mark, _, _, size, kind = BLF_OBJECT.unpack(head)
        place = file.tell()
        if mark != MARK:
            raise LogError(f"before byte {place} an object was expected")
        if size < BLF_OBJECT.size:
            raise LogError(f"before byte {place} an object has the size {size}")
        body = file.read(size - BLF_OBJECT.size)
        file.read(size % 4)
        if kind != CONTAINER or len(body) < BLF_CONTAINER.size:
            continue
        content = unpack(body)
        unpacked += len(content)
        refuse_large(path, unpacked)
        carried += len(left)
        if carried > MOST_CARRIED_BYTES:
            raise LogError(
                f"before byte {place} an object of {len(left)} bytes or more is in too many pieces"
            )
        left = yield from whole_objects(left + content)


def unpack(body: bytes) -> bytes:
    """The content of a container, at most one byte more than the limit."""
    method, _ = BLF_CONTAINER.unpack_from(body)
    packed = body[BLF_CONTAINER.size :]
    if method == UNPACKED:
        return packed
    if method != DEFLATED:
        raise LogError(f"a container has the unknown compression {method}")
    try:
        return zlib.decompressobj().decompress(packed, LARGEST_BYTES + 1)
    except zlib.error as error:
        raise LogError(f"a container cannot be unpacked ({error})") from error


def whole_objects(data: bytes) -> Generator[tuple[int, int, int], None, bytes]:
    """Yield the objects that lie in `data` as a whole; return the bytes after them."""
    at = 0
    while (start := data.find(MARK, at, at + PADDING)) >= 0 and start + BLF_OBJECT.size <= len(data):
        _, _, version, size, kind = BLF_OBJECT.unpack_from(data, start)
        if start + size > len(data):
            return data[start:]
        yield version, kind, size
        if size < BLF_OBJECT.size:
            raise LogError(f"an object has the size {size}")
        at = start + size
    if start < 0 and at + PADDING <= len(data):
        raise LogError("between two objects there is something else")
    return data[at:]


def guarded(path: Path) -> sqlite3.Connection:
    """A connection to a database of somebody else's: read-only, with limits on its values and its time.

    Its pages may share others or form rings, so that it holds far more than the file has bytes.
    """
    until_s = time.process_time() + LONGEST_READING_S

    def is_too_late() -> bool:
        return time.process_time() > until_s

    database = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    # Python runs between the steps, so a signal ends the query.
    database.set_progress_handler(is_too_late, SQLITE_STEPS)
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST_VALUE_BYTES)
    database.execute("PRAGMA trusted_schema = OFF")
    return database


def database_messages(path: Path, _: ForeignLog) -> Iterator[can.Message]:
    """The messages of python-can's SQLite log, read without trusting its schema or its pages."""
    try:
        yield from rows_of_messages(path)
    except sqlite3.Error as error:
        reason = REFUSALS.get(error.sqlite_errorcode)
        if reason is None:
            raise
        raise LogError(reason) from error


def rows_of_messages(path: Path) -> Iterator[can.Message]:
    """A message for each row of the table.

    A view or a virtual table named `messages` is refused, for its query may never end.
    """
    with closing(guarded(path)) as database:
        query = "SELECT type, sql FROM sqlite_master WHERE name = ? COLLATE NOCASE"
        found = database.execute(query, (TABLE,)).fetchone()
        if found is None:
            raise LogError(f"it has no table {TABLE}")
        kind, sql = found
        if kind != "table" or str(sql).split()[1:2] != ["TABLE"]:
            raise LogError(f"its {TABLE} is no ordinary table but {str(sql).split()[:2]}")
        described = database.execute(f"PRAGMA table_xinfo({TABLE})").fetchall()
        if tuple(column[1] for column in described) != COLUMNS or any(column[6] for column in described):
            raise LogError(f"its table {TABLE} has not exactly the columns {', '.join(COLUMNS)}")
        for row in database.execute(f"SELECT {', '.join(COLUMNS)} FROM {TABLE} NOT INDEXED"):
            yield message_of(row)


def message_of(row: tuple[object, ...]) -> can.Message:
    """A message from a row of the table."""
    t_s, can_id, extended, remote, error, dlc, data = row
    if not (isinstance(can_id, int) and isinstance(dlc, int) and isinstance(data, bytes | None)):
        raise LogError(f"a row has an identifier, a length or data of the wrong type: {row!r:.100}")
    if not all(isinstance(mark, int | None) for mark in (extended, remote, error)):
        raise LogError(f"a row has a mark that is no number: {row!r:.100}")
    if data is not None and len(data) > MOST_FD_BYTES:
        raise LogError(f"a row has {len(data)} bytes of data; wanted at most {MOST_FD_BYTES}")
    return can.Message(
        timestamp=t_s,  # type: ignore[arg-type]  # checked with all messages
        arbitration_id=can_id,
        is_extended_id=bool(extended),
        is_remote_frame=bool(remote),
        is_error_frame=bool(error),
        dlc=dlc,
        data=None if remote else data,
    )


BINARY_READERS = {".blf": blf_messages, ".db": database_messages}
