"""Logs that are damaged, unusual, or made to harm who imports them: each as the file's name and bytes.

`HOSTILE` maps a name to a function that writes the file into a folder and returns its path. Whatever such a
file holds, an import ends soon and in little memory, with a run folder or with a sentence
(held by `tests/trust`).
"""

import gzip
import sqlite3
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

GOOD = "(1700000000.000000) can0 00E#CDCC4C3D\n"


def blf_object(
    version: int = 1, kind: int = 1, size: int | None = None, time_ns: int = 0, body: bytes = b""
) -> bytes:
    """A contained object: by default a classic frame."""
    body = body or struct.pack("<HBBL8s", 1, 0, 4, 0x00E, b"\xcd\xcc\x4c\x3d")
    whole = 32 + len(body)
    head = struct.pack("<4sHHLL", b"LOBJ", 32, version, whole if size is None else size, kind)
    return head + struct.pack("<LHHQ", 2, 0, 0, time_ns) + body


def blf_container(content: bytes, method: int = 2) -> bytes:
    packed = zlib.compress(content) if method == 2 else content
    body = struct.pack("<H6xL4x", method, len(content)) + packed
    size = 16 + len(body)
    return struct.pack("<4sHHLL", b"LOBJ", 16, 1, size, 10) + body + bytes(size % 4)


def blf(*containers: bytes) -> bytes:
    content = b"".join(containers)
    header = struct.pack("<4sL8BQ", b"LOGG", 144, *bytes(8), 144 + len(content))
    return header + bytes(144 - len(header)) + content


def binary(name: str, content: Callable[[], bytes]) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / name
        path.write_bytes(content())
        return path

    return write


def text(name: str, content: Callable[[], str]) -> Callable[[Path], Path]:
    return binary(name, lambda: content().encode("utf-8"))


def database(*statements: str) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / "bench.db"
        with sqlite3.connect(path) as made:
            for statement in statements:
                made.execute(statement)
        made.close()
        return path

    return write


PAGE_BYTES = 512
CREATED = "CREATE TABLE messages (ts, arbitration_id, extended, remote, error, dlc, data)"
INTERIOR, LEAF = 5, 13
"""Kinds of a table's pages in SQLite's file format."""


def big_endian_varint(number: int) -> bytes:
    groups = [number & 0x7F]
    while number := number >> 7:
        groups.append(number & 0x7F | 0x80)
    return bytes(reversed(groups))


