"""Runs scenarios with one or several seeds for one verdict: in parallel in lockstep, else one by one."""

import time
import traceback
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from firmware_py.shell.builds import Build
from hil.bench import beginning, workers
from hil.bench.bench import prepare, run_scenario
from hil.bench.changes import changes
from hil.bench.ending import Outcome, close, reason_of, was_cut_short
from hil.bench.lockstep import Progress, silent
from hil.bench.verdict import KILLED, unjudged
from hil.judge import junit, requirements
from hil.record import run_folder
from hil.record.run_traces import read_json
from hil.scenario.scenario import Scenario, ScenarioError, load_scenario, scenario_names
from hil.scenario.seeds import at_other_times, merged
from hil.scenario.settings import Settings
from hil.show.report.pages import write_suite_report
from hil.timing.clock import ClockName
from hil.timing.signals import Interrupted, ending_signals

PROCESSES = 2
"""Parallel runs in lockstep; more gain little on two cores."""

RESULT = run_folder.SUITE_NOTE
"""File with a suite's result in its folder, for comparison with another suite."""


@dataclass(frozen=True, eq=False)
class Case:
    """One run of a suite; with several seeds, a run that has passed keeps only its verdict."""

    scenario: Scenario
    seed: int
    run_dir: Path
    one_of_many: bool


def scenarios_for(
    names: Sequence[str], clock: ClockName, settings: Settings = (), parameter_files: Sequence[Path] = ()
) -> tuple[list[Scenario], list[str]]:
    """The scenarios with these names (all without a name), and the names of those left out.

    In real time, scenarios with a modelled bus are left out. `settings` and `parameter_files` change each
    scenario, as in `load_scenario`.
    """
    scenarios: list[Scenario] = []
    given: dict[str, str] = {}
    for one in dict.fromkeys(names or scenario_names()):
        scenario = load_scenario(one, settings, parameter_files)
        if scenario.name in given:
            raise ScenarioError(
                f"{given[scenario.name]} and {one} are two scenarios of one name, {scenario.name}; rename one"
            )
        given[scenario.name] = one
        scenarios.append(scenario)
    left_out = [one.name for one in scenarios if clock != "lockstep" and one.bitrate is not None]
    return [one for one in scenarios if one.name not in left_out], left_out


def cases_of(scenarios: Sequence[Scenario], seeds: Sequence[int], folder: Path) -> list[Case]:
    """One run per scenario and seed, each in a folder of its own."""
    if len(seeds) == 1:
        return [Case(one, seeds[0], folder / one.name, False) for one in scenarios]
    return [
        Case(at_other_times(one, seed), seed, folder / one.name / f"seed-{seed}", True)
        for one in scenarios
        for seed in seeds
    ]


def judged(case: Case, clock: ClockName, bus: str, firmware: Build = "compiled") -> dict[str, Any]:
    """Run a case and return its verdict; a run that raises an exception has failed for this reason."""
    try:
        return run_scenario(
            case.scenario,
            clock,
            bus,
            case.run_dir,
            case.seed,
            silent,
            only_if_failed=case.one_of_many,
            firmware=firmware,
            of_a_suite=True,
            keep_traces=False,
        )
    except run_folder.RunFolderError:
        raise
    except Exception:
        traceback.print_exc()
        return read_json(case.run_dir / run_folder.VERDICT)


def verdicts(
    cases: Sequence[Case],
    clock: ClockName,
    bus: str,
    processes: int = PROCESSES,
    firmware: Build = "compiled",
) -> Generator[tuple[Case, dict[str, Any]]]:
    """Run the cases and yield their verdicts in the order of completion."""
    if clock != "lockstep":
        for case in cases:
            yield case, judged(case, clock, bus, firmware)
        return
    # Long runs first, so that no process still has a long run at the end.
    ordered = sorted(cases, key=lambda case: -case.scenario.duration_s) if processes > 1 else cases
    for case, found in workers.results(
        partial(judged, clock=clock, bus=bus, firmware=firmware), ordered, processes
    ):
        yield case, broken_off(case, clock, found) if isinstance(found, workers.Died) else found


def broken_off(case: Case, clock: ClockName, death: workers.Died) -> dict[str, Any]:
    """The verdict on a run whose process was killed, from the files that it left."""
    with run_folder.claimed(case.scenario.name, case.run_dir) as run_dir:
        if not run_folder.is_own(run_dir):
            beginning.begin(run_dir, case.scenario, clock, case.seed)
        reason = (
            f"its process {death.how}; if the machine ran out of memory, run fewer at the same time: --jobs 1"
        )
        return close(run_dir, Outcome(reasons=[reason]))


