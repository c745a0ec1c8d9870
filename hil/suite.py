"""Many scenarios, one verdict: in lockstep two at a time, in real time one after the other."""

import multiprocessing
import time
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from hil import junit, run_folder, rundir
from hil.bench import ClockName, Outcome, Progress, run_scenario
from hil.report import write_suite_report
from hil.scenario import Scenario, load_scenario, scenario_names

PROCESSES = 2
"""Runs at once in lockstep; more gain little on two cores."""


def scenarios_for(names: Sequence[str], clock: ClockName) -> tuple[list[Scenario], list[str]]:
    """The scenarios of these names, all without one, and those left out: real time has no modelled bus."""
    scenarios = [load_scenario(name) for name in names or scenario_names()]
    left_out = [one.name for one in scenarios if clock == "real" and one.bitrate is not None]
    return [one for one in scenarios if one.name not in left_out], left_out


def silent(_: float, __: str) -> None:
    """One run's own progress is not shown."""


def judged(scenario: Scenario, clock: ClockName, bus: str, run_dir: Path, seed: int) -> dict[str, Any]:
    """One run's verdict; a run that breaks off has failed, and says why."""
    try:
        return run_scenario(scenario, clock, bus, run_dir, seed, silent)
    except Exception as error:
        traceback.print_exc()
        if not (run_dir / "run.json").exists():
            run_folder.create(scenario, run_dir, clock, {"bus": bus, "kernel_can": False}, seed)
        outcome = Outcome(reasons=[f"broke off: {type(error).__name__}: {error}"])
        run_folder.write_json(run_dir / "outcome.json", vars(outcome))
        return rundir.finish(run_dir)


def verdicts(
    scenarios: Sequence[Scenario], clock: ClockName, bus: str, out_dir: Path, seed: int
) -> Iterator[dict[str, Any]]:
    """The runs' verdicts as they come."""
    if clock == "real":
        for scenario in scenarios:
            yield judged(scenario, clock, bus, out_dir / scenario.name, seed)
        return
    # Long ones first, so that no process is left with one at the end.
    ordered = sorted(scenarios, key=lambda scenario: -scenario.duration_s)
    with ProcessPoolExecutor(PROCESSES, multiprocessing.get_context("spawn")) as pool:
        runs: list[Future[dict[str, Any]]] = [
            pool.submit(judged, scenario, clock, bus, out_dir / scenario.name, seed) for scenario in ordered
        ]
        for run in as_completed(runs):
            yield run.result()


def run_suite(
    names: Sequence[str],
    clock: ClockName,
    bus: str,
    out_dir: Path | None,
    seed: int,
    progress: Progress,
) -> dict[str, Any]:
    """Run scenarios and write junit.xml and index.html beside their folders; gives what `--json` prints."""
    scenarios, left_out = scenarios_for(names, clock)
    folder = run_folder.free_folder("suite") if out_dir is None else out_dir
    started = time.perf_counter()
    found: dict[str, dict[str, Any]] = {}
    if scenarios:
        folder.mkdir(parents=True, exist_ok=True)
        progress(0.0, f"running {len(scenarios)} scenarios")
    for verdict in verdicts(scenarios, clock, bus, folder, seed):
        found[verdict["scenario"]] = verdict
        progress(len(found) / len(scenarios), f"{verdict['scenario']}")
    ordered = [found[scenario.name] for scenario in scenarios]
    page, xml = folder / "index.html", folder / "junit.xml"
    if ordered:
        xml.write_text(junit.document(ordered), encoding="utf-8")
        write_suite_report(page, ordered)
    return {
        "scenarios": [
            {
                "name": verdict["scenario"],
                "passed": verdict["passed"],
                "real_time": verdict["real_time"],
                "reasons": verdict["reasons"],
                "failed": [check for check in verdict["checks"] if not check["passed"]],
                "out": verdict["out"],
            }
            for verdict in ordered
        ],
        "passed": bool(ordered) and all(verdict["passed"] for verdict in ordered),
        "clock": clock,
        "left_out": left_out,
        "wall_s": time.perf_counter() - started,
        "junit": str(xml) if ordered else None,
        "report": str(page) if ordered else None,
    }
