"""The memory that Arrow data take, from the headers of their messages alone (Arrow's IPC format).

A header states the length of every array. An array of a type without bytes, such as null, may state any
length, and a compressed one has fewer bytes than its values. So elements are counted, not only bytes.
"""

import struct

import numpy as np
import pyarrow as pa

ELEMENT_BYTES = 8
"""Memory of an element where it is read as a number."""
HEADER_FIELD = 2
"""The field of a message that holds its record batch."""
LENGTH_FIELD, NODES_FIELD, COMPRESSION_FIELD = 0, 1, 3
"""The fields of a record batch: its rows, the length of each array, and how they are compressed."""
NODE_NUMBERS = 2
"""Numbers of an array's node: its length, and how many of its elements are null."""


class ExtentError(ValueError):
    """Arrow data of a kind that no log of a run holds; the message names it."""


def extent_bytes(stream: bytes) -> int:
    """The memory that a stream of Arrow messages takes once it is read. Raises ExtentError."""
    try:
        messages = pa.ipc.MessageReader.open_stream(stream)
        for field in pa.ipc.read_schema(messages.read_next_message()):
            if not is_plain(field.type):
                raise ExtentError(f"data of the type {field.type!s:.80}")
        elements = sum(elements_of(message) for message in messages)
    except (pa.ArrowInvalid, OSError, StopIteration, struct.error) as error:
        raise ExtentError(f"data that are no Arrow stream ({error!s:.80})") from error
    return max(len(stream), ELEMENT_BYTES * elements)


def is_plain(kind: pa.DataType) -> bool:
    """Whether the elements of a type have a place each: no dictionary, run, view or other reference."""
    inner = [kind.field(number).type for number in range(kind.num_fields)]
    if pa.types.is_union(kind):
        return all(pa.types.is_null(one) or pa.types.is_primitive(one) for one in inner)
    if (
        pa.types.is_struct(kind)
        or pa.types.is_list(kind)
        or pa.types.is_large_list(kind)
        or pa.types.is_fixed_size_list(kind)
    ):
        return all(map(is_plain, inner))
    return bool(
        pa.types.is_null(kind)
        or pa.types.is_primitive(kind)
        or pa.types.is_string(kind)
        or pa.types.is_large_string(kind)
        or pa.types.is_binary(kind)
        or pa.types.is_large_binary(kind)
        or pa.types.is_fixed_size_binary(kind)
    )


def elements_of(message: pa.ipc.Message) -> int:
    """The elements of all arrays of a record batch. Raises ExtentError for compressed and other messages."""
    if message.type != "record batch":
        raise ExtentError(f"an Arrow message of the kind {message.type}")
    header = message.metadata.to_pybytes()
    (root,) = struct.unpack_from("<I", header, 0)
    batch = target(header, field_place(header, root, HEADER_FIELD))
    if field_place(header, batch, COMPRESSION_FIELD) is not None:
        raise ExtentError("Arrow data that are compressed once more")
    length_place = field_place(header, batch, LENGTH_FIELD)
    rows = 0 if length_place is None else int(struct.unpack_from("<q", header, length_place)[0])
    nodes_place = field_place(header, batch, NODES_FIELD)
    if nodes_place is None:
        return abs(rows)
    nodes = target(header, nodes_place)
    (count,) = struct.unpack_from("<I", header, nodes)
    numbers = np.frombuffer(header, "<i8", count * NODE_NUMBERS, nodes + 4)
    lengths: list[int] = numbers[::NODE_NUMBERS].tolist()
    return abs(rows) + sum(map(abs, lengths))


def field_place(header: bytes, table: int, field: int) -> int | None:
    """The place of a table's field in a flatbuffer; None if the table leaves it out."""
    entries = table - struct.unpack_from("<i", header, table)[0]
    entry = 4 + 2 * field
    if entry >= struct.unpack_from("<H", header, entries)[0]:
        return None
    offset: int = struct.unpack_from("<H", header, entries + entry)[0]
    return table + offset if offset else None


def target(header: bytes, place: int | None) -> int:
    """The place to which a flatbuffer's reference points."""
    if place is None:
        raise ExtentError("an Arrow message without content")
    offset: int = struct.unpack_from("<I", header, place)[0]
    return place + offset
