"""Makes the verdict from a run folder.

run.json       scenario, clock, bus, seed, versions and start of the run
scenario.toml  the scenario as run
*.trace        each process's signals at each tick; can.log, the frames on the bus
outcome.json   end of the run: elapsed time, a bare loop's overruns, and reasons for failure
run.rrd, verdict.json, junit.xml, report.html   made from the above by `finish`, repeatedly if required
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hil.judge import junit
from hil.judge.judge import judge
from hil.judge.verdict import RunVerdict
from hil.record.new_file import write_anew
from hil.record.run_folder import clear, write_json
from hil.record.run_traces import RunTraces, read_json, read_run, read_scenario
from hil.run_files import RunFile

KILLED = "the run is not finished, or its process was killed before the verdict"


def finish(run_dir: Path, only_if_failed: bool = False) -> RunVerdict:
    """Judge the run in `run_dir`, also an interrupted one, and write its log, report and verdict.

    `only_if_failed`: a run that has passed keeps only its verdict, `run.json` and its scenario.
    """
    traces = read_run(run_dir)
    verdict = judge(traces, run_dir)
    if only_if_failed and verdict.passed:
        clear(run_dir, keep=(RunFile.NOTE, RunFile.SCENARIO))
        write_json(run_dir / RunFile.VERDICT, document_of(verdict))
    else:
        publish(run_dir, traces, verdict)
    return verdict


def publish(run_dir: Path, traces: RunTraces, verdict: RunVerdict) -> None:
    """Write the views of a verdict: log, report, JUnit and JSON.

    Until log and report are complete, the verdict names a kill as the reason.
    """
    from hil.show.report.pages import write_report  # loaded after the last tick
    from hil.show.rerun_log import write_log

    write(failed_for(verdict, [*verdict.reasons, KILLED]))
    write_log(run_dir / RunFile.LOG, traces, verdict)
    write_report(run_dir / RunFile.REPORT, traces, verdict)
    write(verdict)


def failed_for(verdict: RunVerdict, reasons: Sequence[str]) -> RunVerdict:
    """The verdict with the same figures that fails for these reasons."""
    return replace(verdict, reasons=tuple(reasons), doubts=())


def document_of(verdict: RunVerdict) -> dict[str, Any]:
    """The content of verdict.json, which names the run's folder without its place on this machine."""
    return {**verdict.as_json(), "out": verdict.folder.name}


def write(verdict: RunVerdict) -> None:
    """Write verdict.json and junit.xml into the run's folder."""
    write_json(verdict.folder / RunFile.VERDICT, document_of(verdict))
    write_anew(verdict.folder / RunFile.JUNIT, junit.document([verdict]))


def without_records(
    run: Mapping[str, Any], scenario: Mapping[str, Any], reason: str, folder: Path
) -> RunVerdict:
    """The failed verdict on a run without records; `run` is the content of its `run.json`."""
    return failed_for(judge(RunTraces(run=run, scenario=scenario), folder), [reason])


def prejudge(run_dir: Path, reason: str) -> RunVerdict:
    """Write a failed verdict for a run that has not begun; it remains if no other can be written."""
    run = read_json(run_dir / RunFile.NOTE)
    verdict = without_records(run, read_scenario(run_dir), reason, run_dir)
    write(verdict)
    return verdict
