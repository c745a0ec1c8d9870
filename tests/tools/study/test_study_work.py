"""Pieces of work: the same on one core, on two and on a cluster that loses a worker; resumed after a kill."""

import json
import os
import signal
import sys
from pathlib import Path
from typing import Any, NamedTuple

import cloudpickle
import pytest

from hil.record.run_folder import RunFolderError
from tools import cli, jobs
from tools.output import EXIT_BAD_INPUT, BadInputError
from tools.study import basin, work
from tools.study.cases import case

TASKS = [
    basin.Rows(case("table1", "viscous"), 1.3, "state", 24, first, first + 3) for first in range(0, 24, 3)
]


@pytest.fixture(scope="module")
def on_one_core(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    return work.run("basin", basin.piece, TASKS, work.Where(tmp_path_factory.mktemp("one"), 1))


def test_two_cores_give_the_same(on_one_core: list[Any], tmp_path: Path) -> None:
    assert work.run("basin", basin.piece, TASKS, work.Where(tmp_path, 2)) == on_one_core


class Deadly(NamedTuple):
    """Rows of a map, and the file that says that a worker has died."""

    rows: basin.Rows
    grave: Path


def deadly_piece(task: Deadly) -> list[Any]:
    """The first worker to come here dies of it."""
    try:
        task.grave.touch(exist_ok=False)
    except FileExistsError:
        return basin.piece(task.rows)
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("unreachable")


@pytest.mark.filterwarnings("default")  # the cluster's own, of a worker that was killed
def test_a_cluster_that_loses_a_worker_gives_the_same(on_one_core: list[Any], tmp_path: Path) -> None:
    from distributed import LocalCluster

    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    tasks = [Deadly(rows, tmp_path / "grave") for rows in TASKS]
    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1", silence_logs=50
    ) as cluster:
        where = work.Where(tmp_path, None, cluster.scheduler_address)
        found = work.run("basin", deadly_piece, tasks, where)
    assert (tmp_path / "grave").exists()
    assert found == on_one_core


@pytest.mark.parametrize(
    ("command", "scheduler"), [("study sweep", "nonsense"), ("campaign start-up --trials 1", "x:y")]
)
def test_a_scheduler_that_is_none_is_refused_at_once(
    command: str, scheduler: str, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hil.runs.bench.prepare", lambda *_: None)
    assert cli.run([*command.split(), "--scheduler", scheduler]) == EXIT_BAD_INPUT
    said = " ".join(capsys.readouterr().err.split())
    assert f"--scheduler {scheduler}: no Dask scheduler answers there" in said
    assert "Traceback" not in said


def test_what_is_there_is_not_computed_again(tmp_path: Path) -> None:
    computed: list[int] = []
    kill = [True]

    def square(number: int) -> int:
        if number == 2 and kill:
            kill.clear()
            raise KeyboardInterrupt
        computed.append(number)
        return number**2

    with pytest.raises(KeyboardInterrupt):
        work.run("square", square, range(4), work.Where(tmp_path, 1))
    assert work.run("square", square, range(4), work.Where(tmp_path, 1)) == [0, 1, 4, 9]
    assert computed == [0, 1, 2, 3]
    assert work.run("square", square, range(4), work.Where(tmp_path, 1)) == [0, 1, 4, 9]
    assert len(computed) == 4


def other_task(path: Path) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | {"task": "9", "result": "forged"}))


def other_type(path: Path) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | {"result": {"of another type": 1}}))


def other_number(path: Path) -> None:
    path.write_text(path.read_text().replace("[0.2]", "[0.3]"))


def sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(3 << 30)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:40])


def nest(path: Path) -> None:
    path.write_text("[" * 100_000)


def double(number: float) -> list[float]:
    return [2.0 * number]


@pytest.fixture
def stored(tmp_path: Path) -> Path:
    """The one piece in the folder of a study."""
    work.run("double", double, [0.1], work.Where(tmp_path, 1))
    (path,) = (tmp_path / "pieces").iterdir()
    return path


@pytest.mark.parametrize("damage", [cut, sparse, nest, other_task, other_type, other_number])
def test_a_damaged_piece_is_reported_and_computed_again(damage, stored: Path, tmp_path: Path, capsys) -> None:
    damage(stored)
    assert work.run("double", double, [0.1], work.Where(tmp_path, 1)) == [[0.2]]
    assert "computed anew" in (said := " ".join(capsys.readouterr().err.split()))
    assert "taken over" not in said
    assert work.run("double", double, [0.1], work.Where(tmp_path, 1)) == [[0.2]]
    assert "double: 1 of 1 results taken over" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("mode", [0o664, 0o646])
def test_results_that_another_user_may_have_written_are_refused(
    mode: int, stored: Path, tmp_path: Path, monkeypatch
) -> None:
    user = os.geteuid()
    for place in (stored, stored.parent):
        before = place.stat().st_mode
        place.chmod(before | mode)
        with pytest.raises(RunFolderError, match=r"another user may have written .*mode .*remove it"):
            work.run("double", double, [0.1], work.Where(tmp_path, 1))
        place.chmod(before)
    monkeypatch.setattr(os, "geteuid", lambda: user + 1)
    with pytest.raises(RunFolderError, match=rf"another user may have written .owner {user}, "):
        work.run("double", double, [0.1], work.Where(tmp_path, 1))
    monkeypatch.undo()
    stored.rename(tmp_path / "forged")
    stored.symlink_to(tmp_path / "forged")
    with pytest.raises(RunFolderError, match="is no file of a result"):
        work.run("double", double, [0.1], work.Where(tmp_path, 1))


def test_results_are_written_by_their_user_alone_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    work.run("double", double, [0.1], work.Where(tmp_path, 1))
    assert os.umask(before) == 0
    (path,) = (tmp_path / "pieces").iterdir()
    assert (path.stat().st_mode & 0o777, path.parent.stat().st_mode & 0o777) == (0o644, 0o755)


def test_a_result_says_what_it_was_computed_from(tmp_path: Path) -> None:
    work.run("basin", basin.piece, TASKS[:1], work.Where(tmp_path, 1))
    (path,) = (tmp_path / "pieces").iterdir()
    content = json.loads(path.read_text("utf-8"))
    assert content["task"] == repr(TASKS[0])
    assert content["versions"]["numpy"]
    assert content["versions"] == work.versions()


def test_a_scheduler_that_does_not_answer_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jobs, "CONNECT_TIMEOUT_S", 0.5)
    with pytest.raises(BadInputError, match=r"no Dask scheduler answers"):
        work.run("x", basin.piece, TASKS[:1], work.Where(tmp_path, None, "tcp://127.0.0.1:9"))
