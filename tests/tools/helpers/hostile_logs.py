"""Logs that are damaged, unusual, or made to harm who imports them: each as the file's name and bytes.

`HOSTILE` maps a name to a function that writes the file into a folder and returns its path. Whatever such a
file holds, an import ends soon and in little memory, with a run folder or with a sentence
(held by `tests/trust`).
"""

import gzip
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
    "log: unpacks to 1.9 GB": binary("a.log.gz", lambda: gzip.compress(bytes(100_000_000), 1) * 19),
    "log: unpacks to 30 million bad lines": binary("a.log.gz", lambda: packed("a\n")),
    "log: unpacks to half a million lines of wide characters": binary(
        "a.log.gz", lambda: packed(f"# {'x' * 122}\U0001f600\n")
    ),
    "log: ten minutes without a torque": text("a.log", silent_for_minutes),
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
    "mf4: whatever it holds": binary("a.mf4", lambda: b"MDF     4.10    vibrohil" + bytes(1000)),
}
