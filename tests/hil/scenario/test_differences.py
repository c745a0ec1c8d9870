"""Scenarios that say what differs: `like` and `append`, cases over a grid, sets of checks."""

import json
from pathlib import Path

import pytest

from hil.figures.records import CATALOGUE
from hil.scenario.checks import requirements
from hil.scenario.files import (
    ScenarioError,
    check_sets,
    read_file,
    read_scenario,
    scenario_names,
    shipped_scenarios,
)
from hil.scenario.scenario import load_scenario
from hil.suite.suite import scenarios_for
from text_input import parse_toml
from tools.cli import run
from tools.output import EXIT_BAD_INPUT

BASE = """
title = "The base"
scene = "table1-motor-soft"
checks = [{ name = "impact_count", low = 5, high = 50 }, { name = "regime", equals = "impact" }]

[firmware.start]
rise_s = 1.0

[script]
duration_s = 4.0

[[script.commands]]
at_s = 0.5
request = "run"
target_ratio = 1.1
"""


@pytest.fixture
def base(tmp_path: Path) -> Path:
    """A scenario for others to be like, in a folder of its own."""
    path = tmp_path / "base.toml"
    path.write_text(BASE)
    return path


def beside(base: Path, text: str, name: str = "mine.toml") -> Path:
    """A scenario in the folder of the base."""
    path = base.with_name(name)
    path.write_text(text)
    return path


def test_a_scenario_like_another_states_the_differences_alone(base: Path) -> None:
    mine = beside(
        base,
        'title = "Mine"\nlike = "base.toml"\nscene.striker.mass_kg = 0.9\nfirmware.stop.restitution = 0.4\n'
        "script.commands = []\n",
    )
    whole, other = read_scenario(mine), read_scenario(base)
    assert whole["title"] == "Mine"
    assert whole["scene"] == {**other["scene"], "striker": {**other["scene"]["striker"], "mass_kg": 0.9}}
    assert whole["firmware"] == {"start": {"rise_s": 1.0}, "stop": {"restitution": 0.4}}
    assert whole["script"] == {"duration_s": 4.0, "commands": []}
    assert whole["checks"] == other["checks"]
    assert whole.keys() == other.keys()


def test_a_part_of_another_law_replaces_the_part(base: Path) -> None:
    mine = beside(
        base,
        'title = "Mine"\nlike = "base.toml"\n'
        '[scene.stop]\nlaw = "rigid"\nposition_m = 0.18\nrestitution = 0.5\n',
    )
    assert read_scenario(mine)["scene"]["stop"] == {"law": "rigid", "position_m": 0.18, "restitution": 0.5}


def test_a_named_scene_replaces_the_whole_scene(base: Path) -> None:
    mine = beside(base, 'title = "Mine"\nlike = "base.toml"\nscene = "table1-dq-motor"\n')
    changed = beside(base, 'title = "Base"\nscene = "table1-dq-motor"\nscript.duration_s = 1.0\n', "dq.toml")
    assert read_scenario(mine)["scene"] == read_scenario(changed)["scene"]


def test_lists_are_replaced_unless_append_names_them(base: Path) -> None:
    mine = beside(
        base,
        'title = "Mine"\nlike = "base.toml"\nappend = ["script.commands", "checks"]\n'
        'checks = [{ name = "impact_count", low = 7 }, { name = "regime", low = 1 }, '
        '{ name = "fault", equals = "none" }]\n'
        '[[script.commands]]\nat_s = 3.0\nrequest = "idle"\n',
    )
    whole = read_scenario(mine)
    assert [command["request"] for command in whole["script"]["commands"]] == ["run", "idle"]
    assert whole["checks"] == [
        {"name": "impact_count", "low": 7, "high": 50},
        {"name": "regime", "low": 1},
        {"name": "fault", "equals": "none"},
    ]


