"""Replays: today's firmware sends what the recorded firmware sent, from the recorded frames alone."""

import json
import math
import shutil
from collections import Counter
from pathlib import Path

import pytest
from compilers import require_compiler

import hil
from firmware_py.interface.codec import CODEC_BY_ID
from firmware_py.interface.enums import Mode
from firmware_py.shell.builds import Build
from tools import cli
from tools.output import EXIT_BAD_INPUT, EXIT_CHECK_FAILED, EXIT_PASSED, BadInputError
from tools.runs.replay import IDS, divide_at_torques, divide_on_grid, frames_of_run, replay

E_STOP = "e-stop-in-the-hold"
DURATION_S = 14.0
PARAMETERS = 'format = 1\n[parameters."{}"]\nvalue = {}\nunit = "{}"\n'
BEFORE_S = 0.35
"""Of a foreign log the first third of a second is missing; the module still rests in READY."""


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with a start, impacts, and an E-stop that operator and firmware both send."""
    folder = tmp_path_factory.mktemp("recorded") / "run"
    hil.run(E_STOP, out=folder)
    return folder


@pytest.fixture(scope="module")
def foreign(run_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same frames as another bench would have logged them: another clock, and begun later."""
    path = tmp_path_factory.mktemp("foreign") / "bench.log"
    path.write_text("".join(lines_from(run_dir / "can.log", BEFORE_S)))
    return path


def lines_from(log: Path, from_s: float) -> list[str]:
    """The lines of a candump log from a time on, with the wall clock of another bench."""
    lines = []
    for line in log.read_text().splitlines(keepends=True):
        stamp, _, rest = line[1:].partition(")")
        if float(stamp) >= from_s:
            lines.append(f"({float(stamp) + 1.7e9:.6f}){rest}")
    return lines


def test_a_run_is_replayed_to_the_bit(run_dir: Path) -> None:
    result = replay(run_dir)
    assert result.equal
    assert (result.ticks, result.different_frames, result.first_difference) == (
        round(DURATION_S / 1e-3),
        0,
        None,
    )
    assert result.frames > result.ticks


def test_a_run_whose_log_ends_early_is_replayed_to_this_end(run_dir: Path, tmp_path: Path) -> None:
    """As of an interrupted run: what the firmware would receive later is not known."""
    cut = tmp_path / "run"
    shutil.copytree(run_dir, cut)
    lines = (cut / "can.log").read_text().splitlines(keepends=True)
    kept = [line for line in lines if float(line[1:].partition(")")[0]) < 8.0]
    (cut / "can.log").write_text("".join(kept))
    result = replay(cut)
    assert result.equal, result
    assert result.ticks == 8000
    assert result.reason == f"the log shows 8000 of the script's {round(1000 * DURATION_S)} ticks"
    assert replay(run_dir).reason == ""


def run_on_a_modelled_bus(folder: Path, bitrate: int) -> Path:
    scenario = folder / "modelled.toml"
    scenario.write_text(
        f'title = "An E-stop on a modelled bus"\nscene = "table1-motor-soft"\n[bus]\nbitrate = {bitrate}\n'
        '[script]\nduration_s = 1.0\ncommands = [{ at_s = 0.5, request = "e-stop" }]\n'
    )
    hil.run(scenario, out=folder / "run")
    return folder / "run"


def test_on_a_modelled_bus_the_firmwares_own_e_stop_precedes_its_torque(tmp_path: Path) -> None:
    run = run_on_a_modelled_bus(tmp_path, 1_000_000)
    result = replay(run)
    assert result.equal, result
    sent = Counter(one.frame.can_id for one in frames_of_run(run / "can.log"))
    assert sent[IDS["DriveEstop"]] > 1, "operator and firmware each send one"


def test_a_bus_on_which_frames_come_late_leaves_a_replay_not_judged(tmp_path: Path) -> None:
    result = replay(run_on_a_modelled_bus(tmp_path, 125_000))
    assert result.equal is None
    assert "125000 bit/s" in result.reason


