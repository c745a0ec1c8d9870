"""The roster: a fourth node is one entry, and runs on both clocks, is logged, and has faults."""

import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import second_imu as its_module
import tomli_w
from second_imu import CAN_ID

from hil.faults.on_process import is_process
from hil.record.traces.trace import read
from hil.roster import ROSTER, Node
from hil.runs.compiled import Stretches
from hil.runs.job import Job
from hil.runs.realtime import program
from hil.runs.recorded_run import open_run
from hil.runs.recording import record
from hil.scenario.files import ScenarioError, read_scenario
from hil.scenario.scenario import Scenario, check_scenario

TICKS = 1000


def short(*faults: dict[str, Any]) -> Scenario:
    document = dict(read_scenario("e-stop-in-the-hold"))
    document["checks"] = []
    commands = [{"at_s": 0.2, "request": "run", "target_ratio": 1.1}]
    document["script"] = {"duration_s": 1e-3 * TICKS, "commands": commands, "faults": list(faults)}
    return check_scenario(document, "with-a-second-imu")


def killed(process: str) -> dict[str, Any]:
    return {"kind": "killed", "at_s": 0.5, "process": process}


@pytest.fixture
def second_imu() -> Iterator[None]:
    node = Node("imu", 0.5, "second_imu:SecondImu", traces=("imu",))
    ROSTER.append(node)
    yield
    ROSTER.remove(node)


def log_of(folder: Path) -> list[str]:
    return (folder / "can.log").read_text().splitlines()


def test_a_fourth_node_runs_is_logged_and_can_be_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    folders = [tmp_path / name for name in ("without", "with", "killed")]
    for folder in folders:
        folder.mkdir()
    record(Job(short(), 1, folder=folders[0]))
    request.getfixturevalue("second_imu")
    monkeypatch.setattr(Stretches, "run", None)  # it has no compiled turn: no stretch contains all nodes
    record(Job(short(), 1, folder=folders[1]))
    job = Job(short(killed("imu")), 1, folder=folders[2])
    record(job)
    assert job.outcome.faults_acted == [TICKS // 2]
    own = f"can0 {CAN_ID:03X}#"
    for folder, ticks in zip(folders[1:], (TICKS, TICKS // 2), strict=True):
        assert [line for line in log_of(folder) if own not in line] == log_of(folders[0])
        assert sum(own in line for line in log_of(folder)) == ticks
        np.testing.assert_array_equal(read(folder / "imu.trace")["tick"], np.arange(ticks))
        for name in ("plant", "firmware"):
            before, after = (read(one / f"{name}.trace") for one in (folders[0], folder))
            for column in set(before.dtype.names or ()) - {"work_us"}:
                np.testing.assert_array_equal(after[column], before[column], err_msg=column)


ENTRY = """from hil.roster import ROSTER, Node
ROSTER.append(Node("imu", 0.5, "second_imu:SecondImu", traces=("imu",)))
"""


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("faults", "ticks"), [((), TICKS), ((killed("imu"),), TICKS // 2)], ids=["", "killed"]
)
def test_a_fourth_node_runs_in_real_time(tmp_path: Path, faults: tuple[Any, ...], ticks: int) -> None:
    """Each of the run's processes has the entry, as if it stood in the roster's file."""
    (tmp_path / "sitecustomize.py").write_text(ENTRY)
    paths = [str(tmp_path), str(Path(its_module.__file__).parent), os.environ.get("PYTHONPATH", "")]
    document = {**short().document}
    document["script"] = {**document["script"], "faults": list(faults)}
    document["checks"] = [{"name": "impact_count", "low": 0, "high": 1000}]
    scenario, folder = tmp_path / "scenario.toml", tmp_path / "run"
    scenario.write_text(tomli_w.dumps(document))
    command = [program(), "run", str(scenario), "--clock", "real", "--bus", "local", "--out", str(folder)]
    ran = subprocess.run(
        command,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    run = json.loads((folder / "run.json").read_text())
    assert {"plant", "operator", "firmware"} <= set(run["nodes"])
    assert ("imu" in run["nodes"]) == (not faults)
    own = f"can0 {CAN_ID:03X}#"
    sent = [line.strip()[-2:] for line in log_of(folder) if own in line]
    assert sent == [f"{tick & 255:02X}" for tick in range(ticks)]
    np.testing.assert_array_equal(open_run(folder).table("imu")["tick"], np.arange(ticks))


def test_a_fault_of_a_node_that_there_is_not_names_those_that_there_are() -> None:
    with pytest.raises(ScenarioError, match="'imu' is no process of the bench; give plant or firmware"):
        short(killed("imu"))
    with pytest.raises(ScenarioError, match="'imu' is no node of the bench; give plant, operator or f"):
        short({"kind": "unplugged", "at_s": 0.5, "node": "imu"})
    assert is_process("plant") == "plant"
