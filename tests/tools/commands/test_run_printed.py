"""What a person reads after a run: the verdict first, then what has not passed, then how to go on."""

import pytest

from tools import cli
from tools.output import EXIT_CHECK_FAILED, NO_VALUE, console, figure, table_of

SCENARIO = """
title = "The crank reaches r = 0.6 without an impact, and with one"
scene = "table1-motor-soft"

[script]
duration_s = 3.0

[[script.commands]]
at_s = 0.2
request = "run"
target_ratio = 0.6

[[checks]]
name = "fault"
equals = "none"

[[checks]]
name = "largest_v_m_s"
low = 0.5
unit = "m/s"

[[checks]]
name = "energy_residual"
high = 1e-6
"""


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("printed")
    (folder / "both.toml").write_text(SCENARIO)
    return folder


def printed(command, monkeypatch, capsys):
    monkeypatch.setattr(console, "_width", 120)
    assert cli.run(command) == EXIT_CHECK_FAILED
    return capsys.readouterr().out


def test_a_run_says_the_verdict_first_and_what_to_do_next_last(run_folder, monkeypatch, capsys):
    out = run_folder / "run of both"
    command = ["run", str(run_folder / "both.toml"), "--clock", "lockstep", "--out", str(out)]
    lines = printed(command, monkeypatch, capsys).splitlines()
    assert lines[0] == "FAILED  The crank reaches r = 0.6 without an impact, and with one"
    (head,) = (number for number, line in enumerate(lines) if line.startswith("check "))
    names = [line.split()[0] for line in lines[head + 1 : head + 4]]
    assert names == ["largest_v_m_s", "fault", "energy_residual"]
    assert "≥ 0.5 m/s" in lines[head + 1]
    figures = [line for line in lines[head + 4 :] if line and not line.startswith("largest_v_m_s")]
    assert not [line for line in figures if line.endswith(NO_VALUE)]
    assert lines[-3].endswith(f"vibrohil view '{out}'")
    assert lines[-2].endswith(f"{out}/report.html")
    assert lines[-1].endswith(f"vibrohil inspect '{out}' --all")

    short = printed(["inspect", str(out)], monkeypatch, capsys)
    assert short.splitlines()[0] == lines[0]
    assert "loops.plant.ticks" not in short
    assert "loops.plant.ticks" in printed(["inspect", str(out), "--all"], monkeypatch, capsys)


def test_checks_that_share_a_reason_share_a_line(run_folder, monkeypatch, capsys):
    short = SCENARIO.replace("duration_s = 3.0", "duration_s = 1.0")
    for name, without in (("largest_v_m_s", "impact_v_m_s"), ("energy_residual", "speed.error")):
        short = short.replace(name, without)
    (run_folder / "short.toml").write_text(short)
    out = str(run_folder / "short")
    command = ["run", str(run_folder / "short.toml"), "--clock", "lockstep", "--out", out]
    reason = "the firmware never reached mode RUN, so the run has no hold"
    assert f"impact_v_m_s, speed.error: {reason}" in printed(command, monkeypatch, capsys).splitlines()


def test_a_fault_in_lockstep_was_held_up_by_nothing(run_folder, monkeypatch, capsys):
    start = "[firmware.start]\nrise_s = 0.1\nattempts = 0\n\n[script]"
    spoilt = SCENARIO.replace("[script]", start).replace("target_ratio = 0.6", "target_ratio = 1.3")
    (run_folder / "spoilt.toml").write_text(spoilt)
    command = ["run", str(run_folder / "spoilt.toml"), "--clock", "lockstep"]
    said = printed([*command, "--out", str(run_folder / "spoilt")], monkeypatch, capsys)
    (line,) = (line for line in said.splitlines() if line.startswith("latched fault start-failed at "))
    assert "held up" not in line


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [(1.5174, "1", "1.517"), (1.5174, "", "1.517"), (1.5174, "mm", "1.517 mm"), (None, "mm", NO_VALUE)],
)
def test_a_number_without_a_dimension_has_no_unit(value, unit, text):
    assert figure(value, unit) == text


def test_a_unit_in_a_column_s_name_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    console.print(table_of(("stop [m]", ">v [m/s]"), [("1", "2")]))
    assert capsys.readouterr().out.split("\n")[0].split() == ["stop", "[m]", "v", "[m/s]"]
