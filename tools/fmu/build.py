"""An FMU: the object file of a model's functions, a C shell around it, and the model's description."""

import hashlib
import itertools
import shutil
import subprocess
import tempfile
import zipfile
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from hil.record.new_file import open_anew
from tools.fmu.description import description
from tools.fmu.linker import LINKER, REMEDY
from tools.fmu.variables import FmuError, Variable

Version = Literal[2, 3]
"""Of FMI."""
PLATFORMS = {2: "linux64", 3: "x86_64-linux"}
SOURCES = Path(__file__).parent / "c"
OPTIONS = (
    "-std=gnu11",
    "-O2",
    "-march=x86-64-v2",
    "-ffp-contract=off",
    "-fPIC",
    "-fvisibility=hidden",
    "-shared",
)
WARNINGS = ("-Wall", "-Wextra", "-Werror", "-Wno-unused-parameter")


class Model(Protocol):
    """What an FMU is made of. `records` are the blocks of words that its C functions take, in this order.

    `name` is that of its C file. `fixed_step_s`: the only step that it can make; None for any.
    """

    name: str
    fixed_step_s: float | None
    variables: list[Variable]
    records: dict[str, Any]

    def code(self) -> list[bytes]:
        """The object files of its functions."""

    def header(self) -> str:
        """The part of `model.h` that only this model has."""


def arrays_in(record: Any) -> list[Any]:
    """The arrays of a record and of the records in it."""
    if isinstance(record, tuple):
        return [array for field in record for array in arrays_in(field)]
    return [record] if isinstance(record, np.ndarray) else []


def image(records: dict[str, Any]) -> tuple[list[int], list[int]]:
    """The words of the records and then of their arrays, and the places of the pointers to arrays.

    A pointer is its array's offset in bytes from the first word.
    """
    words = [word for record in records.values() for word in record.words]
    end, places = len(words), dict[int, int]()
    for array in (array for record in records.values() for array in arrays_in(record.fields)):
        places.setdefault(array.ctypes.data, 8 * len(words))
        words += np.frombuffer(array.tobytes(), np.int64).tolist()
    pointers = [place for place, word in enumerate(words[:end]) if word in places]
    for place in pointers:
        words[place] = places[words[place]]
    return words, pointers


def header(model: Model, version: Version, token: str) -> str:
    """The text of `model.h`."""
    words, pointers = image(model.records)
    sizes = [len(record.words) for record in model.records.values()]
    starts = zip(model.records, itertools.accumulate(sizes, initial=0), strict=False)
    places = ", ".join(f"{name.upper()} = {start}" for name, start in starts)
    rows = (
        f"{{\"{one.name}\", '{one.role[0]}', {literal(one.start)}, {literal(one.low)}, {literal(one.high)}}},"
        for one in model.variables
    )
    return "\n".join(
        [
            f"#define FMI {version}",
            f'#define TOKEN "{token}"',
            f"#define TOKEN_WORD 0x{token[:16]}ULL",
            f"#define VARIABLES {len(model.variables)}",
            f"#define WORDS {len(words)}",
            f"static const struct variable TABLE[] = {{{' '.join(rows)}}};",
            f"static const uint64_t IMAGE[] = {{{', '.join(f'{word & 2**64 - 1}ULL' for word in words)}}};",
            f"#define POINTER_COUNT {len(pointers)}",
            f"static const uint32_t POINTERS[POINTER_COUNT] = {{{', '.join(map(str, pointers))}}};",
            f"enum {{ {places} }};",
            *(() if model.fixed_step_s is None else (f"#define PERIOD_S {model.fixed_step_s!r}",)),
            model.header(),
        ]
    )


def literal(value: float) -> str:
    """A float in C, exact to the last bit."""
    return float(value).hex() if np.isfinite(value) else "INFINITY" if value > 0.0 else "-INFINITY"


def export(model: Model, version: Version, file: Path) -> None:
    """Build the model's FMU and write it to `file`. Raises FmuError."""
    if shutil.which(LINKER) is None:
        raise FmuError(f"an FMU needs {LINKER}; {REMEDY}")
    codes = model.code()
    text = header(model, version, "0" * 16)
    sources = b"".join(path.read_bytes() for path in sorted(SOURCES.iterdir()))
    token = hashlib.sha256(b"".join(codes) + text.encode() + sources).hexdigest()[:32]
    with tempfile.TemporaryDirectory() as folder:
        library = link(Path(folder), model.name, version, header(model, version, token), codes)
    with open_anew(file) as opened, zipfile.ZipFile(opened, "w", zipfile.ZIP_DEFLATED) as fmu:
        fmu.writestr("modelDescription.xml", description(model, version, token))
        fmu.writestr(f"binaries/{PLATFORMS[version]}/{model.name}.so", library)


def link(folder: Path, name: str, version: Version, header_text: str, codes: list[bytes]) -> bytes:
    """The shared library of the C shell and the object files."""
    (folder / "model.h").write_text(header_text)
    sources = [str(SOURCES / f"fmi{version}.c"), str(SOURCES / f"{name}.c")]
    for number, code in enumerate(codes):
        path = folder / f"model{number}.o"
        path.write_bytes(code)
        sources.append(str(path))
    result = folder / "model.so"
    command = [
        LINKER,
        *OPTIONS,
        *WARNINGS,
        "-I",
        str(folder),
        *sources,
        "-lm",
        "-Wl,-z,defs",
        "-o",
        str(result),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise FmuError(f"{LINKER} cannot link the FMU: {done.stderr.strip()}")
    return result.read_bytes()
