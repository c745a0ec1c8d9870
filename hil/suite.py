"""Many scenarios, one verdict, in one seed or many: in lockstep two at a time, in real time one by one."""

import multiprocessing
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, NamedTuple

from firmware_py.shell.builds import Build
from hil import junit, requirements, run_folder
from hil.bench import ClockName, Progress, run_scenario
from hil.realtime import die_with_parent
from hil.report import write_suite_report
from hil.run_traces import read_json
from hil.scenario import Scenario, ScenarioError, load_scenario, scenario_names
from hil.seeds import at_another_moment, merged

PROCESSES = 2
"""Runs at once in lockstep; more gain little on two cores."""

RESULT = run_folder.SUITE_NOTE
"""What a suite leaves in its folder for another one to be compared with."""


class Case(NamedTuple):
    """One run of a suite; of one in many seeds only a failed run leaves more than its verdict."""

    scenario: Scenario
    seed: int
    run_dir: Path
    one_of_many: bool


def scenarios_for(names: Sequence[str], clock: ClockName) -> tuple[list[Scenario], list[str]]:
    """The scenarios of these names, all without one, and those left out: real time has no modelled bus."""
    scenarios: list[Scenario] = []
    given: dict[str, str] = {}
    for one in dict.fromkeys(names or scenario_names()):
        scenario = load_scenario(one)
        if scenario.name in given:
            raise ScenarioError(
                f"{given[scenario.name]} and {one} are two scenarios of one name, {scenario.name}; rename one"
            )
        given[scenario.name] = one
        scenarios.append(scenario)
    left_out = [one.name for one in scenarios if clock == "real" and one.bitrate is not None]
    return [one for one in scenarios if one.name not in left_out], left_out


def cases_of(scenarios: Sequence[Scenario], seeds: Sequence[int], folder: Path) -> list[Case]:
    """A run for each scenario and seed, each in a folder of its own."""
    if len(seeds) == 1:
        return [Case(one, seeds[0], folder / one.name, False) for one in scenarios]
    return [
        Case(at_another_moment(one, seed), seed, folder / one.name / f"seed-{seed}", True)
        for one in scenarios
        for seed in seeds
    ]


def silent(_: float, __: str) -> None:
    """One run's own progress is not shown."""


def judged(case: Case, clock: ClockName, bus: str, firmware: Build = "compiled") -> dict[str, Any]:
    """One run's verdict; a run that breaks off has failed, and says why."""
    scenario, seed, run_dir, one_of_many = case
    try:
        return run_scenario(scenario, clock, bus, run_dir, seed, silent, None, one_of_many, firmware)
    except run_folder.RunFolderError:
        raise
    except Exception:
        traceback.print_exc()
        return read_json(run_dir / run_folder.VERDICT)


def verdicts(
    cases: Sequence[Case],
    clock: ClockName,
    bus: str,
    processes: int = PROCESSES,
    firmware: Build = "compiled",
) -> Iterator[tuple[Case, dict[str, Any]]]:
    """The runs' verdicts as they come."""
    if clock == "real" or processes == 1:
        for case in cases:
            yield case, judged(case, clock, bus, firmware)
        return
    # Long ones first, so that no process is left with one at the end.
    ordered = sorted(cases, key=lambda case: -case.scenario.duration_s)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, context, initializer=die_with_parent) as pool:
        runs: dict[Future[dict[str, Any]], Case] = {
            pool.submit(judged, case, clock, bus, firmware): case for case in ordered
        }
        for run in as_completed(runs):
            yield runs[run], run.result()


def told(verdict: Mapping[str, Any]) -> dict[str, Any]:
    """What a suite's result says of one scenario."""
    return {
        "name": verdict["scenario"],
        "passed": verdict["passed"],
        "seeds": verdict["seeds"],
        "passed_seeds": verdict["passed_seeds"],
        "failed_seeds": verdict["failed_seeds"],
        "real_time": verdict["real_time"],
        "reasons": verdict["reasons"],
        "failed": [check for check in verdict["checks"] if not check["passed"]],
        "checks": verdict["checks"],
        "out": verdict["out"],
    }


def run_suite(
    names: Sequence[str],
    clock: ClockName,
    bus: str,
    out_dir: Path | None,
    seeds: Sequence[int],
    progress: Progress,
    processes: int = PROCESSES,
    firmware: Build = "compiled",
) -> dict[str, Any]:
    """Run scenarios and write junit.xml, index.html and suite.json beside their folders.

    Gives what `--json` prints, which is also what suite.json holds.
    """
    scenarios, left_out = scenarios_for(names, clock)
    result: dict[str, Any] = {
        "scenarios": [],
        "passed": False,
        "clock": clock,
        "bus": None,
        "firmware": firmware,
        "seeds": list(seeds),
        "left_out": left_out,
        "wall_s": 0.0,
        "junit": None,
        "report": None,
        "requirements": requirements.trace([]),
    }
    if not scenarios:
        return result
    started = time.perf_counter()
    with run_folder.claimed("suite", out_dir, RESULT) as folder:
        cases = cases_of(scenarios, seeds, folder)
        for case in cases:
            run_folder.refuse_foreign(case.run_dir)
        run_folder.add_to_note(folder / RESULT, result)
        progress(0.0, f"running {len(cases)} scenarios" if len(seeds) == 1 else f"running {len(cases)} runs")
        found: dict[str, dict[int, dict[str, Any]]] = {scenario.name: {} for scenario in scenarios}
        for number, (case, verdict) in enumerate(verdicts(cases, clock, bus, processes, firmware), 1):
            found[case.scenario.name][case.seed] = verdict
            seed = f", seed {case.seed}" if case.one_of_many else ""
            progress(number / len(cases), f"{number}/{len(cases)} {case.scenario.name}{seed}")
        ordered = [merged(scenario.checks, found[scenario.name]) for scenario in scenarios]
        page, xml = folder / "index.html", folder / "junit.xml"
        result |= {
            "scenarios": [told(verdict) for verdict in ordered],
            "passed": all(verdict["passed"] for verdict in ordered),
            "bus": ordered[0]["bus"],
            "wall_s": time.perf_counter() - started,
            "junit": str(xml),
            "report": str(page),
            "requirements": requirements.trace(ordered),
        }
        xml.write_text(junit.document(ordered), encoding="utf-8")
        write_suite_report(page, ordered, result["requirements"])
        run_folder.add_to_note(folder / RESULT, result)
    return result
