"""The emitted C: the frames of the Python source, no warnings, changes in place where nothing else reads."""

import ctypes
import functools
import itertools
import json
import random
import subprocess
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from closed_loop import Bench
from compilers import require_compiler
from xcp_session import commands_of

from firmware_py.builds.c99 import header
from firmware_py.builds.c99.body import Body
from firmware_py.builds.c99.emitter import Emitter, emit
from firmware_py.builds.c99.folder import OPTIONS
from firmware_py.builds.c99.lines import WIDTH
from firmware_py.builds.c99.shape import UntranslatableError
from firmware_py.builds.c_compiler import shared_library
from firmware_py.builds.flat import Precision
from firmware_py.core.estimation import kalman
from firmware_py.interface.frame import Frame
from firmware_py.shell.native import NativeNode, emitted_functions
from firmware_py.shell.node import FirmwareNode
from firmware_py.shell.parameters import config_from
from tools import cli

STRICT = ("-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror")


class Part(NamedTuple):
    """A record within another."""

    a: int
    b: float


class Whole(NamedTuple):
    """A record."""

    part: Part
    other: Part
    n: int


def advance(part: Part, step: int) -> Part:
    """One more."""
    return part._replace(a=part.a + step)


def follow(part: Part, other: Part) -> Part:
    """After another."""
    return Part(other.a, part.b)


def swap(whole: Whole) -> Whole:
    """Both values are read before either is changed."""
    return whole._replace(part=whole.other, other=whole.part)


def write_back(whole: Whole) -> Whole:
    """The member is changed where it lies."""
    part = whole.part
    part = advance(part, 1)
    return whole._replace(part=part, n=whole.n + 1)


def keep_copy(whole: Whole) -> Whole:
    """The member is read after the change, so a copy is changed."""
    part = whole.part
    part = advance(part, whole.part.a)
    part = advance(part, whole.part.a)
    return whole._replace(part=part)


def overlap(whole: Whole) -> Whole:
    """An argument points to the record that the call changes."""
    return whole._replace(part=follow(whole.part, whole.part))


def apart(whole: Whole) -> Whole:
    """An argument points to another member."""
    return whole._replace(part=follow(whole.part, whole.other))


def early(whole: Whole, step: int) -> Whole:
    """The function may return before the member is written back."""
    part = advance(whole.part, step)
    if step > 3:
        return whole
    return whole._replace(part=part)


def read_later(whole: Whole) -> tuple[Whole, int]:
    """A result reads what another result changes."""
    return whole._replace(n=0), whole.n


def power(n: int) -> int:
    """Outside the subset."""
    return n**2


@functools.cache
def emitter_of_records() -> Emitter:
    return Emitter("double", True)


def lines_of(function: object) -> list[str]:
    text = Body(emitter_of_records(), function).translate()[1]  # type: ignore[arg-type]
    return [line.strip() for line in text.splitlines() if not line.startswith(("/*", "static", " *", "}"))]


@pytest.mark.parametrize(
    ("function", "wanted"),
    [
        (advance, ["part->a = part->a + step;"]),
        (write_back, ["test_c99_advance(&whole->part, 1);", "whole->n = whole->n + 1;"]),
        (apart, ["test_c99_follow(&whole->part, &whole->other);"]),
        (
            swap,
            ["const vibro_part other = whole->part;", "whole->part = whole->other;", "whole->other = other;"],
        ),
        (
            keep_copy,
            [
                "vibro_part part = whole->part;",
                "test_c99_advance(&part, whole->part.a);",
                "test_c99_advance(&part, whole->part.a);",
                "whole->part = part;",
            ],
        ),
        (
            overlap,
            [
                "vibro_part part = whole->part;",
                "test_c99_follow(&part, &whole->part);",
                "whole->part = part;",
            ],
        ),
        (
            early,
            [
                "vibro_part part = whole->part;",
                "test_c99_advance(&part, step);",
                "if (step > 3) {",
                "return;",
                "}",
                "whole->part = part;",
            ],
        ),
        (read_later, ["const int64_t result = whole->n;", "whole->n = 0;", "return result;"]),
    ],
)
def test_a_record_is_changed_in_place_only_where_nothing_else_reads_it(
    function: object, wanted: list[str]
) -> None:
    assert lines_of(function) == wanted