def test_a_scenario_changes_single_limits_of_a_set(base: Path) -> None:
    mine = beside(
        base,
        'title = "Mine"\nlike = "base.toml"\n'
        'checks = ["keeps-the-impacts", { name = "impact_v_m_s", low = 0.4 }, '
        '{ name = "regime", equals = "lost" }]\n',
    )
    own = {check["name"]: check for check in read_scenario(mine)["checks"]}
    in_set = {check["name"]: check for check in check_sets()["keeps-the-impacts"]["checks"]}
    assert own == {
        **in_set,
        "impact_v_m_s": {**in_set["impact_v_m_s"], "low": 0.4},
        "regime": {**in_set["regime"], "equals": "lost"},
    }


def test_two_checks_of_one_figure_in_one_file_are_two_checks(base: Path) -> None:
    rows = '{ name = "impact_count", low = 5 }, { name = "impact_count", high = 50 }'
    mine = beside(base, f'title = "Mine"\nlike = "base.toml"\nchecks = ["held-speed", {rows}]\n')
    assert read_scenario(mine)["checks"][-2:] == parse_toml(f"checks = [{rows}]")["checks"]


GRID = """
title = "A grid"
like = "base.toml"

[[vary]]
scene.striker.spring_n_m = [66.5, 73.5]
scene.striker.mass_kg = [0.7, 0.9]

[[vary]]
script.commands.0.target_ratio = [1.1, 1.2, 1.3]
"""


def test_tables_vary_give_all_combinations_with_names(base: Path) -> None:
    mine = beside(base, GRID)
    found, _ = scenarios_for([str(mine)], "lockstep")
    assert [one.name for one in found] == [
        f"mine-spring_n_m-{spring}-target_ratio-{ratio}"
        for spring in (66.5, 73.5)
        for ratio in (1.1, 1.2, 1.3)
    ]
    assert [(one.scene.striker.mass_kg, one.commands[0].target_ratio) for one in found] == [
        (mass, ratio) for mass in (0.7, 0.9) for ratio in (1.1, 1.2, 1.3)
    ]
    one = load_scenario(f"{mine}::mine-spring_n_m-73.5-target_ratio-1.2", ["script.duration_s=2"])
    assert (one.scene.striker.mass_kg, one.duration_s) == (0.9, 2)
    assert "vary" not in one.document
    assert "like" not in one.document


