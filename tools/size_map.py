"""Sizes of the firmware: code by module, RAM by block.

LLVM inlines most functions into the tick. So the assembly is compiled once more with a line number on each
instruction; line numbers do not change the machine code. The line table of the object file then states the
source module of each address, for inlined functions too. Instructions that LLVM has merged from several, or
moved, have no source module any more.
"""

import hashlib
import json
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm

import firmware_py
from firmware_py.builds import machine_code
from firmware_py.builds.flat import layout
from firmware_py.core.state import Config
from firmware_py.node.tick import NodeState

PLACELESS = "merged or moved"
SizeMap = dict[str, dict[str, int]]

_FUNCTION = re.compile(r'^define .*?@("[^"]+"|[^\s("]+)\(.*\{$')
_METADATA = re.compile(r"^!(\d+) = ", re.MULTILINE)
_GOES_ON = ("[", "(", ",")
"""Last characters of a line whose instruction continues on the next line."""
_HEAD = """!llvm.dbg.cu = !{{!{unit}}}
!llvm.module.flags = !{{!{version}, !{dwarf}}}
!{version} = !{{i32 2, !"Debug Info Version", i32 3}}
!{dwarf} = !{{i32 7, !"Dwarf Version", i32 4}}
!{nothing} = !{{null}}
!{kind} = !DISubroutineType(types: !{nothing})
!{file} = !DIFile(filename: "vibro_firmware", directory: "")
!{unit} = distinct !DICompileUnit(language: DW_LANG_C99, file: !{file}, isOptimized: true, \
runtimeVersion: 0, emissionKind: LineTablesOnly)"""
_EXTENDED, _END_OF_SEQUENCE, _COPY = 0, 1, 1
_ADVANCE_PC, _ADVANCE_LINE, _SET_FILE, _CONST_ADD_PC, _FIXED_ADVANCE_PC = 2, 3, 4, 8, 9
_NAMES = ("unit", "version", "dwarf", "nothing", "kind", "file")


def size_map(target: machine_code.TargetName) -> SizeMap:
    """Bytes of `code` by module, and of `config` and `state` by block, each with the largest first."""
    precision = machine_code.TARGETS[target].precision
    state = layout(NodeState, precision)
    core = {f"core.{name}": size for name, size in blocks(state.fields["core"][0]).items()}
    parts = {
        "code": code_by_module(target),
        "config": blocks(layout(Config, precision)),
        "state": {name: size for name, size in blocks(state).items() if name != "core"} | core,
    }
    return {part: dict(sorted(sizes.items(), key=lambda one: -one[1])) for part, sizes in parts.items()}


def blocks(kind: Any) -> dict[str, int]:
    """Bytes of a record's members, each including the padding after it."""
    begins = [place for _, place in kind.fields.values()]
    sizes = (end - begin for begin, end in zip(begins, [*begins[1:], kind.itemsize], strict=True))
    return dict(zip(kind.fields, sizes, strict=True))


def code_by_module(target: machine_code.TargetName) -> dict[str, int]:
    """Bytes of machine code from each module; empty if the object files of this platform are not ELF."""
    digest = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16]
    path = machine_code.kept(f"{target}-{digest}.json")
    if not path.exists():
        assembly = machine_code.NAMES_EXCEPTION.sub("", machine_code.raw_assembly())
        tick = assembly.partition("\n")[0].removeprefix("; ")
        wrapped = assembly + machine_code.WRAPPER.format(tick=tick, state_size=1, state="\\00")
        code = machine_code.retargeted(with_lines(wrapped), machine_code.TARGETS[target], machine_code.KEPT)
        fresh = path.with_suffix(".new")
        fresh.write_text(json.dumps(bytes_by_file(line_table(code))))
        fresh.replace(path)
    found: dict[str, int] = json.loads(path.read_text())
    return found


def with_lines(assembly: str) -> str:
    """LLVM assembly in which each instruction has a location in a file named after its function's module."""
    number = max((int(found) for found in _METADATA.findall(assembly)), default=-1) + 1
    named = dict(zip(_NAMES, range(number, number + len(_NAMES)), strict=True))
    number += len(_NAMES)
    files: dict[str, int] = {}
    metadata, lines, place = [_HEAD.format(**named)], [], None
    for line in assembly.split("\n"):
        if found := _FUNCTION.match(line):
            module = module_of(found.group(1).strip('"'))
            if module not in files:
                files[module] = number
                metadata.append(f'!{number} = !DIFile(filename: "{module}", directory: "")')
                number += 1
            function, place, number = number, number + 1, number + 2
            metadata.append(
                f'!{function} = distinct !DISubprogram(name: "f{function}", scope: !{files[module]}, '
                f"file: !{files[module]}, line: 1, type: !{named['kind']}, "
                f"spFlags: DISPFlagDefinition | DISPFlagOptimized, unit: !{named['unit']})"
            )
            metadata.append(f"!{place} = !DILocation(line: 1, scope: !{function})")
            lines.append(f"{line[:-1]}!dbg !{function} {{")
            continue
        if line == "}":
            place = None
        is_case = line.startswith("    ") and not line.endswith(")")  # a case of a switch
        is_instruction = line.startswith("  ") and not is_case and not line.endswith(_GOES_ON)
        lines.append(f"{line}, !dbg !{place}" if place is not None and is_instruction else line)
    return "\n".join([*lines, *metadata, ""])


