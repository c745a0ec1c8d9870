"""Scenes, scenarios, parameter files and --set: whatever stands in them, a sentence and exit status 4."""

import os
import resource
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from options import options_of

from hil.runs import recorded_run
from tools import cli
from tools.output import EXIT_BAD_INPUT

SCENE = """
[striker]
mass_kg = 0.8
spring_n_m = 70.0
rest_length_m = 0.12
[drive]
model = "ideal"
amplitude_m = 0.02
ratio = 1.3
"""
READERS = {
    "scene": ["simulate", "{}", "--until", "0.1"],
    "scenario": ["run", "{}", "--clock", "lockstep"],
    "parameters": ["run", "soft-start-multistable", "--clock", "lockstep", "--parameters", "{}"],
}


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What the program says; it must refuse, soon, and in little memory."""
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    started_s = time.process_time()
    assert cli.run(arguments) == EXIT_BAD_INPUT
    assert time.process_time() - started_s < 10.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 500_000
    said = capsys.readouterr().err
    assert len(said) < 5000
    return " ".join(said.split())


def of_file(reader: str, path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    return refused([one.format(path) for one in READERS[reader]], capsys)


every_reader = pytest.mark.parametrize("reader", READERS)
OTHER_READERS = {
    "odd.log": ["import {}", "tune identify {}"],
    "odd.rrd": ["inspect {}", "compare {} {}", "export {} --to csv", "view {}"],
    "odd.toml": ["suite {}", "plant {} --until 0.1 --bus local"],
}
EVERY_READER = [("odd.toml", " ".join(command)) for command in READERS.values()]
EVERY_READER += [(name, command) for name, commands in OTHER_READERS.items() for command in commands]
"""Commands that read a file, with a name that a good file has."""
SPECIAL: dict[str, Callable[[Path], object]] = {
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "folder": Path.mkdir,
    "loop": lambda path: path.symlink_to(path),
    "holes": lambda path: path.touch() or os.truncate(path, 200 << 20),
}


@pytest.mark.parametrize(("name", "command"), EVERY_READER)
@pytest.mark.parametrize("kind", SPECIAL)
def test_what_is_no_regular_file_is_refused(
    name: str,
    command: str,
    kind: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    SPECIAL[kind](tmp_path / name)
    said = refused(command.replace("{}", str(tmp_path / name)).split(), capsys)
    assert name in said


@pytest.mark.parametrize("kind", SPECIAL)
def test_no_pipe_or_device_of_another_user_is_copied(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Another user's damaged log is repaired in a copy, and a copy of /dev/zero would fill the disk."""
    SPECIAL[kind](tmp_path / "odd.rrd")
    monkeypatch.setattr(recorded_run, "is_foreign", lambda _: True)
    copies: list[Path] = []
    monkeypatch.setattr(
        recorded_run, "temporary_folder", lambda: copies.append(tmp_path / "copies") or copies[0]
    )
    (tmp_path / "copies").mkdir()
    assert "odd.rrd" in refused(["inspect", str(tmp_path / "odd.rrd")], capsys)
    assert bool(copies) == (kind == "holes")


WRONG_TEXTS = {
    "too long": (b"# " + b"x" * 2_000_000, "bytes"),
    "no text": (b"\xff\xfe\x00", "UTF-8"),
    "no TOML": (b"[striker\n", "TOML"),
    "deep arrays": (b"a = " + b"[" * 100_000, "nested"),
    "deep tables": (b"a = " + b"{b = " * 50_000, "nested"),
    "long dotted key": (b"a" + b".a" * 100_000 + b" = 1", "nested"),
    "long dotted header": (b"[a" + b".a" * 100_000 + b"]", "nested"),
    "large integer": (b"a = 1" + b"0" * 400, "64 bits"),
    "larger integer": (b"a = 1" + b"0" * 5000, "64 bits"),
    "large hexadecimal integer": (b"a = 0x1" + b"0" * 5000, "64 bits"),
    "nothing": (b"", ""),
    "no tables": (b"a = 1\n" * 1, ""),
    "one long word": (b"a = " + b"x" * 1_000_000, "TOML"),
    "quotes that are escaped": (b'a = "' + b'\\"' * 500_000, "TOML"),
    "quotes that open": (b'"""\n' * 250_000, "TOML"),
    "many wrong keys": (b"".join(b"k%d = 1\n" % number for number in range(50_000)), ""),
}


@every_reader
@pytest.mark.parametrize("what", WRONG_TEXTS)
def test_a_text_that_is_none_of_the_format_is_refused(
    reader: str, what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content, said = WRONG_TEXTS[what]
    path = tmp_path / "odd.toml"
    path.write_bytes(content)
    assert said in of_file(reader, path, capsys)


def test_brackets_and_dots_in_texts_and_comments_do_not_count(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "scenario.toml"
    odd = "[" * 50 + "." * 50
    path.write_text(f'title = "{odd}"\n# {odd}\nscene = 1\n')
    said = of_file("scenario", path, capsys)
    assert "nested" not in said
    assert "script is missing" in said


SETTINGS = [
    "scene.striker.mass_kg=" + "9" * 400,
    "scene.striker.mass_kg=" + "9" * 5000,
    "scene.striker.mass_kg=0x" + "f" * 5000,
    "scene.striker.mass_kg=nan",
    "scene.striker.mass_kg=1e400",
    "scene.striker.mass_kg=" + "[" * 50_000,
    "scene.striker.mass_kg=" + "x" * 100_000,
    "scene.striker.mass_kg=2026-01-01",
    "scene.striker.mass_kg=\udcff",
    "scene.striker.mass_kg=true",
    "scene" + ".a" * 50_000 + "=1",
    "scene.striker=1",
    "=",
    "scene.=1",
]


@pytest.mark.parametrize("setting", SETTINGS, ids=range(len(SETTINGS)))
@pytest.mark.parametrize("command", ["simulate", "run"])
def test_a_setting_that_makes_no_sense_is_refused(
    command: str, setting: str, capsys: pytest.CaptureFixture[str]
) -> None:
    what = ["simulate", "table1-viscous", "--until", "0.1"]
    if command == "run":
        what = ["run", "soft-start-multistable", "--clock", "lockstep"]
    refused([*what, "--set", setting], capsys)


@pytest.mark.parametrize("arguments", [["run", "soft-start-multistable", "--out"], ["inspect"], ["simulate"]])
def test_a_path_that_is_not_utf_8_is_refused(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "\udcff"
    assert "is not valid UTF-8" in refused([*arguments, str(path)], capsys)
    assert not path.exists()


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
@pytest.mark.parametrize(("command", "option"), options_of("float"))
def test_a_number_that_is_not_finite_is_refused(
    command: str, option: str, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if command == "simulate":
        command = "simulate table1-viscous"
    assert option in refused([*command.split(), option, value], capsys)


def test_every_number_of_an_option_is_tried() -> None:
    some = {("simulate", "--until"), ("plant", "--until"), ("tune speed", "--tracker-rad-s")}
    assert some < set(options_of("float"))
