"""Expressions, run folders and scenarios as somebody hostile would write them."""

# ruff: noqa: E501 - one line of many short texts is easier to read than a line for each

import itertools
import json
import math
import os
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Concatenate, ParamSpec

import numpy as np
import pyarrow as pa
import rerun as rr

Spoil = Callable[[Path, Path], None]
"""Changes the files of a folder; the second argument is a file elsewhere that must not change."""

SIGNAL = "plant.x_m"
ATTRIBUTES = (
    "__class__", "__init__", "__globals__", "__dict__", "__reduce__", "__array_interface__", "T", "base", "data",
    "dtype", "dump", "dumps", "tofile", "tobytes", "ctypes", "flags", "itemset", "view", "astype", "setfield",
    "strides", "shape", "repeat", "resize", "size", "real",
)  # fmt: skip
CALLS = (
    "open('{victim}', 'w')", "exec('import os')", "eval('1')", "__import__('os')", "compile('1', '', 'eval')",
    "globals()", "locals()", "vars()", "dir()", "getattr(plant, 'x_m')", "setattr(plant, 'x_m', 1)", "print(1)",
    "input()", "breakpoint()", "exit()", "quit()", "help()", "type(1)", "range(10**9)", "list('a')", "dict()",
    "bytes(10**10)", "str(1)", "ones(10**10)", "zeros(10**9)", "arange(10**9)", "load('{victim}')",
    "save('{victim}', 1)", "savetxt('{victim}', plant.x_m)", "fromfile('{victim}')", "memmap('{victim}')",
    "loadtxt('{victim}')", "genfromtxt('http://192.0.2.1/')", "DataSource('{victim}')", "linspace(0, 1, 10**9)",
)  # fmt: skip
STATEMENTS = (
    "import os", "from os import system", "x = 1", "del plant", "for i in plant.x_m: 1", "while True: pass",
    "def f(): pass", "class A: pass", "return 1", "raise 1", "assert 0", "global x", "with open('{victim}'): 1",
    "try: 1\nexcept: 2", "1; 2", "plant.x_m = 1", "async def f(): 1", "await 1", "yield 1", "pass", "@f\ndef g(): 1",
)  # fmt: skip
FORMS = (
    "'word'", "b'bytes'", "f'{{plant.x_m}}'", "f'{{open(1)}}'", "None", "True", "...", "1j", "[1]", "(1, 2)", "{{1}}",
    "{{1: 2}}", "[x for x in plant.x_m]", "(x for x in plant.x_m)", "{{x for x in (1, 2)}}", "lambda: 1",
    "(lambda: open('{victim}', 'w'))()", "(x := 1)", "1 if 1 else 2", "1 and 2", "not 1", "1 in (1, 2)", "1 is 1",
    "1 == 1", "1 != 2", "1 < 2 < 3", "~1", "1 << 10**9", "1 >> 1", "1 & 1", "1 | 1", "1 ^ 1", "1 @ 1", "*plant.x_m",
    "plant.x_m[0]", "plant.x_m[:]", "plant.x_m[()]", "max(*plant.x_m)", "max(plant.x_m, 1)", "max(a=plant.x_m)",
    "max(**plant)", "max()", "max", "plant", "plant.x_m", "firmware", "plant.x_m.x_m", "(plant).x_m.y",
    "max(plant.x_m)(1)", "(1)(2)", "pi()", "pi.real", "1 .real", "max.__self__", "abs.__globals__", "sqrt.reduce",
    "abs.at(plant.x_m, 0, 1)", "open", "os", "os.system('touch {victim}')", "numpy", "np.save('{victim}', 1)",
)  # fmt: skip
SIZES = (
    "(((9**9999)**9999)**9999)", "9**9**9**9**9", "-9**9999", "1e999", "1" * 999, "1" * 5000, "+".join(["1"] * 400),
    "+" * 900 + "1", "-" * 5000 + "1", "(" * 90 + "1" + ")" * 90, "(" * 490 + "1" + ")" * 490, "(" * 100_000,
    "max(" * 240 + SIGNAL + ")" * 240, "[" * 5000, "plant" + ".a" * 400, "plant" + ".a" * 20_000,
    "sqrt(" * 150 + "2" + ")" * 150, "0 ** -1", "1 // 0", "1 % 0", "0.0 / 0.0", "(-8) ** 0.5", "9e307 * 10",
    "1_" * 400 + "1", "0x" + "f" * 900, "0b" + "1" * 900, "\x00", "1\x00", "1\x1b[2J", "", " ", "\n\n", "\t", "#",
    "1 # \x1b]0;title\x07", "\ufeff1", "\u202e1", "ｏｐｅｎ('{victim}')", "plant.ｘ_m", "\ud800", "1\\\n+", "'" * 3,
    '"' * 900, "\\", "$x", "?", "a b", "1__1", "01", "1e", "1.e400", "`1`", "<>", "=", ":=", "->", "!",
)  # fmt: skip
SHOWN = tuple(
    "{signal}.astype('S1').dtype.type(b'x').tofile('{victim}')".replace("{signal}", signal)
    for signal in (SIGNAL, "plant.t_s", "firmware.outputs.torque_n_m")
)


