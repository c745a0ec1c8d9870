"""`vibrohil simulate`: what it prints, and how it refuses."""

import json
from pathlib import Path

import pytest

from tools import cli
from tools.output import EXIT_BAD_INPUT

ROOT = Path(__file__).parents[3]


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, object]:
    assert cli.run(["simulate", *arguments, "--json"]) == 0
    content: dict[str, object] = json.loads(capsys.readouterr().out)
    return content


def test_a_scene_runs_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    payload = printed(capsys, "table1-viscous", "--until", "5", "--set", "scene.drive.ratio=1.0")
    assert payload["method"] == "exact"
    assert len(payload["impacts_t_s"]) > 3  # type: ignore[arg-type]  # JSON's own types
    assert payload["electrical"] is None


def test_each_impact_is_a_row(capsys: pytest.CaptureFixture[str]) -> None:
    command = ["simulate", "table1-viscous", "--until", "2", "--set", "scene.drive.ratio=1.1"]
    assert cli.run(command) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    header = lines.index(["t_s", "v_m_s", "impulses_n_s", "peak_forces_n"])
    assert [line[0] for line in lines[header + 1 :]] == ["0.8803", "1.42", "1.99"]


def test_windings_have_an_account_of_their_own(capsys: pytest.CaptureFixture[str]) -> None:
    payload = printed(capsys, "table1-dq-motor", "--until", "1", "--torque", "0.1")
    account = payload["electrical"]
    assert isinstance(account, dict)
    assert account["work_j"] > account["shaft_j"] > 0.0
    assert account["copper_j"] == pytest.approx(1.5 * 0.4 * 1.25**2 * 1.0, rel=0.05)
    assert account["residual"] < 1e-8


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["table1-viscous", "--set", "drive.ratio=1.0"], "wanted one of scene."),
        (["table1-viscous", "--until", "-1"], "--until is -1"),
        (["table1-viscous", "--torque", "0.1"], "an ideal drive, which takes none"),
    ],
)
def test_what_makes_no_sense_is_bad_input(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(["simulate", *arguments]) == 4
    assert said in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("command", "table", "message"),
    [
        (["run"], "scenes/table1-motor-soft", "is a scene; use `vibrohil simulate`"),
        (["suite"], "scenes/table1-motor-soft", "is a scene; use `vibrohil simulate`"),
        (["simulate"], "scenarios/ordinary/soft-start-multistable", "is a scenario; use `vibrohil run`"),
    ],
)
def test_a_scene_in_a_scenarios_place_is_refused_by_what_it_is(
    command: list[str], table: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    room = "plant_sim" if table.startswith("scenes") else "hil"
    mine = tmp_path / "light.toml"
    mine.write_text((ROOT / room / f"{table}.toml").read_text("utf-8"))
    assert cli.run([*command, str(mine)]) == EXIT_BAD_INPUT
    assert message in " ".join(capsys.readouterr().err.split())
