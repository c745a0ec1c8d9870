"""What others on the machine, or in the same folder, can do to what a command reads and writes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from short_run import make_run

from hil.record import new_file, run_folder
from hil.record.formats import KEY
from hil.runs.recorded_run import open_run
from text_input import TextInputError, read_text
from tools import cli
from tools.output import EXIT_BAD_INPUT, EXIT_PASSED
from tools.runs.catalogue import list_runs


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with its traces."""
    folder = tmp_path_factory.mktemp("neighbours") / "run"
    make_run(folder)
    assert (folder / "plant.trace").exists()
    return folder


@pytest.fixture
def foreign(monkeypatch: pytest.MonkeyPatch) -> None:
    """All that this user has belongs to another user."""
    owner = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    root = os.stat("/")
    monkeypatch.setattr(new_file, "SYSTEM", set() if root.st_uid == owner else {root.st_uid})


@pytest.mark.usefixtures("foreign")
@pytest.mark.parametrize(
    "command",
    [
        "run small.toml --clock lockstep",
        "import log.log --out link/out",
        "simulate table1-viscous --until 1 --plot link/x.svg",
    ],
)
def test_nothing_is_written_through_another_users_link(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    for name in ("runs", "link"):
        (tmp_path / name).symlink_to(tmp_path / "elsewhere")
    (tmp_path / "small.toml").write_text('like = "quick-start-below-the-band"\ntitle = "x"\n')
    (tmp_path / "log.log").write_text("(1.0) can0 123#00\n")
    assert cli.run(command.split()) == EXIT_BAD_INPUT
    assert "is another user's link to" in " ".join(capsys.readouterr().err.split())
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_another_users_folder_is_neither_written_nor_cleared(
    run_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], request: pytest.FixtureRequest
) -> None:
    theirs = shutil.copytree(run_dir, tmp_path / "theirs")
    before = sorted(theirs.iterdir())
    request.getfixturevalue("foreign")
    assert cli.run(["export", str(theirs), "--to", "csv"]) == EXIT_BAD_INPUT
    assert "name a file or folder with --out" in " ".join(capsys.readouterr().err.split())
    assert cli.run(["export", str(theirs), "--to", "csv", "--out", str(tmp_path / "mine")]) == EXIT_PASSED
    assert not run_folder.discard_unused(theirs, tmp_path)
    assert sorted(theirs.iterdir()) == before


def test_what_the_program_writes_is_its_users_alone_whatever_the_umask(run_dir: Path, tmp_path: Path) -> None:
    subprocess.run(
        [
            sys.executable,
            "-P",
            "-m",
            "tools.cli",
            "export",
            run_dir,
            "--to",
            "csv",
            "--out",
            tmp_path / "csv",
        ],
        check=True,
        capture_output=True,
        preexec_fn=lambda: os.umask(0) and None,
    )
    modes = {path.stat().st_mode & 0o022 for path in (tmp_path / "csv", *(tmp_path / "csv").iterdir())}
    assert modes == {0}


def test_a_folder_that_is_removed_while_it_is_written_is_one_sentence(tmp_path: Path) -> None:
    def written(remove: bool) -> None:
        with run_folder.claimed("x", tmp_path / "out") as folder:
            if remove:
                shutil.rmtree(folder)
            (folder / "missing").read_text()

    with pytest.raises(run_folder.RunFolderError, match="was removed by another program"):
        written(remove=True)
    with pytest.raises(FileNotFoundError):
        written(remove=False)


def test_a_cut_log_is_made_again_from_complete_traces(run_dir: Path, tmp_path: Path) -> None:
    damaged = shutil.copytree(run_dir, tmp_path / "damaged")
    os.truncate(damaged / "run.rrd", 200_000)
    assert open_run(damaged).verdict["ticks"] == open_run(run_dir).verdict["ticks"] > 0
    assert open_run(damaged).judged.reasons == open_run(run_dir).judged.reasons


def test_a_damaged_trace_is_named_by_the_log_that_is_made_without_it(run_dir: Path, tmp_path: Path) -> None:
    damaged = shutil.copytree(run_dir, tmp_path / "damaged")
    (damaged / "run.rrd").unlink()
    with (damaged / "plant.trace").open("r+b") as file:
        file.write(b"VHTRACE9")
    reasons = open_run(damaged).judged.reasons
    assert any("plant.trace is no trace of format 1" in one for one in reasons), reasons


def test_a_verdict_of_another_format_is_not_listed(run_dir: Path, tmp_path: Path) -> None:
    other = shutil.copytree(run_dir, tmp_path / "other")
    run_folder.write_json(other / "verdict.json", {KEY: 9, "passed": True})
    assert list_runs(tmp_path)[0].verdict is None


@pytest.mark.parametrize(
    "command", ["import a.log --out run", "replay a.log", "run small --clock lockstep --firmware a.log:tick"]
)
def test_a_link_to_itself_is_a_file_that_cannot_be_read(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.log").symlink_to("a.log")
    assert cli.run(command.replace("small", "soft-start-multistable").split()) == EXIT_BAD_INPUT
    assert "a.log" in capsys.readouterr().err


def test_an_empty_path_is_no_place_for_outputs(capsys: pytest.CaptureFixture[str]) -> None:
    for command in ("import x.log --out", "simulate table1-viscous --plot", "export --out"):
        assert cli.run([*command.split(), ""]) == EXIT_BAD_INPUT
        assert "it is empty; name a file or folder" in " ".join(capsys.readouterr().err.split())


def test_a_message_quotes_names_literally(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Rich would replace the names of emoji between colons."""
    (tmp_path / "p.log").write_text("root:x:0:0\n")
    assert cli.run(["import", str(tmp_path / "p.log")]) == EXIT_BAD_INPUT
    assert "root:x:0:0" in capsys.readouterr().err


def test_a_shown_scenario_is_checked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "s.toml").write_text(
        'like = "quick-start-below-the-band"\ntitle = "x"\n'
        'checks = [{ name = "a", expression = "open(1)", high = 1 }]\n'
    )
    assert cli.run(["list", "--show", str(tmp_path / "s.toml")]) == EXIT_BAD_INPUT
    assert "cannot be worked out" in " ".join(capsys.readouterr().err.split())


def test_a_pipe_in_the_place_of_a_text_that_was_looked_at_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its owner exchanges the file between a look at the path and its opening."""
    text, pipe = tmp_path / "text.toml", tmp_path / "pipe.toml"
    text.write_text("")
    os.mkfifo(pipe)
    monkeypatch.setattr(Path, "stat", lambda _, **__: os.stat(text))
    with pytest.raises(TextInputError, match="is no regular file; name a file"):
        read_text(pipe, "scenario", "name a file")
