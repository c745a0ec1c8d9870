"""Parameter files: what is written is what a scenario loads; what is unsafe is not written by mistake."""

import json
import math
from pathlib import Path

import pytest

from firmware_py.shell.parameters import ParameterError
from hil.runs.job import silent
from hil.scenario.parameter_file import merge_files, read_document, read_parameters
from hil.scenario.scenario import load_scenario
from text_input import TextInputError
from tools import cli
from tools.output import EXIT_CHECK_FAILED, EXIT_PASSED
from tools.tuning import safety
from tools.tuning.result import Merit, Tuning, make_value
from tools.tuning.safety import SafetyResult, check_bounds, judge_safety, write

SAFE = [SafetyResult("bounds", 1, True, "")]


def tuning(**values: float) -> Tuning:
    return Tuning(
        command="speed",
        source="a test",
        seed=3,
        range_is="nothing",
        parameters={
            name.replace("__", "."): make_value(name.replace("__", "."), value, 0.5 * value, 2.0 * value)
            for name, value in values.items()
        },
        figures_of_merit={"margin": Merit(50.0, "deg")},
        warnings=("mind the gap",),
    )


def test_a_scenario_loads_what_was_written(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    write(path, tuning(speed__gain_p_n_m_s=0.04, stop__restitution=0.45), SAFE)
    assert read_parameters(path) == {"speed": {"gain_p_n_m_s": 0.04}, "stop": {"restitution": 0.45}}
    loaded = load_scenario("soft-start-multistable", ["firmware.stop.restitution=0.4"], [path])
    assert loaded.config.p.speed.gain_p_n_m_s == 0.04
    assert loaded.config.p.stop.restitution == 0.4  # --set goes over the file
    about = read_document(path)["tuning"]
    assert (about["seed"], about["source"], about["forced"]) == (3, "a test", False)
    assert about["warnings"] == ["mind the gap"]


def test_a_scenario_may_name_the_file_beside_it(tmp_path: Path) -> None:
    write(tmp_path / "mine.toml", tuning(speed__gain_p_n_m_s=0.04), SAFE)
    (tmp_path / "scenario.toml").write_text(
        'title = "it loads"\nscene = "table1-motor-soft"\nfirmware = "mine.toml"\n'
        "[script]\nduration_s = 1.0\n"
    )
    scenario = load_scenario(tmp_path / "scenario.toml")
    assert scenario.config.p.speed.gain_p_n_m_s == 0.04
    # What is written beside the run needs no file any more.
    assert scenario.document["firmware"] == {"speed": {"gain_p_n_m_s": 0.04}}


def test_the_last_file_is_on_top(tmp_path: Path) -> None:
    one, two = tmp_path / "one.toml", tmp_path / "two.toml"
    write(one, tuning(speed__gain_p_n_m_s=0.04, speed__gain_i_n_m=0.5), SAFE)
    write(two, tuning(speed__gain_p_n_m_s=0.03), SAFE)
    known = {"speed": {"gain_i_n_m": 0.1, "load_share": 0.5}}
    assert merge_files(known, [one, two]) == {
        "speed": {"gain_i_n_m": 0.5, "load_share": 0.5, "gain_p_n_m_s": 0.03}
    }
    assert known == {"speed": {"gain_i_n_m": 0.1, "load_share": 0.5}}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("format = 1", "format = 2", "has format 2, and this version of vibrohil reads 1"),
        ('unit = "N m s"', 'unit = "N m"', "given in 'N m'; wanted 'N m s'"),
        ("speed.gain_p_n_m_s", "speed.gain_x", "speed.gain_x"),
        ("value = 0.04", "value = 1e9", "speed.gain_p_n_m_s"),
        ("value = 0.04", "", "wants value and unit"),
        ("[parameters", "[parameters", ""),
    ],
)
def test_other_files_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "mine.toml"
    write(path, tuning(speed__gain_p_n_m_s=0.04), SAFE)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    if not message:
        assert read_parameters(path)
        return
    with pytest.raises(ParameterError, match=message):
        read_parameters(path)


