"""The size of what a log unpacks to, read from its messages before Rerun unpacks any.

A log is twelve bytes and then messages: kind and length as two 64-bit words, and a protobuf record. A message
of kind 2 is a chunk: its field 2 says whether it is compressed, 3 the size that it unpacks to, 5 holds an
Arrow stream. LZ4 packs 255 bytes into one; Arrow's own compression within a stream has no such limit, and no
run uses it.
"""

import mmap
import struct
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import pyarrow as pa

from hil.record.rrd.rerun_program import RerunError

HEAD_BYTES = 12
MESSAGE = struct.Struct("<QQ")
CHUNK, LZ4 = 2, 2
COMPRESSION, UNPACKED_BYTES, STREAM = 2, 3, 5
FREE_BYTES, LARGEST_RATIO = 64 << 20, 40
"""A log may unpack to the first, and to the second times its size; a standing module's log to 12 times."""
MOST_OTHER_BYTES = 1 << 16
"""Size of the largest message before the footer that is no chunk."""


def most_unpacked_bytes(path: Path) -> int:
    """The largest size to which a log may unpack."""
    return FREE_BYTES + LARGEST_RATIO * path.stat().st_size


def count_chunks(path: Path) -> int:
    """The number of chunks in a log; raises RerunError if they unpack to more than a run's do.

    A message that is cut at the end of the log is left out.
    """
    file = path.stat()
    return _count_chunks(path, file.st_ino, file.st_size, file.st_mtime_ns)


@lru_cache(8)
def _count_chunks(path: Path, *_content: int) -> int:
    most, unpacked, chunks = most_unpacked_bytes(path), 0, 0
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as log:
        place = HEAD_BYTES
        while place + MESSAGE.size <= len(log):
            kind, length = MESSAGE.unpack_from(log, place)
            place += MESSAGE.size
            if place + length > len(log):
                break
            if kind == CHUNK:
                try:
                    stream, size = _stream_in(log[place : place + length], most - unpacked)
                    is_packed_twice = any(map(_is_compressed, _batches(stream)))
                except (IndexError, ValueError, struct.error, OSError) as error:
                    raise RerunError(f"{path} is damaged at byte {place}: {error}") from error
                unpacked, chunks = unpacked + size, chunks + 1
                if unpacked > most or is_packed_twice:
                    raise RerunError(f"{path} unpacks to more than {most >> 20} MB; no run's log does")
            elif kind and length > MOST_OTHER_BYTES:
                raise RerunError(f"{path} has a message of {length} bytes and kind {kind}; no run's log has")
            place += length
    return chunks


def _varint(record: bytes, place: int) -> tuple[int, int]:
    """A protobuf number and the place behind it."""
    number = shift = 0
    while record[place] & 0x80:
        number |= (record[place] & 0x7F) << shift
        place, shift = place + 1, shift + 7
    return number | record[place] << shift, place + 1


def _stream_in(record: bytes, most: int) -> tuple[bytes, int]:
    """The Arrow stream of a chunk and its size; empty if it is larger than `most`."""
    place, numbers, stream = 0, {COMPRESSION: 0, UNPACKED_BYTES: 0}, b""
    while place < len(record):
        tag, place = _varint(record, place)
        field, wire_type = tag >> 3, tag & 7
        if wire_type == 0:
            numbers[field], place = _varint(record, place)
        elif wire_type == 2:
            length, place = _varint(record, place)
            if field == STREAM:
                stream = record[place : place + length]
            place += length
        elif wire_type in (1, 5):
            place += 8 if wire_type == 1 else 4
        else:
            raise ValueError(f"a field is of wire type {wire_type}")
    if numbers[COMPRESSION] != LZ4:
        return stream, len(stream)
    size = numbers[UNPACKED_BYTES]
    return (b"" if size > most else pa.Codec("lz4_raw").decompress(stream, size, asbytes=True)), size


def _batches(stream: bytes) -> Iterator[pa.Message]:
    """Yield the messages of an Arrow stream that hold columns."""
    if stream:
        reader = pa.ipc.MessageReader.open_stream(stream)
        while True:
            try:
                message = reader.read_next_message()
            except StopIteration:
                return
            if message.type != "schema":
                yield message


def _is_compressed(message: pa.Message) -> bool:
    """Whether a message's columns are compressed, or it is of an unknown kind.

    The header is a flatbuffer: a table begins with the distance to its list of places, one a field; the
    message's field 2 is the record batch, or a dictionary whose field 1 is the batch. The batch's field 3
    names a compression.
    """
    if message.type not in ("record batch", "dictionary"):
        return True
    header = message.metadata.to_pybytes()

    def field(table: int, number: int) -> int:
        listed = table - struct.unpack_from("<i", header, table)[0]
        is_there = 4 + 2 * number < struct.unpack_from("<H", header, listed)[0]
        offset = struct.unpack_from("<H", header, listed + 4 + 2 * number)[0] if is_there else 0
        return table + offset if offset else 0

    def follow(place: int) -> int:
        return int(place + struct.unpack_from("<I", header, place)[0])

    batch = field(follow(0), 2)
    if batch and message.type == "dictionary":
        batch = field(follow(batch), 1)
    return batch == 0 or field(follow(batch), 3) != 0
