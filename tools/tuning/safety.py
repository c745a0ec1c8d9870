"""Safety test of a set of parameters: their bounds, a start with its hold, and an E-stop; then their file.

The runs are scenarios of the bench in lockstep on the compiled build, with their own checks and plant.
"""

import math
import tempfile
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import tomli_w

from firmware_py.shell.parameters import ParameterError, with_overrides
from hil.judge.judge import judge
from hil.record.formats import PARAMETERS
from hil.record.new_file import write_anew
from hil.record.run_traces import read_run
from hil.runs.job import Job, Progress
from hil.runs.recording import in_lockstep
from hil.scenario.files import apply_differences, read_scenario
from hil.scenario.limits import without_own_limit
from hil.scenario.parameter_file import nest
from hil.scenario.scenario import check_scenario, load_scenario
from tools.tuning.result import Tuning

SCENARIOS = ("quick-start-below-the-band", "e-stop-in-the-hold")
OF_A_MODULE = ("soft-start-multistable", "e-stop-in-the-hold")
"""The scenarios for another module, at its ratio: it need not reach impacts at 1.1 in a second."""
SEED = 1


@dataclass(frozen=True)
class SafetyResult:
    """The result of one safety test; `why` names the failed checks."""

    scenario: str
    seed: int
    passed: bool
    why: str


def check_bounds(values: Mapping[str, float]) -> SafetyResult:
    """Test the bounds of the parameter table and the rules between parameters."""
    try:
        with_overrides(values)
    except ParameterError as error:
        return SafetyResult("bounds", SEED, False, str(error))
    return SafetyResult("bounds", SEED, True, "")


@dataclass(frozen=True)
class Bench:
    """The plant of the safety scenarios for parameters of another module.

    `scene`: the tables of another module, which is judged by the limits of the requirements alone, since a
    scenario's own suit its own module, and at `ratio`; `changes`: differences to a scene; `ratio`: otherwise
    the highest.
    """

    scene: Mapping[str, Any] | None = None
    changes: Mapping[str, Any] = field(default_factory=dict)
    ratio: float = math.inf

    def target_ratio(self, of_scenario: float) -> float:
        """The ratio of a command: another module's own, or the scenario's up to the highest."""
        is_own = self.scene is not None and math.isfinite(self.ratio)
        return self.ratio if is_own else min(self.ratio, of_scenario)


def judge_scenario(
    name: str, values: Mapping[str, float], progress: Progress, seed: int = SEED, bench: Bench | None = None
) -> SafetyResult:
    """Run a scenario with these parameters in place of its own, in a folder that is removed, and judge it."""
    document = deepcopy(read_scenario(name))
    if bench is not None:
        document["scene"] = apply_differences(
            deepcopy(dict(document["scene"] if bench.scene is None else bench.scene)), bench.changes
        )
        if bench.scene is not None:
            required = [one for one in load_scenario(name).checks if one.required is not None]
            document["checks"] = [without_own_limit(one) for one in required]
        for command in document["script"]["commands"]:
            if "target_ratio" in command:
                command["target_ratio"] = bench.target_ratio(command["target_ratio"])
    document["firmware"] = apply_differences(document["firmware"], nest(values))
    try:
        scenario = check_scenario(document, name)
    except ParameterError as error:
        return SafetyResult(name, seed, False, str(error))
    with tempfile.TemporaryDirectory(prefix="vibrohil-tune-") as folder:
        run_dir = in_lockstep(Job(scenario, seed, folder=Path(folder), progress=progress))
        verdict = judge(read_run(run_dir), run_dir)
    return SafetyResult(name, seed, bool(verdict.passed), "; ".join(verdict.why_not_passed))


def judge_safety(
    values: Mapping[str, float], progress: Progress, bench: Bench | None = None
) -> list[SafetyResult]:
    """Test the bounds; if the firmware would accept the values, run the safety scenarios too."""
    bounds = check_bounds(values)
    if not bounds.passed:
        return [bounds]
    names = SCENARIOS if bench is None or bench.scene is None else OF_A_MODULE
    return [bounds, *(judge_scenario(name, values, progress, SEED, bench) for name in names)]


def document_of(tuning: Tuning, safety: Sequence[SafetyResult]) -> dict[str, Any]:
    """The tables of the parameter file; `forced`: written although a safety scenario failed."""
    tables = tuning.as_json()
    safe = all(result.passed for result in safety)
    about: dict[str, Any] = {
        **{key: tables[key] for key in ("command", "source", "range_is")},
        "vibrohil": version("vibrohil"),
        "safe": safe,
        "forced": not safe,
        "warnings": tables["warnings"],
    }
    if tuning.seed is not None:
        about["seed"] = tuning.seed
    return {
        "format": PARAMETERS,
        "tuning": about,
        "parameters": tables["parameters"],
        "figures_of_merit": tables["figures_of_merit"],
        "safety": [asdict(result) for result in safety],
    }


def write(path: Path, tuning: Tuning, safety: Sequence[SafetyResult]) -> None:
    """Write the file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_anew(path, tomli_w.dumps(document_of(tuning, safety)))