def test_a_missing_or_broken_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TextInputError, match="cannot be read"):
        read_parameters(tmp_path / "nowhere.toml")
    (tmp_path / "broken.toml").write_text("= 1")
    with pytest.raises(TextInputError, match="not valid TOML"):
        read_parameters(tmp_path / "broken.toml")


def test_what_is_unsafe_needs_force_and_says_so(tmp_path: Path, monkeypatch, capsys) -> None:
    def failed(name: str, *_: object) -> SafetyResult:
        return SafetyResult(name, 1, False, "it rattles")

    monkeypatch.setattr("tools.tuning.safety.judge_scenario", failed)
    path = tmp_path / "mine.toml"
    command = ["tune", "speed", "--out", str(path)]
    assert cli.run([*command, "--json"]) == EXIT_CHECK_FAILED
    payload = json.loads(capsys.readouterr().out)
    assert (payload["out"], payload["safe"]) == (None, False)
    assert cli.run(command) == EXIT_CHECK_FAILED
    said = capsys.readouterr().out
    assert "it rattles" in said
    assert "not written; --force" in said
    assert not path.exists()
    assert cli.run([*command, "--force"]) == EXIT_PASSED
    assert "least load torque" in capsys.readouterr().out, "a name that is no common term is explained"
    document = read_document(path)
    assert document["tuning"]["forced"] is True
    assert document["tuning"]["safe"] is False
    assert document["safety"][1]["why"] == "it rattles"


def test_bounds_are_judged_before_anything_runs() -> None:
    assert check_bounds({"speed.gain_p_n_m_s": 0.05}).passed
    results = judge_safety({"speed.gain_p_n_m_s": 50.0}, silent)
    assert [result.scenario for result in results] == ["bounds"]
    assert not results[0].passed
    assert "speed.gain_p_n_m_s" in results[0].why


def test_the_safety_scenarios_distinguish_good_from_bad() -> None:
    """An impulse limit below that of the first impacts never lets the hold come about."""
    good = judge_safety({"speed.gain_p_n_m_s": 0.05}, silent)
    assert [result.scenario for result in good] == ["bounds", *safety.SCENARIOS]
    assert all(result.passed for result in good)
    bad = safety.judge_scenario("quick-start-below-the-band", {"limit.impulse_n_s": 0.2}, silent)
    assert not bad.passed
    assert "fault is impulse-limit" in bad.why


def test_the_twin_of_another_module_runs_at_its_own_ratio() -> None:
    for ratio, wanted in ((1.35, 1.35), (1.1, 1.1), (math.inf, 1.3)):
        assert safety.Bench({}, ratio=ratio).target_ratio(1.3) == wanted
    assert safety.Bench(ratio=1.35).target_ratio(1.3) == 1.3


def test_speed_is_written(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(safety, "SCENARIOS", ())
    monkeypatch.chdir(tmp_path)
    assert cli.run(["tune", "speed", "--json"]) == EXIT_PASSED
    payload = json.loads(capsys.readouterr().out)
    assert payload["parameters"]["speed.gain_p_n_m_s"]["unit"] == "N m s"
    assert {"value", "unit", "low", "high", "default"} == set(payload["parameters"]["speed.gain_i_n_m"])
    assert payload["figures_of_merit"]["phase_margin"]["value"] > 50.0
    assert payload["out"] == "speed.toml"
    slower = ["tune", "speed", "--bandwidth-hz", "15", "--out", "slower.toml"]
    assert cli.run(slower) == EXIT_PASSED
    assert "slower.toml" in capsys.readouterr().out
    # The slower loop needs less gain.
    gains = [read_parameters(Path(name))["speed"]["gain_p_n_m_s"] for name in ("speed.toml", "slower.toml")]
    assert gains[0] == 0.05
    assert gains[1] < 0.8 * gains[0]
