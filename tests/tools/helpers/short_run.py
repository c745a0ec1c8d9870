"""A short run in lockstep: a second's start at r = 1.1, where only impacts are possible."""

from pathlib import Path
from typing import Any

from hil.runs.bench import run_scenario
from hil.runs.job import RunOptions
from hil.scenario.scenario import load_scenario

SCENARIO = """
title = "A quick start is on its way to the impacts"
scene = "table1-motor-soft"

[firmware.start]
rise_s = 0.5

[script]
duration_s = 3.0

[[script.commands]]
at_s = 0.2
request = "run"
target_ratio = 1.1

[[checks]]
name = "impact_count"
low = 1

[[checks]]
name = "fault"
equals = "none"
"""


def make_run(run_dir: Path, seed: int = 1, *settings: str) -> dict[str, Any]:
    """Run it into `run_dir` and give the verdict."""
    run_dir.parent.mkdir(parents=True, exist_ok=True)
    path = run_dir.parent / "short.toml"
    path.write_text(SCENARIO)
    scenario = load_scenario(path, settings)
    return run_scenario(scenario, RunOptions(clock="lockstep"), run_dir, seed, lambda *_: None).as_json()
