"""Pieces of work: the same on one core, on two and on a cluster that loses a worker; resumed after a kill."""

import os
import signal
import sys
from pathlib import Path

import cloudpickle
import pyarrow as pa
import pytest

from tools import cli, jobs
from tools.output import EXIT_BAD_INPUT, BadInputError
from tools.study import basin, store, work
from tools.study.cases import case

SPECS = [
    {**basin.specs(case("table1", "viscous"), 1.3, "state", 24)[0], "rows": [first, first + 3]}
    for first in range(0, 24, 3)
]


def tables(paths: list[Path]) -> list[pa.Table]:
    return [store.read(path)[0] for path in paths]


@pytest.fixture(scope="module")
def on_one_core(tmp_path_factory: pytest.TempPathFactory) -> list[pa.Table]:
    return tables(work.run("basin", basin.piece, SPECS, work.here(tmp_path_factory.mktemp("one"), 1)))


def test_two_cores_give_the_same(on_one_core: list[pa.Table], tmp_path: Path) -> None:
    assert tables(work.run("basin", basin.piece, SPECS, work.here(tmp_path, 2))) == on_one_core


def deadly_piece(spec):
    """The first worker to come here dies of it."""
    grave = Path(spec["grave"])
    try:
        grave.touch(exist_ok=False)
    except FileExistsError:
        return basin.piece({key: value for key, value in spec.items() if key != "grave"})
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("unreachable")


@pytest.mark.filterwarnings("default")  # the cluster's own, of a worker that was killed
def test_a_cluster_that_loses_a_worker_gives_the_same(on_one_core: list[pa.Table], tmp_path: Path) -> None:
    from distributed import LocalCluster

    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    specs = [{**spec, "grave": str(tmp_path / "grave")} for spec in SPECS]
    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1", silence_logs=50
    ) as cluster:
        where = work.here(tmp_path, None, cluster.scheduler_address)
        paths = work.run("basin", deadly_piece, specs, where)
    assert (tmp_path / "grave").exists()
    assert tables(paths) == on_one_core


@pytest.mark.parametrize(
    ("command", "scheduler"), [("study sweep", "nonsense"), ("campaign start-up --trials 1", "x:y")]
)
def test_a_scheduler_that_is_none_is_refused_at_once(
    command: str, scheduler: str, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hil.bench.bench.prepare", lambda *_: None)
    assert cli.run([*command.split(), "--scheduler", scheduler]) == EXIT_BAD_INPUT
    said = " ".join(capsys.readouterr().err.split())
    assert f"--scheduler {scheduler}: no Dask scheduler answers there" in said
    assert "Traceback" not in said


def test_what_is_there_is_not_computed_again(tmp_path: Path) -> None:
    computed: list[int] = []
    kill = [True]

    def piece(spec):
        if spec["number"] == 2 and kill:
            kill.clear()
            raise KeyboardInterrupt
        computed.append(spec["number"])
        return pa.table({"square": [spec["number"] ** 2]}), {"note": "n"}

    specs = [{"number": number} for number in range(4)]
    with pytest.raises(KeyboardInterrupt):
        work.run("square", piece, specs, work.here(tmp_path, 1))
    paths = work.run("square", piece, specs, work.here(tmp_path, 1))
    assert computed == [0, 1, 2, 3]
    assert [table["square"][0].as_py() for table in tables(paths)] == [0, 1, 4, 9]
    assert work.run("square", piece, specs, work.here(tmp_path, 1)) == paths
    assert len(computed) == 4


def test_a_damaged_piece_is_computed_again(tmp_path: Path) -> None:
    def piece(spec):
        return pa.table({"x": [1.0]}), {}

    (path,) = work.run("x", piece, [{}], work.here(tmp_path, 1))
    path.write_bytes(path.read_bytes()[:40])
    assert tables(work.run("x", piece, [{}], work.here(tmp_path, 1)))[0]["x"].to_pylist() == [1.0]


def test_a_result_says_what_it_was_computed_from(tmp_path: Path) -> None:
    (path,) = work.run("basin", basin.piece, SPECS[:1], work.here(tmp_path, 1))
    _, metadata = store.read(path)
    assert metadata["spec"] == SPECS[0]
    assert metadata["versions"]["numpy"]
    assert metadata["versions"] == store.versions()
    assert metadata["facts"] == {"uncertain": 0}


def test_wrong_settings_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jobs, "CONNECT_TIMEOUT_S", 0.5)
    with pytest.raises(BadInputError, match=r"--cores is 0: wanted 1 or more"):
        work.here(tmp_path, 0)
    with pytest.raises(BadInputError, match=r"no Dask scheduler answers"):
        work.run("x", basin.piece, SPECS[:1], work.here(tmp_path, None, "tcp://127.0.0.1:9"))
