"""NUMBA_DISABLE_JIT=1: Python runs the plant in a run and in a campaign's trial, with the same frames."""

import json
import os
import subprocess
import sys
from pathlib import Path

TICKS = 120
RUN = f"""
import json
from dataclasses import replace
from pathlib import Path
from hil.runs.job import Job
from hil.runs.recording import in_lockstep
from hil.scenario.scenario import load_scenario
from tools.campaign.run import run
moment = replace(load_scenario("at-r-0.6-it-never-reaches-the-stop"), duration_s={TICKS * 1e-3}, checks=())
folder = in_lockstep(Job(moment, 1, folder=Path("run")))
print(json.dumps([(folder / "can.log").read_text(), run(moment, 1).true("x_m").tolist()]))
"""


def test_an_interpreted_run_sends_the_same_frames(tmp_path: Path) -> None:
    printed = []
    for setting in ("1", "0"):
        folder = tmp_path / setting
        folder.mkdir()
        run = subprocess.run(
            [sys.executable, "-c", RUN],
            cwd=folder,
            env=os.environ | {"NUMBA_DISABLE_JIT": setting, "PYTHONPATH": str(Path(__file__).parents[3])},
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode == 0, run.stderr
        printed.append(json.loads(run.stdout))
    assert printed[0] == printed[1]
    assert len(printed[0][1]) == TICKS
    assert len(printed[0][0].splitlines()) > TICKS
