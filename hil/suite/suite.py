"""Runs scenarios with one or several seeds for one verdict: in parallel in lockstep, else one by one."""

import traceback
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

from hil.judge.failures import failures_of
from hil.judge.seeds import ScenarioVerdict, merge
from hil.judge.verdict import KILLED, RunVerdict, Verdict, trace, without_records, worst
from hil.judge.verdict_files import junit_document, read_verdict
from hil.processes import workers
from hil.processes.signals import EndingSignals, Interrupted, ending_signals
from hil.record import formats, run_folder
from hil.record.damage import DamagedFileError, reading
from hil.record.new_file import write_anew
from hil.record.run_traces import read_json
from hil.run_files import RunFile
from hil.runs.bench import is_verdict, prepare, reason_of, run_scenario, was_cut_short
from hil.runs.job import Outcome, Progress, RunOptions, silent
from hil.runs.recording import begin, key_of
from hil.scenario.files import ScenarioError, scenario_names, sources_in
from hil.scenario.scenario import Scenario, load_scenario
from hil.scenario.seeds import delay_faults
from hil.scenario.settings import Settings
from hil.show.report.pages import write_suite_report
from hil.suite.changes import Baseline, changes, find_only_in
from hil.timing.clock import ClockName

PROCESSES = 2
"""Parallel runs in lockstep; more gain little on two cores."""

RESULT = run_folder.SUITE_NOTE
"""File with a suite's result in its folder, for comparison with another suite."""
PAGE = "index.html"


@dataclass(frozen=True, eq=False)
class Case:
    """One run of a suite; with several seeds, a run that has passed keeps no log and no traces."""

    scenario: Scenario
    seed: int
    run_dir: Path
    one_of_many: bool


def scenarios_for(
    names: Sequence[str], clock: ClockName, settings: Settings = (), parameter_files: Sequence[Path] = ()
) -> tuple[list[Scenario], list[str]]:
    """The scenarios with these names (all without a name), and the names of those left out.

    A file with several cases stands for all of them. In real time, scenarios with a modelled bus are left
    out. `settings` and `parameter_files` change each scenario, as in `load_scenario`.
    """
    scenarios: list[Scenario] = []
    given: dict[str, str] = {}
    sources = (source for name in names or scenario_names() for source in sources_in(name))
    for one in dict.fromkeys(sources):
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
        Case(delay_faults(one, seed), seed, folder / one.name / f"seed-{seed}", True)
        for one in scenarios
        for seed in seeds
    ]


def judge_case(case: Case, options: RunOptions) -> RunVerdict:
    """Run a case and return its verdict; a run that raises an exception has failed for this reason.

    An exception without a verdict is raised again: nothing ran, for example because the bus does not open.
    """
    options = replace(options, only_if_failed=case.one_of_many, of_a_suite=True, keep_traces=False)
    try:
        return run_scenario(case.scenario, options, case.run_dir, case.seed, silent)
    except run_folder.RunFolderError:
        raise
    except Exception as error:
        verdict = case.run_dir / RunFile.VERDICT
        if not verdict.exists():
            raise
        if not is_verdict(error):  # a defect of this program
            traceback.print_exc()
        return read_verdict(verdict)


def run_cases(
    cases: Sequence[Case], options: RunOptions, processes: int = PROCESSES
) -> Generator[tuple[Case, RunVerdict]]:
    """Run the cases and yield their verdicts in the order of completion."""
    if options.clock != "lockstep":
        for case in cases:
            yield case, judge_case(case, options)
        return
    # Long runs first, so that no process still has a long run at the end.
    ordered = sorted(cases, key=lambda case: -case.scenario.duration_s) if processes > 1 else cases
    for case, found in workers.results(partial(judge_case, options=options), ordered, processes):
        yield case, close_broken_off(case, options.clock, found) if isinstance(found, workers.Died) else found


def close_broken_off(case: Case, clock: ClockName, death: workers.Died) -> RunVerdict:
    """The verdict on a run whose process was killed, from the files that it left."""
    from hil.runs.verdict import close  # noqa: PLC0415 - it loads the writers of log and report

    with run_folder.claimed(case.scenario.name, case.run_dir) as run_dir:
        if not run_folder.is_own(run_dir):
            begin(run_dir, case.scenario, clock, case.seed)
        reason = (
            f"its process {death.how}; if the machine ran out of memory, run fewer at the same time: --jobs 1"
        )
        return close(run_dir, Outcome(reasons=[reason]))