def test_what_cannot_be_translated_is_refused_with_file_and_line() -> None:
    line = power.__code__.co_firstlineno + 2
    with pytest.raises(
        UntranslatableError, match=rf"test_c99\.py:{line}: this operator is outside the subset"
    ):
        lines_of(power)


class Emitted(NativeNode):
    """The emitted C as a node, which judges requests of XCP itself."""

    @staticmethod
    def load_functions() -> list[Any]:
        """The functions of the emitted C."""
        return emitted_functions("double")

    def calibrate(self) -> bool:
        """Judge the waiting request in C."""
        config, state, _ = (ctypes.c_void_p(address) for address in self._addresses)
        ctypes.CDLL(str(shared_library("host"))).vibro_calibrate(config, state)
        return False


def test_two_types_of_one_name_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(header, "c_name", lambda kind: f"vibro_{kind.__name__.lower()[:3]}")
    with pytest.raises(UntranslatableError, match=r"two types would be .* in C"):
        Emitter("double", has_gait=True)


def test_the_c_sends_the_bytes_of_the_python_source(monkeypatch: pytest.MonkeyPatch) -> None:
    """Among lost frames, missed periods and commands of XCP, with the algebra written out in both."""
    require_compiler("gcc")
    monkeypatch.setattr(kalman, "predict", kalman.predict_written_out)
    monkeypatch.setattr(kalman, "update", kalman.update_written_out)
    config, dice = config_from({"start.rise_s": 1.0}), random.Random(1)
    node = FirmwareNode(config)
    emitted, commands, sent = Emitted(config), commands_of(dice, 300), []

    def change(_: int, frames: list[Frame]) -> list[Frame]:
        kept = [one for one in frames if dice.random() < 0.99]
        given = [*kept, *itertools.islice(commands, dice.random() < 0.5)]
        elapsed_ticks = 4 if dice.random() < 0.01 else 1
        ours = node.tick(given, elapsed_ticks)
        assert emitted.tick(given, elapsed_ticks) == ours
        sent.extend(ours)
        return kept

    bench = Bench({"start.rise_s": 1.0}, change=change, build="python")
    bench.run(0.12, keep=False)
    assert len(sent) > 100
    assert sum(one.can_id == 0x7E for one in sent) > 10


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize(("precision", "has_gait"), [("double", True), ("single", True), ("single", False)])
def test_compilers_find_nothing_to_warn_of(
    compiler: str, precision: Precision, has_gait: bool, tmp_path: Path
) -> None:
    require_compiler(compiler)
    source = tmp_path / "vibro_firmware.c"
    source.write_text(emit(precision, has_gait).text())
    (tmp_path / "vibro_firmware.h").write_text(header.header(precision))
    promoted = ["-Wdouble-promotion"] if precision == "single" else []
    command = [compiler, *OPTIONS, *STRICT, *promoted, "-fsyntax-only", str(source)]
    subprocess.run(command, check=True)


def test_the_source_reads_as_written() -> None:
    whole, without = emit("double"), emit("double", False)
    assert {one.__name__ for one in without.functions} < {one.__name__ for one in whole.functions}
    assert not any("core.gait.gait" in one.__module__ for one in without.functions)
    lines = whole.text().splitlines()
    assert [line for line in lines if len(line) > WIDTH + 10] == []
    assert "/* Whether inverter or motor is outside its temperatures. */" in lines  # a docstring
    assert "    const vibro_power_input *power = &inputs->power;" in lines  # a name of Python's
    assert isinstance(whole, Emitter)


def test_the_command_writes_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = [
        "firmware",
        "c",
        "--out",
        str(tmp_path / "c"),
        "--precision",
        "single",
        "--without-gait",
        "--json",
    ]
    assert cli.run(command) == 0
    printed = json.loads(capsys.readouterr().out)
    names = sorted(path.name for path in (tmp_path / "c").iterdir())
    assert sorted(Path(one).name for one in printed["files"]) == names
    assert {"vibro_firmware.c", "vibro_firmware.h", "vibro_config.h", "README.md"} < set(names)
    assert printed["lines"] == len((tmp_path / "c" / "vibro_firmware.c").read_text().splitlines())
    assert printed["functions"] > 200
    assert cli.run([*command, "--set", "firmware.gait.follow=1"]) == 4