def module_of(symbol: str) -> str:
    """The module of a firmware function, from numba's name for it; for another symbol its package, or itself.

    >>> module_of("_ZN11firmware_py4core10elementary11sine_cosineB3v18B42c8tJTIeFIjxB2dd")
    'core.elementary'
    >>> module_of("_ZN5numba7cpython8builtins6ol_maxB3v1B42c8tJdd"), module_of("vibro_tick")
    ('numba', 'vibro_tick')
    """
    parts, rest = [], symbol.removeprefix("_ZN") if symbol.startswith("_ZN") else ""
    while found := re.match(r"\d+", rest):
        end = found.end() + int(found.group())
        parts.append(rest[found.end() : end])
        rest = rest[end:]
    for count in range(len(parts), 1, -1):
        path = Path(firmware_py.__file__).parent.joinpath(*parts[1:count]).with_suffix(".py")
        if parts[0] == "firmware_py" and path.exists():
            return ".".join(parts[1:count])
    return parts[0] if parts else symbol


def line_table(code: bytes) -> bytes:
    """The line table of an object file (ELF section .debug_line); empty if there is none."""
    for section in llvm.ObjectFileRef.from_data(code).sections():
        if section.name() == b".debug_line":
            return bytes(section.data())
    return b""


class _Bytes:
    """A reader of the numbers and texts of a byte string, one after the other."""

    def __init__(self, content: bytes) -> None:
        self._content, self.place = content, 0

    def number(self, size: int) -> int:
        """Read an unsigned, little-endian number of `size` bytes."""
        self.place += size
        return int.from_bytes(self._content[self.place - size : self.place], "little")

    def leb128(self, signed: bool = False) -> int:
        """Read a LEB128 number: seven bits per byte, the least significant first."""
        value = shift = 0
        while True:
            byte = self.number(1)
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value - (1 << shift) if signed and byte & 0x40 else value

    def text(self) -> str:
        """Read a text that ends at a byte of 0."""
        end = self._content.index(0, self.place)
        begin, self.place = self.place, end + 1
        return self._content[begin:end].decode()


def bytes_by_file(table: bytes) -> dict[str, int]:
    """Bytes of code that come from each file, according to a line table (DWARF 4, section 6.2)."""
    found: Counter[str] = Counter()
    reader = _Bytes(table)
    while reader.place < len(table):
        for name, size in _spans(reader):
            found[name] += size
    return dict(found)


class _Head(NamedTuple):
    """Header of one unit of the line table: the parameters of its line number program."""

    end: int
    step: int
    line_base: int
    line_range: int
    operands: list[int]
    files: list[str]

    def advance(self, opcode: int) -> tuple[int, int]:
        """Return the advance of the address, in bytes, and of the line by a special opcode."""
        steps, lines = divmod(opcode - len(self.operands) - 1, self.line_range)
        return self.step * steps, self.line_base + lines


def _head(reader: _Bytes) -> _Head:
    length = reader.number(4)
    end = reader.place + length
    version = reader.number(2)
    if version != 4:
        raise ValueError(f"a table of lines of DWARF {version}; wanted DWARF 4, which `with_lines` asks for")
    reader.number(4)
    step = reader.number(1)
    reader.number(2)
    line_base = reader.number(1) - 256  # a signed byte, negative in practice
    line_range, opcode_base = reader.number(1), reader.number(1)
    operands = [reader.number(1) for _ in range(opcode_base - 1)]
    while reader.text():
        """Skip the name of a folder."""
    files = [""]
    while name := reader.text():
        files.append(name)
        for _ in range(3):
            reader.leb128()
    return _Head(end, step, line_base, line_range, operands, files)


def _spans(reader: _Bytes) -> Iterator[tuple[str, int]]:
    """Yield file and size in bytes of each range of addresses, by running one unit's line number program."""
    head = _head(reader)
    file = line = 1
    name, size = PLACELESS, 0  # the newest row's file, and the bytes since that row
    while reader.place < head.end:
        opcode = reader.number(1)
        ends_a_row = opcode > len(head.operands) or opcode == _COPY
        if opcode > len(head.operands):
            more, lines = head.advance(opcode)
            size, line = size + more, line + lines
        elif opcode == _EXTENDED:
            length = reader.leb128()
            ends_a_row = reader.number(1) == _END_OF_SEQUENCE
            reader.place += length - 1
        elif opcode == _ADVANCE_PC:
            size += head.step * reader.leb128()
        elif opcode == _ADVANCE_LINE:
            line += reader.leb128(signed=True)
        elif opcode == _SET_FILE:
            file = reader.leb128()
        elif opcode == _CONST_ADD_PC:
            size += head.advance(255)[0]
        elif opcode == _FIXED_ADVANCE_PC:
            size += reader.number(2)
        else:
            for _ in range(head.operands[opcode - 1]):
                reader.leb128()
        if ends_a_row:
            yield name, size
            file, line = (1, 1) if opcode == _EXTENDED else (file, line)
            name, size = head.files[file] if line > 0 else PLACELESS, 0