def take_over(case: Case, clock: ClockName) -> RunVerdict | None:
    """The verdict of a case in an earlier, interrupted suite.

    None if it is not judged or damaged, its inputs have changed, or another user may have written it.
    """
    described = read_json(case.run_dir / RunFile.NOTE)
    if described.get("key") != key_of(case.scenario, clock, case.seed):
        return None
    place = case.run_dir / RunFile.VERDICT
    is_trusted = place.exists() and run_folder.is_written_by_oneself(case.run_dir, place)
    with suppress(DamagedFileError), reading(place, "the run is judged again"):
        verdict = read_verdict(place) if is_trusted else None
        return None if verdict is None or was_cut_short(verdict) else verdict
    return None


def discard_not_run(case: Case, clock: ClockName, why: str) -> RunVerdict:
    """The verdict on a run that an interrupted suite has not completed; its files are removed."""
    run_folder.discard(case.run_dir)
    return fail_unjudged(case, clock, f"{why} before its end")


def fail_unjudged(case: Case, clock: ClockName, reason: str) -> RunVerdict:
    """The failed verdict on a run that was not judged."""
    run = {"scenario": case.scenario.name, "clock": clock, "seed": case.seed}
    return without_records(run, case.scenario.checks, reason, case.run_dir)


def write_junit_of_kill(path: Path, cases: Sequence[Case], clock: ClockName) -> None:
    """Write a JUnit file that names a kill as the reason; it remains if no other can be written."""
    first: dict[str, Case] = {}
    for case in cases:
        first.setdefault(case.scenario.name, case)
    killed = [fail_unjudged(case, clock, KILLED) for case in first.values()]
    write_anew(path, junit_document(killed))


@dataclass(frozen=True, slots=True)
class Chosen:
    """The scenarios of a suite by name or file (all without a name), and what is changed in each."""

    names: Sequence[str] = ()
    settings: Settings = ()
    parameter_files: Sequence[Path] = ()


@dataclass
class Suite:
    """A suite in its folder: its cases and the verdicts found so far. Its steps are called in this order."""

    folder: Path
    options: RunOptions
    cases: Sequence[Case]
    found: dict[Case, RunVerdict] = field(default_factory=dict)

    def resume(self, result: Mapping[str, Any]) -> None:
        """Take over the verdicts of an interrupted suite with the same options, and begin the others anew."""
        for case in self.cases:
            run_folder.refuse_links(case.run_dir, self.folder)
            run_folder.refuse_foreign(case.run_dir)
            run_folder.refuse_irregular(case.run_dir)
        before = read_json(self.folder / RESULT)
        if before.get("asked") == self.options.of_the_result and not before.get("complete"):
            known = ((case, take_over(case, self.options.clock)) for case in self.cases)
            self.found = {case: verdict for case, verdict in known if verdict}
        for case in self.due:
            run_folder.discard(case.run_dir)
        self.note(result, complete=False)
        write_junit_of_kill(self.folder / RunFile.JUNIT, self.cases, self.options.clock)

    @property
    def due(self) -> list[Case]:
        """The cases without a verdict."""
        return [case for case in self.cases if case not in self.found]

    def run(self, processes: int, progress: Progress, signals: EndingSignals) -> BaseException | None:
        """Run the cases that are due; return the interruption if there was one."""
        due, number = self.due, len(self.cases)
        progress(len(self.found) / number, f"running {len(due)} scenarios or seeds of {number}")
        interruption: BaseException | None = None
        try:
            with closing(run_cases(due, self.options, processes)) as coming:
                for case, verdict in coming:
                    self.found[case] = verdict
                    done = len(self.found)
                    seed = f", seed {case.seed}" if case.one_of_many else ""
                    progress(done / number, f"{done}/{number} {case.scenario.name}{seed}")
        except (Interrupted, KeyboardInterrupt) as error:
            interruption = error
            signals.raises = False
            clock = self.options.clock
            for case in self.due:
                self.found[case] = take_over(case, clock) or discard_not_run(case, clock, reason_of(error))
        except Exception:
            if not self.found:
                self.withdraw()
            raise
        signals.raises = False
        return interruption

    def withdraw(self) -> None:
        """Remove the files of a suite in which nothing ran, and its folder if it is then empty."""
        for name in run_folder.MADE_BY_A_SUITE:
            (self.folder / name).unlink(missing_ok=True)
        with suppress(OSError):  # it holds other files
            self.folder.rmdir()

    def merge(self, scenarios: Sequence[Scenario]) -> list[ScenarioVerdict]:
        """The verdict on each scenario from those of its seeds."""
        by_scenario: dict[str, dict[int, RunVerdict]] = {}
        for case in self.cases:
            by_scenario.setdefault(case.scenario.name, {})[case.seed] = self.found[case]
        return [merge(scenario.checks, by_scenario[scenario.name]) for scenario in scenarios]

    def publish(self, ordered: Sequence[ScenarioVerdict], result: Mapping[str, Any]) -> None:
        """Write the JUnit file and the page."""
        write_anew(self.folder / RunFile.JUNIT, junit_document(ordered))
        traced, changed = result["requirements"], result["changed"]
        write_suite_report(self.folder / PAGE, ordered, traced, result["changes"], changed)

    def note(self, result: Mapping[str, Any], complete: bool) -> None:
        """Write suite.json, which names folders and pages relative to the suite's folder."""
        names = {key: result[key] and Path(result[key]).name for key in ("junit", "report")}
        scenarios = [
            {**one, "out": Path(one["out"]).relative_to(self.folder).as_posix()}
            for one in result["scenarios"]
        ]
        marks = {formats.KEY: formats.SUITE, "asked": self.options.of_the_result, "complete": complete}
        run_folder.write_note(self.folder / RESULT, {**result, **names, "scenarios": scenarios, **marks})