def page(kind: int, cells: list[bytes], child: int = 0, head: bytes = b"") -> bytes:
    """A page of SQLite's file format with as many of the cells as it has room for."""
    first = len(head) + (12 if kind == INTERIOR else 8)
    content, places = b"", b""
    for cell in cells:
        if first + len(places) + 2 + len(content) + len(cell) > PAGE_BYTES:
            break
        content = cell + content
        places += struct.pack(">H", PAGE_BYTES - len(content))
    fixed = struct.pack(">BHHHB", kind, 0, len(places) // 2, PAGE_BYTES - len(content), 0)
    last = struct.pack(">L", child) if kind == INTERIOR else b""
    begin = head + fixed + last + places
    return begin + bytes(PAGE_BYTES - len(begin) - len(content)) + content


def interior(child: int, head: bytes = b"") -> bytes:
    """A page that names the same child again and again."""
    cells = [struct.pack(">L", child) + big_endian_varint(number) for number in range(1, 60)]
    return page(INTERIOR, cells, child, head)


def shared_pages(types: list[int], first: bytes, rest_bytes: int) -> bytes:
    """A database of a megabyte with millions of rows, all in one page, whose rest is a page in a ring.

    `types` are those of a row's columns, `first` its values in their own page.
    """
    with sqlite3.connect(":memory:") as made:
        made.execute(f"PRAGMA page_size = {PAGE_BYTES}")
        made.execute(CREATED)
        schema = made.serialize()[:PAGE_BYTES]
    made.close()
    described = b"".join(map(big_endian_varint, types))
    head_bytes = len(described) + 1 if len(described) < 127 else len(described) + 2
    row = big_endian_varint(head_bytes) + described + first
    held_bytes = head_bytes + len(first) + rest_bytes
    fewest = (PAGE_BYTES - 12) * 32 // 255 - 23
    here = fewest + (held_bytes - fewest) % (PAGE_BYTES - 4)
    here = here if here <= PAGE_BYTES - 35 else fewest
    row = (row + bytes(here))[:here] + struct.pack(">L", 6)
    rows = [big_endian_varint(held_bytes) + big_endian_varint(number) + row for number in range(1, 60)]
    ring = struct.pack(">L", 6) + bytes(PAGE_BYTES - 4)
    pages = [schema, interior(3), interior(4), interior(5), page(LEAF, rows), ring]
    whole = bytearray(b"".join(pages).ljust(2100 * PAGE_BYTES, b"\0"))
    whole[28:32] = struct.pack(">L", 2100)
    return bytes(whole)


ONE, ZERO, EMPTY = 1, 8, 12
"""Types of a row's values in SQLite: an integer of one byte, 0, bytes without any."""


def blob(length: int) -> int:
    """The type of a value of this length."""
    return 12 + 2 * length


COLUMNS = "ts, arbitration_id, extended, remote, error, dlc, data"
ENDLESS = (
    "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
    "SELECT i AS ts, 1 AS arbitration_id, 0 AS extended, 0 AS remote, 0 AS error, 0 AS dlc, "
    "x'' AS data FROM n"
)
ASC = "date Tue Nov 14 22:13:20 2023\nbase hex  timestamps absolute\ninternal events logged\n"
ASC_FRAME = "{t:.6f} 1  {can_id}             Rx   d 4 CD CC 4C 3D\n"
TRC = ";$FILEVERSION=2.1\n;$STARTTIME=45244.9\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n"

MEGABYTE = 1 << 20


def packed(line: str, head: str = "") -> bytes:
    """A text log that unpacks to sixty megabytes of one line, in a few hundred kilobytes."""
    block = line.encode() * (MEGABYTE // len(line.encode()))
    return gzip.compress(head.encode() + block * 60, 1)


def in_a_million_pieces() -> bytes:
    """A .blf log with the beginning of a large object, and a container for each byte of its rest."""
    large = blf_object(kind=72, size=60 * MEGABYTE) + bytes(30 * MEGABYTE)
    return blf(blf_container(large), *[blf_container(b"\0", method=0)] * 200_000)


def silent_for_minutes() -> str:
    """Two torques ten minutes apart, and between them as many other frames as an import takes."""
    between = "".join(f"({1000 + 0.0015 * number:.6f}) can0 123#00\n" for number in range(390_000))
    return f"(1000.000000) can0 00E#CDCC4C3D\n{between}(1585.000000) can0 00E#CDCC4C3D\n"


HOSTILE: dict[str, Callable[[Path], Path]] = {
    "blf: an object of size 0": binary(
        "a.blf", lambda: blf(blf_container(blf_object() + blf_object(size=0)))
    ),
    "blf: objects of header version 0": binary(
        "a.blf", lambda: blf(blf_container(blf_object(version=0) * 50))
    ),
    "blf: header version 0 and size 0": binary(
        "a.blf", lambda: blf(blf_container(blf_object(version=0, size=0)))
    ),
    "blf: an outer object of size 0": binary(
        "a.blf", lambda: blf(struct.pack("<4sHHLL", b"LOBJ", 16, 1, 0, 10), bytes(64))
    ),
    "blf: unpacks to 1.9 GB": binary(
        "a.blf", lambda: blf(*[blf_container(blf_object(kind=72) * 1_000_000)] * 40)
    ),
    "blf: a message shorter than its fields": binary(
        "a.blf", lambda: blf(blf_container(blf_object(body=b"ab") * 20))
    ),
    "blf: two million messages": binary("a.blf", lambda: blf(blf_container(blf_object() * 1_300_000))),
    "blf: an object in a million pieces": binary("a.blf", in_a_million_pieces),
    "blf: only a header": binary("a.blf", blf),
    "blf: a header length of 4 GB": binary(
        "a.blf", lambda: b"LOGG" + struct.pack("<L", 0xFFFFFFFF) + bytes(200)
    ),
    "blf: garbage between objects": binary(
        "a.blf", lambda: blf(blf_container(blf_object() + b"x" * 40 + blf_object()))
    ),
    "db: an endless view": database(f"CREATE VIEW messages AS {ENDLESS}"),
    "db: an endless view, capitals": database(f"CREATE VIEW MESSAGES AS {ENDLESS}"),
    "db: a virtual table": database("CREATE VIRTUAL TABLE messages USING fts5(ts)"),
    "db: other columns": database("CREATE TABLE messages (ts)"),
    "db: a generated column": database(
        "CREATE TABLE messages (ts, arbitration_id, extended, remote, error, dlc, "
        "data AS (zeroblob(900000000)))",
        "INSERT INTO messages (ts, arbitration_id, extended, remote, error, dlc) VALUES (1, 1, 0, 0, 0, 0)",
    ),
    "db: text for a length": database(
        f"CREATE TABLE messages ({COLUMNS})", "INSERT INTO messages VALUES (1, 1, 0, 0, 0, 'x', x'')"
    ),
    "db: a length of 2^60": database(
        f"CREATE TABLE messages ({COLUMNS})",
        "INSERT INTO messages VALUES (1, 1, 0, 0, 0, 1152921504606846976, x'')",
    ),
    "db: a megabyte in each of a million rows": binary(
        "bench.db",
        lambda: shared_pages(
            [ONE, ONE, blob(MEGABYTE - 100), ZERO, ZERO, ZERO, EMPTY], b"\x05\x05", MEGABYTE - 100
        ),
    ),
    "db: remote frames of 60 kB": binary(
        "bench.db",
        lambda: shared_pages([ONE, ONE, ZERO, ONE, ZERO, ZERO, blob(60_000)], b"\x05\x05\x01", 60_000),
    ),
    "db: remote frames of 200 bytes": binary(
        "bench.db",
        lambda: shared_pages([ONE, ONE, ZERO, ONE, ZERO, ZERO, blob(200)], b"\x05\x05\x01", 200),
    ),
    "db: 16,000 columns in each of a million rows": binary(
        "bench.db",
        lambda: shared_pages([ONE, ONE, ZERO, ZERO, ZERO, ZERO, EMPTY, *[ZERO] * 16_000], b"", 100),
    ),
    "db: no table": database("CREATE TABLE other (a)"),
    "log: unpacks to 1.9 GB": binary("a.log.gz", lambda: gzip.compress(bytes(1_900_000_000), 1)),
    "log: unpacks to 30 million bad lines": binary("a.log.gz", lambda: packed("a\n")),
    "log: unpacks to half a million lines of wide characters": binary(
        "a.log.gz", lambda: packed(f"# {'x' * 122}\U0001f600\n")
    ),
    "log: ten minutes without a torque": text("a.log", silent_for_minutes),
    "csv: unpacks to 30 million comments": binary("a.csv.gz", lambda: packed("#\n")),
    "trc: unpacks to 30 million bad lines": binary("a.trc.gz", lambda: packed("1\n", TRC)),
    "asc: unpacks to 15 million lines of another kind": binary("a.asc.gz", lambda: packed("1 x\n", ASC)),
    "asc: unpacks to half a million lines of another kind": binary(
        "a.asc.gz", lambda: packed(f"1.0 {'x' * 125}\n", ASC)
    ),
    "log: one line of 60 MB": text("a.log", lambda: "(1." + "0" * 60_000_000 + ") can0 1#00\n"),
    "log: two million bad lines": text("a.log", lambda: "x\n" * 2_000_000),
    "log: a time of 1e11 s": text("a.log", lambda: f"{GOOD}(99999999999.000000) can0 00E#CDCC4C3D\n"),
    "log: only a time beyond 2^63 ns": text("a.log", lambda: "(9223372037.000000) can0 00E#CDCC4C3D\n"),
    "log: a time of infinity": text("a.log", lambda: f"{GOOD}(inf) can0 00E#CDCC4C3D\n"),
    "log: plain output": text("a.log", lambda: "  can0  00E   [4]  CD CC 4C 3D\n" * 3),
    "log: NUL bytes": binary("a.log", lambda: bytes(1_000_000)),
    "asc: a header of a million lines": text("a.asc", lambda: "// x\n" * 1_000_000 + "1.0 x\n" * 100),
    "asc: unreadable data": text("a.asc", lambda: ASC + "0.1 1 00E Rx d 4 GG\n" * 900),
    "asc: a length of 10^4000": text("a.asc", lambda: ASC + f"0.1 1 00E Rx d {'9' * 4000} 00\n"),
    "trc: a start time of 1e400": text(
        "a.trc", lambda: TRC.replace("45244.9", "1e400") + "1 0.5 DT 1 00E Rx - 1 00\n"
    ),
    "trc: 150,000 columns": text(
        "a.trc", lambda: f";$COLUMNS={','.join(map(str, range(150_000)))}\n   1)  1.0  001  1 00\n"
    ),
    "trc: a header of a million lines": text("a.trc", lambda: ";x\n" * 1_000_000),
    "csv: broken base64": text(
        "a.csv", lambda: "timestamp,arbitration_id,extended,remote,error,dlc,data\n1,0x1,0,0,0,1,!!\n"
    ),
    "csv: a length of 10^4000": text("a.csv", lambda: f"h\n1,0x1,0,0,0,{'9' * 4000},AA==\n"),
    "mf4: whatever it holds": binary("a.mf4", lambda: b"MDF     4.10    vibrohil" + bytes(1000)),
}