def expressions(victim: Path) -> list[str]:
    """Hostile expressions; those that name a file would write or read `victim`."""
    attributes = [f"{SIGNAL}.{name}" for name in ATTRIBUTES]
    called = [f"{SIGNAL}.{name}('{{victim}}')" for name in ATTRIBUTES]
    within = [f"max({text})" for text in (*attributes[:8], *CALLS[:8])]
    texts = itertools.chain(attributes, called, within, CALLS, STATEMENTS, FORMS, SIZES, SHOWN)
    return [text.replace("{victim}", str(victim)).replace("{{", "{").replace("}}", "}") for text in texts]


P = ParamSpec("P")


def spoiler(change: Callable[Concatenate[Path, Path, P], None]) -> Callable[P, Spoil]:
    """Let a function of a folder, the file elsewhere and further arguments be called with the latter alone."""

    def of(*arguments: P.args, **named: P.kwargs) -> Spoil:
        return lambda run_dir, victim: change(run_dir, victim, *arguments, **named)

    return of


@spoiler
def _linked(run_dir: Path, victim: Path, name: str, place: Path | None = None) -> None:
    (run_dir / name).unlink(missing_ok=True)
    (run_dir / name).symlink_to(place or victim)


@spoiler
def _piped(run_dir: Path, victim: Path, name: str) -> None:
    (run_dir / name).unlink(missing_ok=True)
    os.mkfifo(run_dir / name)


@spoiler
def _sparse(run_dir: Path, victim: Path, name: str) -> None:
    with (run_dir / name).open("wb") as file:
        file.truncate(1 << 40)


@spoiler
def _content(run_dir: Path, victim: Path, name: str, content: bytes) -> None:
    (run_dir / name).write_bytes(content)


