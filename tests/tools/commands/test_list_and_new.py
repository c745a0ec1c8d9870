"""Names by group and text, and a scenario to begin with."""

import json
import re
import shlex
import tomllib
from pathlib import Path

import pytest

from tools import cli
from tools.output import EXIT_BAD_INPUT, EXIT_PASSED, console


def listed(capsys, *arguments):
    assert cli.run(["list", *arguments, "--json"]) == EXIT_PASSED
    (names,) = json.loads(capsys.readouterr().out).values()
    return {one["name"]: one for one in names}


def test_every_name_has_its_group_its_value_and_its_title(capsys):
    run = listed(capsys)["soft-start-multistable"]
    assert (run["group"], run["value"]) == ("ordinary", "33 s")
    assert run["title"].startswith("A soft start from rest")
    scene = listed(capsys, "scenes")["table1-motor-soft"]
    assert (scene["group"], scene["value"]) == ("motor", "hunt-crossley")
    rise = listed(capsys, "parameters")["start.rise_s"]
    assert (rise["group"], rise["value"]) == ("start", "4 s")
    assert rise["title"].startswith("duration of the second S-curve")
    stuck = listed(capsys, "faults")["sensor-stuck"]
    assert (stuck["group"], stuck["value"]) == ("sensors", "sensor")
    assert stuck["title"].startswith("A sensor")


def test_messages_name_only_kinds_that_the_command_lists(capsys):
    root = Path(cli.__file__).parents[1]
    texts = [path.read_text() for folder in ("hil", "tools") for path in (root / folder).rglob("*.py")]
    named = {kind for text in texts for kind in re.findall(r"`vibrohil list ([a-z][a-z-]*)`", text)}
    assert named
    for kind in named:
        assert listed(capsys, kind)


def test_a_group_and_a_text_choose_from_the_names(capsys):
    every, sensors = listed(capsys), listed(capsys, "--group", "sensors")
    assert sensors == {name: one for name, one in every.items() if one["group"] == "sensors"}
    both = listed(capsys, "--group", "sensors", "--find", "ENCODER")
    assert both
    assert both == {
        name: one for name, one in sensors.items() if "encoder" in f"{name} {one['title']}".lower()
    }
    assert len(both) < len(sensors) < len(every)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("freeze", "a-stuck-encoder-stops-the-motor"),
        ("Frozen", "a-stuck-accelerometer-stops-the-motor"),
        ("reboot", "a-killed-controller-leaves-no-torque"),
        ("emergency", "e-stop-in-the-hold"),
    ],
)
def test_a_name_is_found_by_a_synonym(capsys, text, name):
    assert name in listed(capsys, "--find", text)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--group", "fault"], "the groups are"),
        (["--group", "faults"], "these are a kind of names: vibrohil list faults"),
        (["--find", "no such text"], "contains it"),
    ],
)
def test_nothing_found_is_said(arguments, message, capsys):
    assert cli.run(["list", *arguments]) == EXIT_BAD_INPUT
    assert message in " ".join(capsys.readouterr().err.split())


def test_the_table_fits_into_a_hundred_characters(monkeypatch, capsys):
    monkeypatch.setattr(console, "_width", 100)
    for what in ("scenarios", "scenes", "faults", "parameters"):
        assert cli.run(["list", what]) == EXIT_PASSED
        assert max(map(len, capsys.readouterr().out.splitlines())) <= 100


def test_a_new_scenario_passes_as_it_stands_and_is_written_over_no_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.run(["new", "mine", "--json"]) == EXIT_PASSED
    written = json.loads(capsys.readouterr().out)
    assert written["scenario"] == "mine.toml"
    assert cli.run([*written["run"].split()[1:], "--json"]) == EXIT_PASSED
    assert all(check["passed"] for check in json.loads(capsys.readouterr().out)["checks"])
    (tmp_path / "mine.toml").write_text("mine")
    assert cli.run(["new", "mine"]) == EXIT_BAD_INPUT
    assert (tmp_path / "mine.toml").read_text() == "mine"


def test_the_command_for_a_new_scenario_can_be_pasted(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    name = """it's a "b c" """.strip()
    assert cli.run(["new", name]) == EXIT_PASSED
    command = capsys.readouterr().out.splitlines()[-1]
    assert shlex.split(command) == ["vibrohil", "run", f"{name}.toml", "--clock", "lockstep"]


def test_what_is_commented_out_in_a_new_scenario_is_valid_too(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.run(["new", "faulty.toml"]) == EXIT_PASSED
    text = (tmp_path / "faulty.toml").read_text()
    before, fault, after = text.partition("# [[script.faults]]")
    lines = [line.removeprefix("# ") for line in (fault + after).split("\n\n", 1)[0].splitlines()]
    (tmp_path / "faulty.toml").write_text("\n".join([before, *lines, "", after.split("\n\n", 1)[1]]))
    assert tomllib.loads((tmp_path / "faulty.toml").read_text())["script"]["faults"]
    assert cli.run(["run", "faulty.toml", "--clock", "lockstep"]) == EXIT_PASSED


@pytest.mark.parametrize("name", ["", ".toml", "a/b", "../up", "..", ".", "...toml"])
def test_a_name_is_no_path(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.run(["new", name]) == EXIT_BAD_INPUT
    assert "no file's name" in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []
