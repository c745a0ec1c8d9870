"""The run folder before and during a run; hil.rundir makes the verdict of it afterwards."""

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from hil import provenance
from hil.realtime import is_user_mode_linux
from hil.scenario import Scenario

RUNS = Path("runs")
MADE_BY_A_RUN = (
    *("*.trace", "*.trace.new", "can.log", "*.rrd", "*.log"),
    *("run.json", "outcome.json", "processes.json", "losses.json", "verdict.json"),
    *("scenario.toml", "junit.xml", "report.html"),
)


def free_folder(name: str) -> Path:
    """A folder under `runs` that is not there yet, named by the time and the scenario."""
    stamp = time.strftime("%Y%m%d-%H%M%S")
    folder, number = RUNS / f"{stamp}-{name}", 1
    while folder.exists():
        number += 1
        folder = RUNS / f"{stamp}-{name}-{number}"
    return folder


def clear(run_dir: Path) -> None:
    """Remove what a run has left in its folder."""
    for pattern in MADE_BY_A_RUN:
        for left_over in run_dir.glob(pattern):
            left_over.unlink()


def create(scenario: Scenario, out_dir: Path | None, clock: str, bus: Mapping[str, Any], seed: int) -> Path:
    """Make the run's folder with the scenario as run, and `run.json` but for the start.

    A folder that is given is taken; what an earlier run left there is removed.
    """
    run_dir = free_folder(scenario.name) if out_dir is None else out_dir
    run_dir.mkdir(parents=True, exist_ok=True)
    clear(run_dir)
    (run_dir / "scenario.toml").write_text(tomli_w.dumps(scenario.document))
    note(
        run_dir,
        scenario=scenario.name,
        title=scenario.title,
        clock=clock,
        **bus,
        seed=seed,
        period_s=scenario.period_s,
        user_mode_linux=is_user_mode_linux(),
        created=time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        changes=list(scenario.changes),
        **provenance.commit(),
        versions=provenance.versions(),
    )
    return run_dir


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON file whole or not at all: others may be reading it."""
    unfinished = path.with_name(f"{path.name}.new")
    unfinished.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n")
    unfinished.rename(path)


def note(run_dir: Path, **values: Any) -> None:
    """Add to `run.json`."""
    path = run_dir / "run.json"
    known = json.loads(path.read_text()) if path.exists() else {}
    write_json(path, known | values)
