"""The bench as a Python library: run a scenario and get the run as an object."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import get_args

from firmware_py.shell.builds import Build
from hil.record.traces.own_trace import NONE
from hil.runs.bench import run_scenario
from hil.runs.job import RunOptions, silent
from hil.runs.recorded_run import Run, open_run
from hil.scenario.files import ScenarioError
from hil.scenario.scenario import load_scenario
from hil.scenario.settings import Settings
from hil.timing.clock import ClockName, TimeName
from plant_sim.validation_messages import real


def run(
    scenario: str | Path,
    *,
    clock: ClockName = "lockstep",
    bus: str = "auto",
    time: TimeName = "held",
    firmware: str = "compiled",
    seed: int | None = None,
    set: Settings = (),
    parameters: str | Path | Sequence[str | Path] = (),
    out: str | Path | None = None,
) -> Run:
    """Run a scenario by its name or its file, record every signal, judge it, and return the run.

    `time` is that of real time: `held` while a process is late, or `strict`.
    `firmware` is the build: `python`, `compiled`, `host-single` or, in lockstep, `cortex-m7` or `cortex-m4f`;
    or a user's own controller as `FILE.py:FUNCTION`, or `none` where another program on the bus is one.
    `seed` is by default the scenario's.
    `set` changes values by dotted keys, such as `{"scene.striker.spring_n_m": 72.0}`; `parameters` is a file
    of `vibrohil tune`, or several; `out` is the run's folder, by default a new one under runs/. A run whose
    checks fail, or that is not judged, is also returned, with `passed` False.

    Raises `TextInputError` (`ScenarioError`, `SceneError`), `ParameterError`, `RunFolderError` or `BusError`
    for invalid input, each with a sentence that states the error and the remedy.
    """
    one_of("clock", clock, get_args(ClockName))
    one_of("time", time, get_args(TimeName))
    if not isinstance(firmware, str) or (":" not in firmware and firmware != NONE):
        one_of("firmware", firmware, get_args(Build))
    several: Iterable[object] = [parameters]
    if isinstance(parameters, Iterable) and not isinstance(parameters, str):
        several = parameters
    path_of("scenario", scenario)
    loaded = load_scenario(scenario, set, [path_of("parameters", file) for file in several])
    number = loaded.seed if seed is None else whole_number("seed", seed)
    folder = None if out is None else path_of("out", out)
    options = RunOptions(clock=clock, time=time, bus=bus, firmware=firmware)
    verdict = run_scenario(loaded, options, folder, number, silent)
    return open_run(verdict.folder)


def one_of(argument: str, value: object, names: Sequence[str]) -> None:
    """Raise ScenarioError unless the value of an argument is one of `names`."""
    if value not in names:
        wanted = f"{', '.join(names[:-1])} or {names[-1]}"
        raise ScenarioError(f"{argument} = {value!r}: wanted {wanted}")


def path_of(argument: str, value: object) -> Path:
    """The path that an argument names; ScenarioError for anything but a text or a path."""
    if not isinstance(value, str | Path):
        raise ScenarioError(f"{argument} = {value!r}: wanted a text or a path")
    return Path(value)


def whole_number(argument: str, value: int) -> int:
    """An argument of any integer type, such as numpy's, as an integer; ScenarioError for anything else."""
    if not (real(value) >= 0.0 and real(value).is_integer()):
        raise ScenarioError(f"{argument} = {value!r}: wanted a whole number of at least 0")
    return int(value)
