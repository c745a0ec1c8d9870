"""The bench as a Python library: run a scenario and get the run as an object."""

from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from firmware_py.shell.builds import Build
from hil.bench.bench import run_scenario
from hil.bench.lockstep import silent
from hil.bench.recorded_run import Run, open_run
from hil.scenario.scenario import ScenarioError, load_scenario
from hil.scenario.settings import Settings
from hil.timing.clock import ClockName
from plant_sim.validation_messages import real


def run(
    scenario: str | Path,
    *,
    clock: ClockName = "lockstep",
    bus: str = "auto",
    firmware: Build = "python",
    seed: int | None = None,
    set: Settings = (),
    parameters: str | Path | Sequence[str | Path] = (),
    out: str | Path | None = None,
) -> Run:
    """Run a scenario by its name or its file, record every signal, judge it, and return the run.

    `firmware` is the build: `python`, `compiled`, `host-single` or, in lockstep, `cortex-m7` or `cortex-m4f`.
    `seed` is by default the scenario's.
    `set` changes values by dotted keys, such as `{"scene.striker.spring_n_m": 72.0}`; `parameters` is a file
    of `vibrohil tune`, or several; `out` is the run's folder, by default a new one under runs/. A run whose
    checks fail is also returned, with `passed` False.

    Raises `TextInputError` (`ScenarioError`, `SceneError`), `ParameterError`, `RunFolderError` or `BusError`
    for invalid input, each with a sentence that states the error and the remedy.
    """
    one_of("clock", clock, get_args(ClockName))
    one_of("firmware", firmware, get_args(Build))
    files = [parameters] if isinstance(parameters, str | Path) else parameters
    loaded = load_scenario(scenario, set, [Path(file) for file in files])
    number = loaded.seed if seed is None else whole_number("seed", seed)
    folder = None if out is None else Path(out)
    verdict = run_scenario(loaded, clock, bus, folder, number, progress=silent, firmware=firmware)
    return open_run(verdict["out"])


def one_of(argument: str, value: object, names: Sequence[str]) -> None:
    """Raise ScenarioError unless the value of an argument is one of `names`."""
    if value not in names:
        wanted = f"{', '.join(names[:-1])} or {names[-1]}"
        raise ScenarioError(f"{argument} = {value!r}: wanted {wanted}")


def whole_number(argument: str, value: int) -> int:
    """An argument of any integer type, such as numpy's, as an integer; ScenarioError for anything else."""
    if not (real(value) >= 0.0 and real(value).is_integer()):
        raise ScenarioError(f"{argument} = {value!r}: wanted a whole number of at least 0")
    return int(value)