def test_a_long_run_is_replayed_though_as_a_log_it_would_be_too_large(
    run_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for limit in ("foreign_logs.MOST_MESSAGES", "foreign_text.MOST_LINES"):
        monkeypatch.setattr(f"tools.exchange.{limit}", 1000)
    assert replay(run_dir).equal
    command = ["import", str(run_dir / "can.log"), "--out", str(tmp_path / "imported")]
    assert cli.run(command) == EXIT_BAD_INPUT
    assert f"view, inspect or replay {run_dir}" in "".join(capsys.readouterr().err.split("\n"))


@pytest.mark.parametrize("build", ["python", "host-single"])
def test_a_run_is_replayed_by_its_recorded_build(build: Build, tmp_path: Path) -> None:
    if build == "host-single":
        require_compiler("gcc")
    short = {"script.duration_s": 2.0, "script.commands": []}
    hil.run(E_STOP, out=tmp_path / "run", firmware=build, set=short)
    assert replay(tmp_path / "run").equal
    if build == "host-single":
        assert replay(tmp_path / "run", "compiled").different_frames > 0


def test_torque_frames_divide_a_log_as_the_grid_of_lockstep_does(run_dir: Path) -> None:
    recorded = frames_of_run(run_dir / "can.log")
    period_s = 1e-3
    by_grid = divide_on_grid(recorded, period_s, round(DURATION_S / period_s))
    by_torque = divide_at_torques(recorded, period_s)
    assert by_grid[0] == by_torque[0]
    assert [tick.received for tick in by_grid[1]] == [tick.received for tick in by_torque[1]]


def test_an_adapter_that_bundles_frames_adds_no_ticks(foreign: Path, tmp_path: Path) -> None:
    """All frames of a bundle have its time."""
    bundled = tmp_path / "bundled.log"
    lines = [line[1:].partition(")") for line in foreign.read_text().splitlines(keepends=True)]
    bundled.write_text(
        "".join(f"({math.ceil(float(t_s) / 0.016) * 0.016:.6f}){rest}" for t_s, _, rest in lines)
    )
    first, other = replay(foreign), replay(bundled)
    assert (other.equal, other.ticks, other.frames) == (True, first.ticks, first.frames)
    assert other.different_frames == first.different_frames


def test_other_parameters_are_found_at_the_first_frame_that_they_change(
    run_dir: Path, tmp_path: Path
) -> None:
    tuned = tmp_path / "tuned.toml"
    tuned.write_text(PARAMETERS.format("speed.gain_p_n_m_s", 0.02, "N m s"))
    result = replay(run_dir, parameters=[tuned])
    assert result.equal is False
    first = result.first_difference
    assert first is not None
    assert (first.frame, None in (first.recorded, first.replayed)) == ("SetInputTorque", False)
    assert first.recorded != first.replayed
    assert first.t_s > 0.5, "the parameter changes nothing before the start"


def test_a_changed_byte_is_found_where_it_stands(run_dir: Path, tmp_path: Path) -> None:
    """A reading that the recorded firmware did not receive changes the replayed frames behind it."""
    copied = tmp_path / "run"
    shutil.copytree(run_dir, copied)
    lines = (copied / "can.log").read_text().splitlines(keepends=True)
    index = next(i for i, line in enumerate(lines) if line.startswith("(8.000000) can0 009#"))
    stamp, _, _ = lines[index].partition("#")
    lines[index] = f"{stamp}#0000803F00000000\n"
    (copied / "can.log").write_text("".join(lines))
    result = replay(copied)
    assert result.equal is False
    assert result.first_difference is not None
    assert result.first_difference.recorded is not None
    assert 8.0 < result.first_difference.t_s < 8.02


def test_a_foreign_log_has_its_decisions_within_stated_times(foreign: Path) -> None:
    result = replay(foreign)
    assert result.compared == "decisions"
    assert result.equal
    assert result.different_frames > 0, "counters and the phase of periodic frames are another bench's"


def test_a_decision_that_another_firmware_makes_is_named(foreign: Path, tmp_path: Path) -> None:
    """With a force limit below the impacts, today's firmware stops where the recorded one went on."""
    strict = tmp_path / "strict.toml"
    strict.write_text(PARAMETERS.format("limit.force_n", 60.0, "N"))
    result = replay(foreign, parameters=[strict])
    assert result.equal is False
    fault = next(one for one in result.decisions if one.signal == "fault")
    assert fault.replayed is not None
    assert fault.replayed.value == "FORCE_LIMIT"


def test_a_log_that_begins_in_motion_or_with_a_jump_is_refused(run_dir: Path, tmp_path: Path) -> None:
    late = tmp_path / "late.log"
    late.write_text("".join(lines_from(run_dir / "can.log", 8.0)))
    with pytest.raises(BadInputError, match=r"begins in mode RUN; wanted INIT or READY"):
        replay(late)
    jumping = tmp_path / "jumping.log"
    lines = lines_from(run_dir / "can.log", BEFORE_S)
    jumping.write_text("".join([*lines[:4000], *lines[9000:]]))
    with pytest.raises(BadInputError, match=r"the clock jumps from .* at line 4001"):
        replay(jumping)
    silent = tmp_path / "silent.log"
    silent.write_text("(1.000000) can0 028#2A00FEFFEDFF0074\n")
    with pytest.raises(BadInputError, match=r"has no frame SetInputTorque"):
        replay(silent)


def test_a_run_whose_log_lacks_what_the_firmware_received_is_not_judged(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    hil.run("a-controller-that-goes-bus-off-stops-the-motor", out=folder)
    result = replay(folder)
    assert result.equal is None
    assert result.reason == "the injected fault bus-off at 6 s acts on what the log does not show"


def test_the_command_replays_a_folder_of_recordings(
    run_dir: Path, foreign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recordings = tmp_path / "recordings"
    shutil.copytree(run_dir, recordings / "a-run")
    shutil.copy(foreign, recordings / "bench.log")
    assert cli.run(["replay", str(recordings), "--json"]) == EXIT_PASSED
    payload = json.loads(capsys.readouterr().out)
    assert payload["equal"] is True
    assert [one["compared"] for one in payload["replays"]] == ["frames", "decisions"]
    strict = tmp_path / "strict.toml"
    strict.write_text(PARAMETERS.format("limit.force_n", 60.0, "N"))
    assert cli.run(["replay", str(run_dir), "--parameters", str(strict)]) == EXIT_CHECK_FAILED
    shown = " ".join(capsys.readouterr().out.split())
    assert "fault — — " in shown, "recorded: nothing more"
    assert "FORCE_LIMIT" in shown
    assert cli.run(["replay", str(tmp_path / "nowhere")]) == EXIT_BAD_INPUT
    for no_build in ("none", "nonsense"):
        assert cli.run(["replay", str(run_dir), "--firmware", no_build]) == EXIT_BAD_INPUT


def test_modes_in_the_recording_are_those_of_the_scenario(run_dir: Path) -> None:
    """The recording holds what the tests above rest on: a start, motion, and the E-stop."""
    sent, _ = divide_at_torques(frames_of_run(run_dir / "can.log"), 1e-3)
    beats = [one.frame for one in sent if one.frame.can_id == IDS["FirmwareHeartbeat"]]
    modes = {Mode(CODEC_BY_ID[frame.can_id].decode(frame.data).mode) for frame in beats}  # type: ignore[attr-defined]
    assert modes >= {Mode.READY, Mode.SOFT_START, Mode.RUN, Mode.E_STOP}
