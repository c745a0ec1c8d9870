"""Parameter files: what is written is what a scenario loads; what is unsafe is not written by mistake."""

import json
from pathlib import Path

import pytest

from firmware_py.shell.parameters import ParameterError
from hil.scenario.parameter_file import merged, read_document, read_parameters
from hil.scenario.scenario import load_scenario
from plant_sim.text_input import TextInputError
from tools import cli
from tools.commands.design.tune_tables import show_difference
from tools.output import EXIT_BAD_INPUT, EXIT_CHECK_FAILED, EXIT_PASSED
from tools.tuning import safety
from tools.tuning.difference import difference
from tools.tuning.parameter_file import UnsafeError, write
from tools.tuning.result import Merit, Tuning, tuned
from tools.tuning.safety import SafetyResult, judge_safety, within_bounds

SAFE = [SafetyResult("bounds", 1, True, "")]
UNSAFE = [SafetyResult("bounds", 1, True, ""), SafetyResult("e-stop-in-the-hold", 1, False, "too late")]


def tuning(**values: float) -> Tuning:
    return Tuning(
        command="speed",
        source="a test",
        seed=3,
        range_is="nothing",
        parameters={
            name.replace("__", "."): tuned(name.replace("__", "."), value, 0.5 * value, 2.0 * value)
            for name, value in values.items()
        },
        figures_of_merit={"margin": Merit(50.0, "deg")},
        warnings=("mind the gap",),
    )


def silent(_: float, __: str) -> None:
    """No progress."""


def test_a_scenario_loads_what_was_written(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    write(path, tuning(speed__gain_p_n_m_s=0.04, stop__restitution=0.45), SAFE, force=False)
    assert read_parameters(path) == {"speed": {"gain_p_n_m_s": 0.04}, "stop": {"restitution": 0.45}}
    loaded = load_scenario("soft-start-multistable", ["firmware.stop.restitution=0.4"], [path])
    assert loaded.config.speed.gain_p_n_m_s == 0.04
    assert loaded.config.detector.restitution == 0.4  # --set goes over the file
    about = read_document(path)["tuning"]
    assert (about["seed"], about["source"], about["forced"]) == (3, "a test", False)
    assert about["warnings"] == ["mind the gap"]


def test_a_scenario_may_name_the_file_beside_it(tmp_path: Path) -> None:
    write(tmp_path / "mine.toml", tuning(speed__gain_p_n_m_s=0.04), SAFE, force=False)
    (tmp_path / "scenario.toml").write_text(
        'title = "it loads"\nscene = "table1-motor-soft"\nfirmware = "mine.toml"\n'
        "[script]\nduration_s = 1.0\n"
    )
    scenario = load_scenario(tmp_path / "scenario.toml")
    assert scenario.config.speed.gain_p_n_m_s == 0.04
    # What is written beside the run needs no file any more.
    assert scenario.document["firmware"] == {"speed": {"gain_p_n_m_s": 0.04}}


def test_the_last_file_is_on_top(tmp_path: Path) -> None:
    one, two = tmp_path / "one.toml", tmp_path / "two.toml"
    write(one, tuning(speed__gain_p_n_m_s=0.04, speed__gain_i_n_m=0.5), SAFE, force=False)
    write(two, tuning(speed__gain_p_n_m_s=0.03), SAFE, force=False)
    known = {"speed": {"gain_i_n_m": 0.1, "load_share": 0.5}}
    assert merged(known, [one, two]) == {
        "speed": {"gain_i_n_m": 0.5, "load_share": 0.5, "gain_p_n_m_s": 0.03}
    }
    assert known == {"speed": {"gain_i_n_m": 0.1, "load_share": 0.5}}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("format = 1", "format = 2", "format = 2, wanted 1"),
        ('unit = "N m s"', 'unit = "N m"', "given in 'N m'; wanted 'N m s'"),
        ("speed.gain_p_n_m_s", "speed.gain_x", "speed.gain_x"),
        ("value = 0.04", "value = 1e9", "speed.gain_p_n_m_s"),
        ("value = 0.04", "", "wants value and unit"),
        ("[parameters", "[parameters", ""),
    ],
)
def test_other_files_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "mine.toml"
    write(path, tuning(speed__gain_p_n_m_s=0.04), SAFE, force=False)
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


