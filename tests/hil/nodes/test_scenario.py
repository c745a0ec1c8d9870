"""Scenario files: what is taken, what is refused, and how it is said."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from firmware_py.shell.parameters import ParameterError
from hil.scenario.checks import Check, Requirement
from hil.scenario.commands import Command, Request
from hil.scenario.files import ScenarioError, read_scenario
from hil.scenario.scenario import check_scenario, load_scenario
from plant_sim.scene import SceneError
from text_input import TextInputError

MINIMAL = """
title = "Nothing moves"
scene = "table1-motor-soft"
[script]
duration_s = 2.0
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "nothing-moves.toml"
    path.write_text(text)
    return path


def kinds_of(base: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for kind in base.__subclasses__():
        yield kind
        yield from kinds_of(kind)


def test_every_key_that_a_user_writes_has_a_meaning_for_its_messages() -> None:
    """Without one a message about a number would ask for a table."""
    read = [kind for kind in kinds_of(BaseModel) if kind.__module__.startswith(("hil.", "plant_sim."))]
    read.remove(Requirement)  # which no user writes
    without = [
        f"{kind.__name__}.{name}"
        for kind in read
        for name, field in kind.model_fields.items()
        if not (field.description or is_table(field.annotation) or names_its_table(name))
    ]
    assert Check in read
    assert without == []


def is_table(annotation: Any) -> bool:
    """Whether a key's value is a table, or holds some."""
    is_model = isinstance(annotation, type) and issubclass(annotation, BaseModel)
    return is_model or any(map(is_table, get_args(annotation)))


def names_its_table(name: str) -> bool:
    """Whether a key chooses the table itself, by its law, model or kind."""
    return name in ("law", "model", "kind")


def test_default_scenario_is_the_soft_start() -> None:
    scenario = load_scenario("soft-start-multistable")
    assert scenario.commands == (Command(0.5, Request.RUN, 1.3), Command(28.0, Request.IDLE, 0.0))
    assert scenario.ticks == 33_000
    assert scenario.scene.drive.amplitude_m == 0.02


def test_scene_by_name_is_written_out_and_can_be_changed(tmp_path: Path) -> None:
    path = written(tmp_path, MINIMAL)
    scenario = load_scenario(
        path,
        ["scene.stop.restitution=0.4", "firmware.stop.restitution=0.6", "script.duration_s=3.5"],
    )
    assert scenario.name == "nothing-moves"
    assert scenario.document["scene"]["striker"]["mass_kg"] == 0.8
    assert scenario.scene.stop.restitution == 0.4  # type: ignore[union-attr]
    assert scenario.parameters == {"stop": {"restitution": 0.6}}
    assert scenario.duration_s == 3.5


def test_control_period_paces_the_run(tmp_path: Path) -> None:
    scenario = load_scenario(written(tmp_path, MINIMAL), ["firmware.control.tick_s=0.00025"])
    assert scenario.period_s == 0.00025
    assert scenario.ticks == 8000


RUN_COMMAND = '[[script.commands]]\nat_s = 1.0\nrequest = "run"\n'


@pytest.mark.parametrize(
    ("more", "settings", "said"),
    [
        ("[scirpt]\n", [], r"scirpt = .* is not a known key; did you mean script\?"),
        ("", ["script.duration_s=-1"], r"script.duration_s = -1.* is not a number greater than 0"),
        ("", ["script.duration_s=nan"], r"script.duration_s = nan is not a finite number"),
        (
            '[[checks]]\nname = "fault"\nlow = nan\n',
            [],
            r"checks.0.low = nan is .*; give the lowest permitted value",
        ),
        ("", ["script.durations=1"], r"script.durations = 1 is not a known key; did you mean duration_s\?"),
        (RUN_COMMAND, [], r"the command at 1.0 s asks for 'run' with no target_ratio; .* e.g. 1.3"),
        (RUN_COMMAND + "target_ratio = 9.0\n", [], r"target_ratio = 9.0 is not a number of at most 4"),
        (
            '[[script.commands]]\nat_s = 1.0\nrequest = "idle"\ntarget_impulse_n_s = 0.8\n',
            [],
            r"asks for 'idle' with target_impulse_n_s = 0.8; only 'run' takes one",
        ),
        (RUN_COMMAND + "target_ratio = 1.3\n", ["script.duration_s=0.5"], r"comes after the end"),
        (
            RUN_COMMAND.replace("run", "walk"),
            [],
            r"script.commands.0.request = 'walk' is not 'idle', 'run', [^;]* or 'silent'$",
        ),
        ('[[script.faults]]\nkind = "sensor-frozen"\n', [], r"did you mean frozen or sensor-stuck\?"),
        ('[[checks]]\nname = "regmie"\nequals = "impact"\n', [], r"did you mean regime"),
        ('[[checks]]\nname = "peak_force_n"\nhigh = 1.0\nunit = "kN"\n', [], r"the figure is in 'N'"),
        ("", ["duration=3"], r"is not KEY=VALUE with a dotted key"),
        ("", ["skript.duration_s=3"], r"starts with 'skript'; wanted one of"),
    ],
)
def test_bad_scenario_is_refused_with_key_value_and_remedy(
    tmp_path: Path, more: str, settings: list[str], said: str
) -> None:
    with pytest.raises(TextInputError, match=said):
        load_scenario(written(tmp_path, MINIMAL + more), settings)


def test_bad_plant_and_bad_parameters_are_refused_too(tmp_path: Path) -> None:
    path = written(tmp_path, MINIMAL)
    with pytest.raises(SceneError, match=r"striker.mass_kg = -1.*greater than 0"):
        load_scenario(path, ["scene.striker.mass_kg=-1.0"])
    with pytest.raises(ParameterError, match=r"no firmware parameter 'stop.restituton'; did you mean"):
        load_scenario(path, ["firmware.stop.restituton=0.5"])
    with pytest.raises(ParameterError, match=r"striker.mass_kg = nan"):
        load_scenario(path, [f"firmware.striker.mass_kg={math.nan}"])


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("soft-start-multistabel", r"no named scenario; did you mean soft-start-multistable\?"),
        ("zzz", r"no named scenario; `vibrohil list` shows all of them \(a file's path ends in .toml\)$"),
        (
            "nowhere/at-all.toml",
            r"cannot be read \(No such file or directory\); give a scenario's file, or the name",
        ),
    ],
)
def test_scenario_that_is_not_there_is_refused(source: str, said: str) -> None:
    with pytest.raises(TextInputError, match=said):
        load_scenario(source)