def taken_over(case: Case, clock: ClockName) -> dict[str, Any] | None:
    """The verdict of a case in an earlier, interrupted suite; None if not judged or its inputs changed."""
    described = read_json(case.run_dir / run_folder.RUN_NOTE)
    if described.get("key") != beginning.key_of(case.scenario, clock, case.seed):
        return None
    verdict = read_json(case.run_dir / run_folder.VERDICT)
    return None if was_cut_short(verdict) else verdict


def not_run(case: Case, clock: ClockName, why: str) -> dict[str, Any]:
    """The verdict on a run that an interrupted suite has not completed; its files are removed."""
    run_folder.discard(case.run_dir)
    return without_verdict(case, clock, f"{why} before its end")


def without_verdict(case: Case, clock: ClockName, reason: str) -> dict[str, Any]:
    """The failed verdict on a run that was not judged."""
    run = {"scenario": case.scenario.name, "clock": clock, "seed": case.seed}
    return unjudged(run, case.scenario.document, reason, case.run_dir)


def prejudge(path: Path, cases: Sequence[Case], clock: ClockName) -> None:
    """Write a JUnit file that names a kill as the reason; it remains if no other can be written."""
    first: dict[str, Case] = {}
    for case in cases:
        first.setdefault(case.scenario.name, case)
    killed = [without_verdict(case, clock, KILLED) for case in first.values()]
    path.write_text(junit.document(killed), encoding="utf-8")


def summary_of(verdict: Mapping[str, Any]) -> dict[str, Any]:
    """The result of one scenario in a suite."""
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
        "work_ratios": verdict["work_ratios"],
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
    settings: Settings = (),
    parameter_files: Sequence[Path] = (),
    baseline: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Run scenarios and write junit.xml, index.html and suite.json beside their folders.

    Returns the result that `--json` prints and suite.json holds. An interrupted suite keeps its finished
    runs; the next suite in the same folder continues from there. `baseline`: another suite's result, with
    which this one is compared (`hil.bench.changes`).
    """
    prepare(firmware, clock)
    scenarios, left_out = scenarios_for(names, clock, settings, parameter_files)
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
        "changed": [] if not scenarios else list(scenarios[0].changes),
        "changes": None,
    }
    if not scenarios:
        return result
    started = time.perf_counter()
    with run_folder.claimed("suite", out_dir, RESULT) as folder, ending_signals() as signals:
        cases = cases_of(scenarios, seeds, folder)
        for case in cases:
            run_folder.refuse_foreign(case.run_dir)
        asked = {"clock": clock, "bus": bus, "firmware": firmware}
        before = read_json(folder / RESULT)
        found: dict[Case, dict[str, Any]] = {}
        if before.get("asked") == asked and not before["complete"]:
            found = {case: verdict for case in cases if (verdict := taken_over(case, clock))}
        due = [case for case in cases if case not in found]
        for case in due:
            run_folder.discard(case.run_dir)
        run_folder.write_note(folder / RESULT, {**result, "asked": asked, "complete": False})
        page, xml = folder / "index.html", folder / "junit.xml"
        prejudge(xml, cases, clock)
        progress(len(found) / len(cases), f"running {len(due)} scenarios or seeds of {len(cases)}")
        interruption: BaseException | None = None
        try:
            with closing(verdicts(due, clock, bus, processes, firmware)) as coming:
                for case, verdict in coming:
                    found[case] = verdict
                    seed = f", seed {case.seed}" if case.one_of_many else ""
                    done = f"{len(found)}/{len(cases)}"
                    progress(len(found) / len(cases), f"{done} {case.scenario.name}{seed}")
        except (Interrupted, KeyboardInterrupt) as error:
            interruption = error
            signals.raises = False
            for case in (case for case in cases if case not in found):
                found[case] = taken_over(case, clock) or not_run(case, clock, reason_of(error))
        signals.raises = False
        by_scenario: dict[str, dict[int, dict[str, Any]]] = {}
        for case in cases:
            by_scenario.setdefault(case.scenario.name, {})[case.seed] = found[case]
        ordered = [merged(scenario.checks, by_scenario[scenario.name]) for scenario in scenarios]
        result |= {
            "scenarios": [summary_of(verdict) for verdict in ordered],
            "passed": all(verdict["passed"] for verdict in ordered),
            "bus": ordered[0]["bus"],
            "wall_s": time.perf_counter() - started,
            "junit": str(xml),
            "report": str(page),
            "requirements": requirements.trace(ordered),
        }
        if baseline is not None:
            result["changes"] = changes(baseline, result)
        xml.write_text(junit.document(ordered), encoding="utf-8")
        write_suite_report(page, ordered, result["requirements"], result["changes"])
        if interruption is None and signals.came:  # all runs are kept and not repeated
            interruption = Interrupted(signals.came[0])
        run_folder.write_note(folder / RESULT, {**result, "asked": asked, "complete": interruption is None})
    if interruption is not None:
        raise interruption
    return result