def test_what_is_unsafe_needs_force_and_says_so(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    with pytest.raises(UnsafeError, match="e-stop-in-the-hold: too late"):
        write(path, tuning(speed__gain_p_n_m_s=0.04), UNSAFE, force=False)
    assert not path.exists()
    write(path, tuning(speed__gain_p_n_m_s=0.04), UNSAFE, force=True)
    document = read_document(path)
    assert document["tuning"]["forced"] is True
    assert document["tuning"]["safe"] is False
    assert document["safety"][1]["why"] == "too late"


def test_force_without_need_leaves_no_stain(tmp_path: Path) -> None:
    write(tmp_path / "mine.toml", tuning(speed__gain_p_n_m_s=0.04), SAFE, force=True)
    assert read_document(tmp_path / "mine.toml")["tuning"]["forced"] is False


def test_bounds_are_judged_before_anything_runs() -> None:
    assert within_bounds({"speed.gain_p_n_m_s": 0.05}).passed
    results = judge_safety({"speed.gain_p_n_m_s": 50.0}, silent)
    assert [result.scenario for result in results] == ["bounds"]
    assert not results[0].passed
    assert "speed.gain_p_n_m_s" in results[0].why


def test_the_safety_scenarios_distinguish_good_from_bad() -> None:
    """An impulse limit below that of the first impacts never lets the hold come about."""
    good = judge_safety({"speed.gain_p_n_m_s": 0.05}, silent)
    assert [result.scenario for result in good] == ["bounds", *safety.SCENARIOS]
    assert all(result.passed for result in good)
    bad = safety.judged("quick-start-below-the-band", {"limit.impulse_n_s": 0.2}, silent)
    assert not bad.passed
    assert "fault = impulse-limit" in bad.why


def test_speed_is_written_and_compared(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(safety, "SCENARIOS", ())
    monkeypatch.chdir(tmp_path)
    assert cli.run(["tune", "speed", "--no-measure", "--json"]) == EXIT_PASSED
    payload = json.loads(capsys.readouterr().out)
    assert payload["parameters"]["speed.gain_p_n_m_s"]["unit"] == "N m s"
    assert {"value", "unit", "low", "high"} == set(payload["parameters"]["speed.gain_i_n_m"])
    assert payload["figures_of_merit"]["phase_margin"]["value"] > 50.0
    assert payload["out"] == "speed.toml"
    slower = ["tune", "speed", "--no-measure", "--bandwidth-hz", "15", "--out", "slower.toml"]
    assert cli.run(slower) == EXIT_PASSED
    assert "written" in capsys.readouterr().out
    assert cli.run(["tune", "diff", "speed.toml", "slower.toml", "--no-suite", "--json"]) == EXIT_PASSED
    changes = json.loads(capsys.readouterr().out)
    assert [change["name"] for change in changes["changed"]] == ["speed.gain_i_n_m", "speed.gain_p_n_m_s"]
    # The slower loop needs less gain; its spare phase goes into the integral.
    assert changes["changed"][1]["relative"] < -0.2
    assert changes["changed"][1]["a"] == 0.05
    assert changes["same"] == ["crank.bandwidth_rad_s"]
    assert changes["suite"] == []
    assert cli.run(["tune", "diff", "speed.toml", "slower.toml", "--no-suite"]) == EXIT_PASSED
    assert "speed.gain_p_n_m_s" in capsys.readouterr().out
    assert cli.run(["tune", "diff", "speed.toml", "nowhere.toml"]) == EXIT_BAD_INPUT


def test_a_failed_scenario_is_a_failed_check(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(
        "tools.tuning.safety.judged", lambda name, *_: SafetyResult(name, 1, False, "it rattles")
    )
    out = tmp_path / "speed.toml"
    command = ["tune", "speed", "--no-measure", "--json", "--out", str(out)]
    assert cli.run(command) == EXIT_CHECK_FAILED
    payload = json.loads(capsys.readouterr().out)
    assert payload["out"] is None
    assert not payload["safe"]
    assert not out.exists()
    assert cli.run([*command, "--force"]) == EXIT_PASSED
    assert read_document(out)["tuning"]["forced"] is True


def test_a_parameter_that_one_file_lacks_has_its_default(tmp_path: Path) -> None:
    one, two = tmp_path / "one.toml", tmp_path / "two.toml"
    write(one, tuning(speed__gain_p_n_m_s=0.04), SAFE, force=False)
    write(two, tuning(stop__restitution=0.5), SAFE, force=False)
    found = difference(one, two)
    assert [(c["name"], c["a"], c["b"], c["named_in_b"]) for c in found["changed"]] == [
        ("speed.gain_p_n_m_s", 0.04, 0.05, False)
    ]
    assert found["same"] == ["stop.restitution"]  # 0.5 is its default
    assert not found["equal"]


def test_a_difference_says_what_it_does_on_the_suite(tmp_path: Path, monkeypatch, capsys) -> None:
    """An impulse limit below that of the impacts: what passed before does not any more, and diff says so."""
    monkeypatch.chdir(tmp_path)
    write(Path("mine.toml"), tuning(limit__impulse_n_s=1.6), SAFE, force=False)
    write(Path("low.toml"), tuning(limit__impulse_n_s=0.2), SAFE, force=False)
    command = ["tune", "diff", "mine.toml", "low.toml", "--scenario", "quick-start-below-the-band"]
    assert cli.run([*command, "--json"]) == EXIT_CHECK_FAILED
    (found,) = json.loads(capsys.readouterr().out)["suite"]
    assert found["passed"] == {"a": True, "b": False}
    assert "fault" in found["failed"]["b"]
    assert found["failed"]["a"] == []
    assert cli.run(["tune", "diff", "mine.toml", "mine.toml", *command[4:]]) == EXIT_PASSED
    said = capsys.readouterr().out
    assert "no parameter differs" in said
    assert "no figure differs" in said
    assert (
        cli.run(["tune", "diff", "mine.toml", "mine.toml", "--no-suite", "--suite", *command[4:]])
        == EXIT_PASSED
    )
    assert "no figure differs" in capsys.readouterr().out


def test_a_difference_names_figures_as_its_json_does(tmp_path: Path, capsys) -> None:
    figures = {"detector.latency_ms.p50": {"unit": "ms", "a": 2.0, "b": 3.0}}
    passed = {"a": True, "b": True}
    one = {"scenario": "some", "passed": passed, "failed": {"a": [], "b": []}, "figures": figures}
    safe = {"a": None, "b": None}
    show_difference({"changed": [], "figures_of_merit": {}, "suite": [one], "safe": safe}, tmp_path, tmp_path)
    assert "detector.latency_ms.p50" in capsys.readouterr().out
