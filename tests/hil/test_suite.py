"""A suite: which scenarios run, what it leaves behind, and what one that breaks off does to it."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from hil import suite
from hil.scenario import load_scenario, scenario_names
from hil.suite import judged, run_suite, scenarios_for
from tools.cli import run
from tools.output import EXIT_BAD_INPUT, EXIT_NOTHING_RAN

MODELLED = "a-bus-off-of-ten-ticks-is-ridden-through"


def silent(_: float, __: str) -> None:
    """Nobody looks at the progress."""


def short(folder: Path, name: str, peak: float) -> str:
    path = folder / f"{name}.toml"
    path.write_text(
        f'title = "It rests"\nscene = "table1-motor-soft"\n[script]\nduration_s = 0.3\n'
        f'[[checks]]\nname = "impact_count"\nlow = {peak}\n'
    )
    return str(path)


def test_all_scenarios_load_and_are_named_as_their_files() -> None:
    scenarios, left_out = scenarios_for([], "lockstep")
    assert [one.name for one in scenarios] == scenario_names()
    assert len(scenarios) >= 40
    assert left_out == []
    assert all(one.checks for one in scenarios)


def test_a_modelled_bus_is_left_out_in_real_time(capsys: pytest.CaptureFixture[str]) -> None:
    scenarios, left_out = scenarios_for([MODELLED, "operator-lost"], "real")
    assert ([one.name for one in scenarios], left_out) == (["operator-lost"], [MODELLED])
    assert run(["suite", MODELLED, "--clock", "real", "--json"]) == EXIT_NOTHING_RAN
    assert json.loads(capsys.readouterr().out)["passed"] is False
    assert run(["suite", "no-such-scenario", "--json"]) == EXIT_BAD_INPUT


def test_a_suite_leaves_one_page_one_xml_and_a_folder_a_run(tmp_path: Path) -> None:
    names = [short(tmp_path, "rests", 0.0), short(tmp_path, "strikes", 1.0)]
    result = run_suite(names, "lockstep", "auto", tmp_path / "out", 1, silent)
    assert [(one["name"], one["passed"]) for one in result["scenarios"]] == [
        ("rests", True),
        ("strikes", False),
    ]
    assert result["passed"] is False
    assert result["scenarios"][1]["failed"][0]["value"] == 0
    xml = ElementTree.parse(result["junit"]).getroot()
    assert [(one.get("name"), one.get("failures")) for one in xml] == [("rests", "0"), ("strikes", "1")]
    assert "1 of 2 scenarios passed" in Path(result["report"]).read_text()
    assert (tmp_path / "out" / "rests" / "run.rrd").exists()


def test_a_run_that_breaks_off_has_failed_and_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(*_: object) -> None:
        raise RuntimeError("no step is small enough")

    monkeypatch.setattr(suite, "run_scenario", breaks)
    verdict = judged(load_scenario("operator-lost"), "lockstep", "auto", tmp_path / "run", 1)
    assert verdict["passed"] is False
    assert verdict["reasons"][0] == "broke off: RuntimeError: no step is small enough"