@spoiler
def _holes(run_dir: Path, victim: Path, name: str) -> None:
    """A file that continues in six gigabytes of holes; a trace counts them as records."""
    with (run_dir / name).open("r+b") as file:
        head = file.read(24)
        file.truncate(6 << 30)
        if name.endswith(".trace"):
            _, header_bytes, record_bytes, _ = struct.unpack("<8sIIQ", head)
            file.seek(16)
            file.write(struct.pack("<Q", ((6 << 30) - header_bytes) // record_bytes))


@spoiler
def _large(run_dir: Path, victim: Path, name: str, before: str, item: str, after: str) -> None:
    """A note of sixty megabytes that repeats an item."""
    (run_dir / name).write_text(before + item * ((60 << 20) // len(item)) + after)


@spoiler
def _rebuilt(run_dir: Path, victim: Path, spoil: Spoil) -> None:
    """Leave the log out, so that it is rebuilt from the traces."""
    (run_dir / "run.rrd").unlink()
    spoil(run_dir, victim)


@spoiler
def _trace(
    run_dir: Path,
    victim: Path,
    columns: object = (("t_s", "d"), ("x_m", "d")),
    header_bytes: int = 4096,
    record_bytes: int = 16,
    count: int = 3,
    size: int = 4096 + 48,
) -> None:
    """A trace of the plant with this header and zeros behind it up to `size`, and no log."""
    (run_dir / "run.rrd").unlink()
    head = struct.pack("<8sIIQ", b"VHTRACE1", header_bytes, record_bytes, count)
    with (run_dir / "plant.trace").open("wb") as file:
        file.write(head + json.dumps(columns).encode())
        file.truncate(size)


@spoiler
def _logged(
    run_dir: Path,
    victim: Path,
    run: str = "{}",
    scenario: str = "",
    loads: Sequence[float] = (),
    signals: Mapping[str, Sequence[object]] = MappingProxyType({}),
) -> None:
    """A log with these texts, loads of the bus, and a trace of the plant."""
    recording = rr.RecordingStream("vibrohil", recording_id="foreign")
    recording.save(run_dir / "run.rrd")
    for name, text in (("run", run), ("scenario", scenario)):
        recording.log(f"about/{name}", rr.TextDocument(text), static=True)
    if loads:
        _send(recording, "can/load", len(loads), rr.Scalars.columns(scalars=loads))
    if signals:
        struct = pa.StructArray.from_arrays([*map(pa.array, signals.values())], names=[*signals])
        records = rr.DynamicArchetype.columns(archetype="trace", components={"record": struct})
        _send(recording, "plant", len(struct), records)
    recording.disconnect()


@spoiler
def _array(run_dir: Path, victim: Path, make: Callable[[], pa.Array]) -> None:
    """A log whose one row holds an array."""
    recording = rr.RecordingStream("vibrohil", recording_id="foreign")
    recording.save(run_dir / "run.rrd")
    array = make()
    columns = rr.DynamicArchetype.columns(archetype="trace", components={"record": array})
    _send(recording, "plant", 1, columns.partition([len(array)]))
    recording.disconnect()


def _send(recording: rr.RecordingStream, entity: str, rows: int, columns: Iterable[object]) -> None:
    t_s = np.arange(rows, dtype=float)
    times = [rr.TimeColumn("sim_time", duration=t_s), rr.TimeColumn("wall_time", timestamp=t_s)]
    recording.send_columns(entity, times, [*columns])


@spoiler
def _noted(run_dir: Path, victim: Path, **values: object) -> None:
    """The run's note with other values."""
    note = json.loads((run_dir / "run.json").read_text())
    (run_dir / "run.json").write_text(json.dumps(note | values))


def _endless(name: str) -> Spoil:
    return _linked(name, Path("/dev/zero"))


IN_SHARED_MEMORY = _linked("plant.trace", Path("/dev/shm/vibrohil-of-somebody-else"))
"""A link like those of a run under user-mode Linux, to a file of somebody else in the shared memory."""
SCENARIO = """
title = "The module stands still for a tenth of a second"
scene = "table1-motor-soft"

[script]
duration_s = 0.1

[[checks]]
name = "impact_count"
high = 0
"""

FILES = (
    "run.rrd",
    "run.rrd.new",
    "run.rrd.mended",
    "run.json",
    "scenario.toml",
    "plant.trace",
    "firmware.trace",
    "can.log",
    "verdict.json",
)
LONG_CHECK = f"[[checks]]\nname = 'x'\nhigh = 1.0\nexpression = 'max({'+'.join(['plant.x_m'] * 90)})'\n"
LONG_KEY = f"{'.'.join('a' * 4500)} = 1\n"
MANY_KEYS = "".join(f"[{number:x}.a.a.a.a.a.a.a]\n" for number in range(20_000))
LONG = ("can.log", "plant.trace", "firmware.trace", "impacts.trace", "operator.trace")
NULLS = 200_000_000


def bits(count: int) -> pa.Array:
    """An array of packed bits, of which 255 bytes are packed into one."""
    return pa.Array.from_buffers(pa.bool_(), count, [None, pa.py_buffer(bytes(count // 8 + 1))])


def pack_by_arrow(log: Path) -> None:
    """Write a log's first chunk anew, as an Arrow stream that is itself packed, by more than LZ4 does."""
    content, place = log.read_bytes(), 12
    kept = content[:place]
    while (header := struct.unpack_from("<QQ", content, place))[0] != 2:
        kept += content[place : place + 16 + header[1]]
        place += 16 + header[1]
    table, stream = pa.table({"x": np.zeros(1 << 26)}), pa.BufferOutputStream()
    with pa.ipc.new_stream(stream, table.schema, options=pa.ipc.IpcWriteOptions(compression="zstd")) as one:
        one.write_table(table)
    packed = stream.getvalue().to_pybytes()
    record = b"\x10\x01\x20\x01\x2a" + varint(len(packed)) + packed
    log.write_bytes(kept + struct.pack("<QQ", 2, len(record)) + record + content[place + 16 + header[1] :])


def varint(number: int) -> bytes:
    """A number as protobuf writes it."""
    low = bytes([number & 0x7F | (0x80 if number > 0x7F else 0)])
    return low + varint(number >> 7) if number > 0x7F else low


NOTES = ("run.json", "outcome.json", "processes.json", "scenario.toml", "verdict.json")
FOLDERS: dict[str, Spoil] = {
    "as it was": lambda run_dir, victim: None,
    **{f"{name} is a link": _linked(name) for name in (*FILES, "outcome.json", "frames.mcap")},
    "frames.mcap is a link to nothing": lambda run_dir, victim: _linked(
        "frames.mcap", victim.with_name("made")
    )(run_dir, victim),
    **{f"{name} is a pipe": _piped(name) for name in FILES},
    **{f"{name} is endless": _endless(name) for name in FILES},
    **{
        f"{name} is sparse": _sparse(name)
        for name in ("run.json", "scenario.toml", "run.rrd", "outcome.json", "verdict.json", "can.log")
    },
    **{f"{name} is nested": _content(name, b"[" * 100_000) for name in NOTES},
    **{f"{name} is empty": _content(name, b"") for name in (*FILES, *NOTES)},
    **{f"{name} is noise": _content(name, bytes(range(256)) * 16) for name in (*FILES, *NOTES)},
    **{f"{name} of holes and no log": _rebuilt(_holes(name)) for name in LONG},
    "a verdict of 20 million lists": _large("verdict.json", '{"passed": true, "impacts": [[]', ",[]", "]}"),
    "a note of 20 million lists and no log": _rebuilt(
        _large("run.json", '{"made_by": "vibrohil", "a": [[]', ",[]", "]}")
    ),
    "a scenario of 10 million tables and no log": _rebuilt(_large("scenario.toml", "", "[[a]]\n", "")),
    "a verdict of other types": _content(
        "verdict.json",
        b'{"passed": true, "provenance": ["x"], "scenario": {"a": 1}, "regime": ["x"], "speed": "x", '
        b'"fault": 1e999, "impact_v_m_s": "x", "estimate": [1]}',
    ),
    "a verdict that is a list": _content("verdict.json", b'{"passed": [true], "provenance": null}'),
    "run.rrd of loads that are no shares": _logged(loads=[math.inf, -1e300, math.nan]),
    "run.rrd of texts": _logged(signals={"tick": ["a", "b"], "x_m": ["c", "d"]}),
    "run.rrd of times that are texts": _logged(signals={"t_s": ["a", "b"]}),
    "run.rrd of lists": _logged(signals={"tick": [[1], [2]], "x_m": [[1.0], [2.0]]}),
    "run.rrd of 300 million nulls": _array(
        lambda: pa.StructArray.from_arrays([pa.nulls(NULLS // 2)] * 3, names=["tick", "x_m", "v_m_s"])
    ),
    "run.rrd of values without bytes": _array(
        lambda: pa.Array.from_buffers(pa.binary(0), NULLS, [None, pa.py_buffer(b"")])
    ),
    "run.rrd of 250 million packed bits": _array(
        lambda: pa.StructArray.from_arrays([bits(NULLS // 8)] * 10, names=list("abcdefghij"))
    ),
    "run.rrd of 4,000 million packed bits": _array(
        lambda: pa.StructArray.from_arrays([bits(NULLS // 2)] * 40, names=list(map(str, range(40))))
    ),
    "run.rrd that Arrow has packed too": lambda run_dir, victim: pack_by_arrow(run_dir / "run.rrd"),
    "run.rrd of a run of 200 million": _array(
        lambda: pa.RunEndEncodedArray.from_arrays(pa.array([NULLS], pa.int32()), pa.array([0.0]))
    ),
    "run.rrd with a scenario of 10 million tables": _logged(scenario="[[a]]\n" * 10_000_000),
    "run.rrd with a note of 20 million lists": _logged(run='{"a": [' + "[]," * 20_000_000 + "[]]}"),
    "scenario.toml of one long key": _content("scenario.toml", LONG_KEY.encode()),
    "scenario.toml of one long key and no log": _rebuilt(_content("scenario.toml", LONG_KEY.encode())),
    "run.rrd with a scenario of one long key": _logged(scenario=LONG_KEY),
    "run.rrd with a scenario of many keys": _logged(scenario=MANY_KEYS),
    "run.rrd with 4,000 long checks": _logged(
        scenario=LONG_CHECK * 4000, signals={"tick": [1, 2], "x_m": [0.0, 1.0]}
    ),
    "run.rrd with notes of other types": _logged(run='["x"]', scenario="scene = 1\nscript = 'x'\n"),
    "a trace in the shared memory": IN_SHARED_MEMORY,
    "a trace in the shared memory and no log": _rebuilt(IN_SHARED_MEMORY),
    "traces alone, a pipe": _rebuilt(_piped("plant.trace")),
    "traces alone, noise": _rebuilt(_content("plant.trace", bytes(range(256)) * 16)),
    "a trace": _trace(),
    "a trace with a short header": _trace(header_bytes=4),
    "a trace with a header of 4 GB": _trace(header_bytes=2**32 - 1),
    "a trace without columns": _trace(columns=[], record_bytes=0),
    "a trace of unknown types": _trace(columns=[["t_s", "O"]], record_bytes=8),
    "a trace with a column twice": _trace(columns=[["t_s", "d"], ["t_s", "d"]]),
    "a trace of texts": _trace(columns="t_s"),
    "a trace with holes": _trace(count=2**40, size=1 << 40),
    "a trace of no records": _trace(count=0),
    "a period of nothing": _noted(period_s=0.0),
    "a period of 1e-300 s": _noted(period_s=1e-300),
    "a period that is a text": _noted(period_s="x"),
    "a clock that is a list": _noted(clock=["lockstep"]),
    "a real clock": _noted(clock="real"),
    "a start at the end of time": _noted(wall_start_s=1e308),
    "a name with control characters": _noted(scenario="\x1b]0;title\x07[red]"),
    "a scenario of a day": _content("scenario.toml", SCENARIO.replace("= 0.1", "= 86400.0").encode()),
    "a scenario like a file elsewhere": lambda run_dir, victim: _content(
        "scenario.toml", f'like = "{victim}.toml"\n'.encode()
    )(run_dir, victim),
}
"""What is done to a run's folder before it is handed over; `victim` is a file elsewhere that must not change."""


@spoiler
def _scenario(folder: Path, victim: Path, before: str, after: str) -> None:
    """A scenario with other text; `{victim}` stands for the file elsewhere."""
    assert before in SCENARIO
    text = SCENARIO.replace(before, after).replace("{victim}", str(victim))
    (folder / "mine.toml").write_text(text)
    os.mkfifo(folder / "pipe.toml")
    (folder / "link.toml").symlink_to("/dev/zero")


SCENE, TITLE = 'scene = "table1-motor-soft"', '"The module stands still for a tenth of a second"'
FAULT = "\n[[script.faults]]\nkind = 'dropped'\nframes = ['Accelerometer']\nat_s = 0.05\nduration_s = 0.001\n"
COPIES = "\n[[script.faults]]\nkind = 'duplicated'\nframes = ['Accelerometer']\nat_s = 0.0\ncopies = 100\n"
CHECK = "[[checks]]"
SCENARIOS: dict[str, Spoil] = {
    **{
        f"{key} = {place}": _scenario(SCENE, f'{SCENE if key != "scene" else ""}\n{key} = "{place}"')
        for key in ("scene", "like", "firmware")
        for place in (
            "{victim}",
            "/dev/zero",
            "pipe.toml",
            "link.toml",
            "mine.toml",
            "/proc/self/mem",
            "../../x.toml",
        )
    },
    "a title of a megabyte": _scenario(TITLE, '"' + "x" * 1_000_000 + '"'),
    "a title with control characters": _scenario(TITLE, r'"\u001b]0;title\u0007\u009b2J [red]"'),
    "a title with a picture": _scenario(TITLE, '"![x](http://192.0.2.1/x.png)<img src=//192.0.2.1/>"'),
    "a title that ends a script": _scenario(TITLE, '"</script><script>alert(1)</script>"'),
    "cases with paths for names": _scenario(
        CHECK, '[[vary]]\nname = ["../../made", "/made"]\nscene.drive.ratio = [1.1, 1.2]\n\n' + CHECK
    ),
    "many cases": _scenario(CHECK, f"[[vary]]\nseed = {list(range(1000))}\n\n{CHECK}"),
    "too many cases": _scenario(
        CHECK, "".join(f"[[vary]]\n{key} = {list(range(900))}\n" for key in ("seed", "x", "y")) + CHECK
    ),
    "1000 checks": _scenario(
        CHECK, "[[checks]]\nname = 'x'\nexpression = 'max(plant.x_m)'\nhigh = 1.0\n" * 1000 + CHECK
    ),
    "1000 faults": _scenario("duration_s = 0.1\n", "duration_s = 0.1\n" + FAULT * 1000),
    "faults that multiply each other's frames": _scenario(
        "duration_s = 0.1\n", "duration_s = 0.1\n" + COPIES * 6
    ),
    "a hundred floods": _scenario(
        "duration_s = 0.1\n",
        "duration_s = 0.1\n" + "[[script.faults]]\nkind = 'flood'\nat_s = 0.0\nframes_a_tick = 1000\n" * 100,
    ),
    "a walk of many days": _scenario(
        f"{SCENE}\n\n[script]\nduration_s = 0.1\n",
        "like = 'a-steady-walk-has-a-pulse-in-every-push-off'\n[[scene.gait.pace]]\nat_s = 0.0\nstride_hz = 1.5\n"
        "[[scene.gait.pace]]\nat_s = 1e6\nstride_hz = 1.5\n[script]\nduration_s = 0.1\ncommands = []\n",
    ),
    "10,000 commands": _scenario(
        "duration_s = 0.1\n",
        "duration_s = 0.1\ncommands = [" + "{at_s = 0.01, request = 'idle', ratio = 0.0}," * 10_000 + "]\n",
    ),
    "a foreign node every 20 microseconds": _scenario(
        "duration_s = 0.1\n",
        "duration_s = 0.1\n[[script.faults]]\nkind = 'babbling'\nat_s = 0.01\nduration_s = 0.05\nperiod_s = 2e-5\ncan_id = 0\ndata_hex = '00'\n",
    ),
    "a build that is a path": _scenario(SCENE, f'{SCENE}\n[build]\nfirmware = "{{victim}}"\n'),
}
"""Scenarios, each written into a folder as `mine.toml`."""