def test_cases_have_the_names_and_scenes_that_the_file_gives(base: Path) -> None:
    mine = beside(
        base,
        'like = "base.toml"\n[[vary]]\nname = ["plain", "d-q"]\ntitle = ["One", "Two"]\n'
        'scene = ["table1-motor-soft", "table1-dq-motor"]\n',
    )
    found, _ = scenarios_for([str(mine)], "lockstep")
    assert [(one.name, one.title, one.scene.drive.model) for one in found] == [
        ("plain", "One", "motor"),
        ("d-q", "Two", "dq-motor"),
    ]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("like = 3", "like = 3 is not a text; give another scenario"),
        (
            'like = "a-silent-encodr-stops-the-motor"',
            "no named scenario; did you mean a-silent-encoder-stops",
        ),
        ('like = "nowhere.toml"', "nowhere.toml' cannot be read"),
        ('like = "like.toml"', "like.toml': like = 'base.toml': a scenario that another file is like cannot"),
        ('append = ["checks"]', "append continues the lists of `like`, which is missing; add it"),
        ('append = "checks"', "append = 'checks' is not a list; give dotted keys of lists"),
        ('like = "base.toml"\nappend = ["checks"]', "append names 'checks', which is no list of this file"),
        (
            'like = "base.toml"\nappend = ["script"]\n[script]\nduration_s = 1',
            "'script', which is no list of",
        ),
        ('like = "base.toml"\nappend = ["a..b"]', "'a..b' is no dotted key"),
        ('checks = ["stops-the-motr"]', "'stops-the-motr' is no set of checks; did you mean stops-the-motor"),
        ("vary = 1", "vary = 1 is not a list; give the tables"),
        ("vary = [1]", "vary.0 = 1 is not a table"),
        ("[[vary]]", "vary.0 is empty; give keys of the scenario"),
        ("[[vary]]\nseed = 3", "vary.0.seed = 3; give a list with a value for each case"),
        ("[[vary]]\nseed = []", r"vary.0.seed = \[\]; give a list"),
        ("[[vary]]\nseed = [1, 2]\nscript.duration_s = [1.0]", "vary.0.script.duration_s has 1 values, and"),
        ("[[vary]]\nseed = [1]\n[[vary]]\nseed = [2]", "two tables .* give 'seed'"),
        ("[[vary]]\nseed = [1, 1]", "two cases have the name 'mine-seed-1'"),
        ('[[vary]]\nname = ["../out"]', "a case has the name '../out'; wanted letters"),
        ("[[vary]]\nname = [3]", "a case has the name 3; wanted letters"),
        ('[[vary]]\nlike = ["base.toml"]', "vary.0.like: like, append, vary and search hold for all cases"),
        ('[[vary]]\n"a..b" = [1]', "'a..b' is no dotted key"),
        ("[[vary]]\nscript.faults.0.at_s = [1.0]", "vary: script.faults.0: the list has 0 entries"),
        ("[[vary]]\ntitle.x = [1.0]", "vary: title is a value, not a table"),
        ("[[vary]]\nseed = [" + "1," * 2000 + "]", "make 2000 cases; wanted at most 1000"),
        (
            f"[[vary]]\nseed = [{'1,' * 1000}]\n[[vary]]\n" + "".join(f"k{n} = [1]\n" for n in range(100)),
            "make 1000 cases with 101000 values; wanted at most 100000",
        ),
        ('[[vary]]\nscene = ["table1"]', "'table1' is no named scene"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_file_key_and_remedy(base: Path, text: str, said: str) -> None:
    beside(base, 'title = "Base"\nlike = "base.toml"\n', "like.toml")
    head = 'title = "Mine"\n' + (
        "" if "like =" in text.partition("[")[0] else 'scene = "table1-motor-soft"\n'
    )
    script = "" if "[script]" in text else "script = { duration_s = 1.0, faults = [] }\n"
    mine = beside(base, head + script + text)
    with pytest.raises(ScenarioError, match=rf"scenario file '.*mine.toml': .*{said}"):
        scenarios_for([str(mine)], "lockstep")


def test_a_file_of_several_cases_wants_one_of_them(base: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = beside(base, GRID)
    with pytest.raises(
        ScenarioError, match=r"it has 6 cases; name one of them, such as .*mine.toml::mine-spring"
    ):
        load_scenario(mine)
    with pytest.raises(ScenarioError, match=r"it has no case 'mine-sprong'; known|did you mean"):
        load_scenario(f"{mine}::mine-sprong")
    assert run(["run", f"{base}::x"]) == EXIT_BAD_INPUT
    assert "it has no [[vary]]; name the file alone" in " ".join(capsys.readouterr().err.split())


def test_shipped_cases_have_names_and_the_list_shows_them_complete(
    capsys: pytest.CaptureFixture[str],
) -> None:
    names = scenario_names()
    path, case = shipped_scenarios()["a-sagging-supply-stops-the-motor"]
    assert len(names) == len(set(names)) == len(shipped_scenarios())
    assert {path for path, _ in shipped_scenarios().values()} == set(path.parents[1].rglob("*.toml"))
    assert case == "a-sagging-supply-stops-the-motor"
    assert len(read_file(path)["vary"]) == 1
    assert run(["list", "--show", case]) == 0
    assert parse_toml(capsys.readouterr().out) == read_scenario(case)
    assert run(["list", "--show", case, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["tables"] == read_scenario(case)


def test_sets_of_checks_name_figures_and_requirements() -> None:
    for name, one in check_sets().items():
        assert one["title"], name
        for check in one["checks"]:
            assert check["name"] in CATALOGUE
            assert check["requirement"] in requirements()
            assert check.get("unit", CATALOGUE[check["name"]].unit) == CATALOGUE[check["name"]].unit