def test_file_that_is_no_toml_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TextInputError, match="is not valid TOML"):
        load_scenario(written(tmp_path, "title = "))


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        ('scene = "table1-viscous"', r"scene.drive.model = 'ideal' .*vibrohil simulate"),
        ('scene = "no-sensors.toml"', "scene has no sensors for the firmware to read; add the table"),
    ],
)
def test_a_scene_without_a_motor_or_sensors_is_refused(tmp_path: Path, scene: str, said: str) -> None:
    (tmp_path / "no-sensors.toml").write_text(
        "[striker]\nmass_kg = 0.8\nspring_n_m = 70\nrest_length_m = 0.12\n"
        '[drive]\nmodel = "motor"\namplitude_m = 0.02\n'
    )
    path = tmp_path / "mine.toml"
    text = scene.replace("no-sensors", str(tmp_path / "no-sensors"))
    path.write_text(
        f'title = "A scene that the firmware cannot run on"\n{text}\n[script]\nduration_s = 1.0\n'
    )
    with pytest.raises(TextInputError, match=said):
        load_scenario(path)


def test_a_bus_of_bits_that_are_no_whole_nanoseconds_is_refused() -> None:
    document = read_scenario("soft-start-multistable") | {"bus": {"bitrate": 174_017}}
    with pytest.raises(ScenarioError, match="bit rate 174017; wanted"):
        check_scenario(document, "odd")
