"""The bench as a Python library: run a scenario and get the run as an object."""

from collections.abc import Sequence
from pathlib import Path

from firmware_py.shell.builds import Build
from hil.bench.bench import run_scenario
from hil.bench.lockstep import silent
from hil.bench.recorded_run import Run, open_run
from hil.scenario.scenario import load_scenario
from hil.scenario.settings import Settings
from hil.timing.clock import ClockName


def run(
    scenario: str | Path,
    *,
    clock: ClockName = "lockstep",
    bus: str = "auto",
    firmware: Build = "python",
    seed: int = 1,
    set: Settings = (),
    parameters: Sequence[str | Path] = (),
    out: str | Path | None = None,
) -> Run:
    """Run a scenario by its name or its file, record every signal, judge it, and return the run.

    `firmware` is the build: `python`, `compiled`, `host-single` or, in lockstep, `cortex-m7` or `cortex-m4f`.
    `set` changes values by dotted keys, such as `{"scene.striker.spring_n_m": 72.0}`; `parameters` are files
    of `vibrohil tune`; `out` is the run's folder, by default a new one under runs/. A run whose checks fail
    is also returned, with `passed` False.

    Raises `TextInputError` (`ScenarioError`, `SceneError`), `ParameterError`, `RunFolderError` or `BusError`
    for invalid input, each with a sentence that states the error and the remedy.
    """
    loaded = load_scenario(scenario, set, [Path(file) for file in parameters])
    folder = None if out is None else Path(out)
    verdict = run_scenario(loaded, clock, bus, folder, seed, progress=silent, firmware=firmware)
    return open_run(verdict["out"])
