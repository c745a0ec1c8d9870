"""Vector's CAN logs, .blf, by python-can's reader.

The reader does not end on an object of size 0 and unpacks without limit. So the file's structure is walked
first: every object has a header and a size, and what is unpacked has a limit.
"""

import struct
import zlib
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import can

from tools.exchange import foreign_logs
from tools.exchange.foreign_logs import FORMATS, LARGEST_BYTES, ForeignLog, refuse_large, too_many
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
DIRECTION_AT = {1: 2, 86: 2, 100: 2, 101: 34}
"""Place of the byte with the direction after a message's header, by the object's type."""
DIRECTION_MASK, TXRQ = 0x0F, 2
"""Direction: 0 received, 1 sent, 2 requested to be sent."""
MOST_HEAD_BYTES = 128
"""Largest number of an object's bytes that are looked at here: both headers and the direction."""
MARK = b"LOBJ"
PADDING = 8
"""Largest distance from the end of an object to the next."""
MOST_CARRIED_BYTES = 1 << 30
"""Limit on what is carried over from container to container: an object of a bench lies in two at most."""
UNPACKED, DEFLATED = 0, 2


class LogError(ValueError):
    """A .blf log is damaged; the message says where."""


def read_blf(path: Path, tolerant: bool) -> ForeignLog:
    """Read a .blf log; a tolerant reading keeps the messages before an error."""
    refuse_large(path, path.stat().st_size)
    log = ForeignLog()
    try:
        for place, message in enumerate(blf_messages(path, log), 1):
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
            for version, kind, size, content in contained_objects(path, file):
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
                    at = CONTAINED_HEADER_BYTES[version] + DIRECTION_AT.get(kind, size)
                    if at < len(content) and content[at] & DIRECTION_MASK == TXRQ:
                        log.requests.add(messages)
                    if messages > foreign_logs.MOST_MESSAGES:
                        raise too_many(path)
    except LogError as error:
        return Damage(messages, str(error))
    return None


class Contained(NamedTuple):
    """An object within a container: its header's version, its type, its stated size, and its first bytes."""

    version: int
    kind: int
    size: int
    content: bytes


def contained_objects(path: Path, file: BinaryIO) -> Iterator[Contained]:
    """The objects within the containers.

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


def whole_objects(data: bytes) -> Generator[Contained, None, bytes]:
    """Yield the objects that lie in `data` as a whole; return the bytes after them."""
    at = 0
    while (start := data.find(MARK, at, at + PADDING)) >= 0 and start + BLF_OBJECT.size <= len(data):
        _, _, version, size, kind = BLF_OBJECT.unpack_from(data, start)
        if start + size > len(data):
            return data[start:]
        yield Contained(version, kind, size, data[start : min(start + size, start + MOST_HEAD_BYTES)])
        if size < BLF_OBJECT.size:
            raise LogError(f"an object has the size {size}")
        at = start + size
    if start < 0 and at + PADDING <= len(data):
        raise LogError("between two objects there is something else")
    return data[at:]
