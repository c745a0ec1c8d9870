"""The messages of a log in Rerun's format, read without Rerun: what they take once they are unpacked.

A message is its kind and length, then fields in the format of protocol buffers. Data are an Arrow stream, as
a rule compressed by LZ4. The last message holds the footer: for each recording a table of the data's places.
"""

import mmap
import struct
from collections.abc import Iterator
from typing import NamedTuple

import pyarrow as pa

from hil.record.rrd.arrow_extent import ExtentError

HEADER_BYTES = 12
MESSAGE = struct.Struct("<QQ")
"""Kind and length of a message."""
END, DATA = 0, 2
"""Kinds of messages: the last one, and those that hold data."""
TRAILER = struct.Struct("<QQI8sI")
"""The end of a log: place and length of its footer, a checksum, a mark, and the number of footers."""
TRAILER_MARK = b"RRF2FOOT"
MOST_BYTES_OF_A_NUMBER = 10
LARGEST_NUMBER = (1 << 64) - 1
NUMBER, EIGHT_BYTES, BYTES, FOUR_BYTES = 0, 1, 2, 5
"""Kinds of fields in the format of protocol buffers; no message of Rerun has another."""
FIXED_BYTES = {EIGHT_BYTES: 8, FOUR_BYTES: 4}
UNCOMPRESSED, LZ4 = 1, 2
COMPRESSION_OF_DATA, SIZE_OF_DATA, PAYLOAD_OF_DATA = 2, 3, 5
"""Fields of a message with data."""
TABLE_OF_MANIFEST = 4
"""The field of a footer's manifest that holds the table of places."""
PAYLOAD_OF_TABLE, COMPRESSION_OF_TABLE, SIZE_OF_TABLE = 2, 3, 4
PLACES, LENGTHS = "chunk_byte_offset", "chunk_byte_size"
"""Columns of a table of places."""

Fields = list[tuple[int, int | bytes]]


class Message(NamedTuple):
    """A message: its kind, and its content's place and length."""

    kind: int
    place: int
    length: int


class Packed(NamedTuple):
    """An Arrow stream in a message, and its size once unpacked."""

    payload: bytes
    compression: int
    size: int

    def unpacked(self) -> bytes:
        """The stream. Raises ExtentError."""
        if self.compression == UNCOMPRESSED:
            return self.payload
        if self.compression != LZ4:
            raise ExtentError(f"data of the unknown compression {self.compression}")
        try:
            stream: bytes = pa.Codec("lz4_raw").decompress(self.payload, self.size, asbytes=True)
        except OSError as error:
            raise ExtentError("data that cannot be unpacked") from error
        return stream


def messages_of(content: mmap.mmap) -> Iterator[Message]:
    """The whole messages of a log up to its end; what is not whole, as in a cut log, is left out."""
    place = HEADER_BYTES
    while place + MESSAGE.size <= len(content):
        kind, length = MESSAGE.unpack_from(content, place)
        place += MESSAGE.size
        if place + length > len(content):
            return
        yield Message(kind, place, length)
        if kind == END:
            return
        place += length


def fields_of(message: bytes) -> Fields:
    """The fields of a message in the format of protocol buffers, in their order. Raises ExtentError."""
    place = 0

    def number() -> int:
        nonlocal place
        value = 0
        for position in range(MOST_BYTES_OF_A_NUMBER):
            byte = message[place]
            place += 1
            value |= (byte & 0x7F) << 7 * position
            if byte < 0x80:
                return value & LARGEST_NUMBER
        raise ExtentError("a message with a number of too many bytes")

    fields: Fields = []
    try:
        while place < len(message):
            field, kind = divmod(number(), 8)
            if kind == NUMBER:
                fields.append((field, number()))
                continue
            if kind != BYTES and kind not in FIXED_BYTES:
                raise ExtentError(f"a message with a field of the unknown kind {kind}")
            length = number() if kind == BYTES else FIXED_BYTES[kind]
            if place + length > len(message):
                raise ExtentError("a message with a field beyond its end")
            fields.append((field, message[place : place + length]))
            place += length
    except IndexError as error:
        raise ExtentError("a message that ends within a field") from error
    return fields


def packed_in(message: bytes, payload: int, compression: int, size: int) -> Packed:
    """The Arrow stream in a message with these fields; of a field that is repeated the last one counts."""
    last = dict(fields_of(message))
    content, method, length = last.get(payload, b""), last.get(compression, 0), last.get(size, 0)
    if not (isinstance(content, bytes) and isinstance(method, int) and isinstance(length, int)):
        raise ExtentError("a message whose fields have other types")
    return Packed(content, method, len(content) if method == UNCOMPRESSED else length)


def data_of(content: mmap.mmap, message: Message) -> Packed:
    """The Arrow stream of a message with data."""
    whole = content[message.place : message.place + message.length]
    return packed_in(whole, PAYLOAD_OF_DATA, COMPRESSION_OF_DATA, SIZE_OF_DATA)


def tables_of_places(content: mmap.mmap, end: Message | None) -> list[Packed]:
    """The tables of a log's footer; empty without one.

    Raises ExtentError for a footer elsewhere, and for a log that goes on behind its last message.
    """
    if end is not None and end.place + end.length + TRAILER.size < len(content):
        raise ExtentError("more than one recording")
    if content[-TRAILER.size :][20:28] != TRAILER_MARK:
        return []
    place, length, *_, footers = TRAILER.unpack(content[-TRAILER.size :])
    if end is None or footers != 1 or (place, length) != (end.place, end.length):
        raise ExtentError("a footer that is not its last message")
    manifests = [one for _, one in fields_of(content[place : place + length]) if isinstance(one, bytes)]
    return [
        packed_in(table, PAYLOAD_OF_TABLE, COMPRESSION_OF_TABLE, SIZE_OF_TABLE)
        for manifest in manifests
        for field, table in fields_of(manifest)
        if field == TABLE_OF_MANIFEST and isinstance(table, bytes)
    ]


def refuse_other_places(stream: bytes, data: dict[int, int]) -> None:
    """Raise ExtentError if a footer's table names a place twice, or one without data.

    `data`: the length of each message with data, by its place.
    """
    table = pa.ipc.open_stream(stream).read_all()
    if PLACES not in table.column_names or LENGTHS not in table.column_names:
        raise ExtentError("a footer without places")
    places, lengths = table[PLACES].to_pylist(), table[LENGTHS].to_pylist()
    if len(set(places)) < len(places) or list(map(data.get, places)) != lengths:
        raise ExtentError("a footer that names data where there are none, or twice")