def run_suite(
    chosen: Chosen,
    options: RunOptions,
    out_dir: Path | None,
    seeds: Sequence[int],
    progress: Progress,
    processes: int = PROCESSES,
    baseline: Baseline | None = None,
) -> dict[str, Any]:
    """Run scenarios and write junit.xml, index.html and suite.json beside their folders.

    Returns the result that `--json` prints and suite.json holds. An interrupted suite keeps its finished
    runs; the next suite in the same folder continues from there. `baseline`: another suite, with which this
    one is compared.
    """
    prepare(options)
    scenarios, left_out = scenarios_for(chosen.names, options.clock, chosen.settings, chosen.parameter_files)
    result: dict[str, Any] = {
        "scenarios": [],
        "passed": None,
        "verdict": Verdict.NOT_JUDGED.value,
        "clock": options.clock,
        "bus": None,
        "firmware": options.firmware,
        "seeds": list(seeds),
        "left_out": left_out,
        "wall_s": 0.0,
        "junit": None,
        "report": None,
        "failures": failures_of([]).as_json(),
        "requirements": trace([]),
        "changed": [] if not scenarios else list(scenarios[0].changes),
        "changes": None,
        "only_in_baseline": None,
    }
    if not scenarios:
        return result
    started = perf_counter()
    with run_folder.claimed("suite", out_dir, RESULT) as folder, ending_signals() as signals:
        suite = Suite(folder, options, cases_of(scenarios, seeds, folder))
        suite.resume(result)
        interruption = suite.run(processes, progress, signals)
        ordered = suite.merge(scenarios)
        of_suite = worst(verdict.verdict for verdict in ordered)
        result |= {
            "scenarios": [verdict.summary() for verdict in ordered],
            "passed": of_suite.passed,
            "verdict": of_suite.value,
            "bus": ordered[0].figures.bus,
            "wall_s": perf_counter() - started,
            "junit": str(folder / RunFile.JUNIT),
            "report": str(folder / PAGE),
            "failures": failures_of(ordered).as_json(),
            "requirements": trace(ordered),
        }
        if baseline is not None:
            result["changes"] = changes(baseline.suite, result, baseline.tolerances)
            result["only_in_baseline"] = find_only_in(baseline.suite, result)
        suite.publish(ordered, result)
        if interruption is None and signals.came:  # all runs are kept and not repeated
            interruption = Interrupted(signals.came[0])
        suite.note(result, complete=interruption is None)
    if interruption is not None:
        raise interruption
    return result
