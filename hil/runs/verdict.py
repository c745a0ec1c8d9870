"""The verdict on a run that has ended, from its folder.

run.json       scenario, clock, bus, seed, versions and start of the run
scenario.toml  the scenario as run
*.trace        each process's signals at each tick; can.log, the frames on the bus
outcome.json   end of the run: elapsed time, a bare loop's overruns, and reasons for failure
run.rrd, verdict.json, junit.xml, report.html   made from the above by `finish`, repeatedly if required
"""

from pathlib import Path

from firmware_py.shell.builds import is_build
from hil.bus.base import OWN_BUSES
from hil.judge.judge import judge
from hil.judge.verdict import KILLED, RunVerdict, failed_for
from hil.judge.verdict_files import document_of, write_verdict
from hil.record import run_folder
from hil.record.run_faults import with_effects
from hil.record.run_traces import RunTraces, read_run, read_scenario
from hil.record.traces import trace
from hil.run_files import RunFile
from hil.runs.job import Outcome
from hil.show.report.pages import write_report
from hil.show.rerun_log import write_log

NOT_SHARED = (*OWN_BUSES, "in-process")
"""Buses, by their names in run.json, that are made for one run alone."""


def close(run_dir: Path, outcome: Outcome, only_if_failed: bool = False) -> RunVerdict:
    """Collect the files of a run that has ended, and judge it."""
    run_folder.free_reserve(run_dir)
    trace.bring_home(run_dir)
    note = run_folder.read_note(run_dir / RunFile.NOTE)
    run_folder.note(run_dir, faults=with_effects(note, outcome.faults_acted))
    can_log, bus = run_dir / RunFile.CAN_LOG, note.get("bus")
    if "firmware" in note and not is_build(note["firmware"]):
        from hil.record.sent_decisions import write_firmware_trace  # what decodes frames is loaded if needed

        write_firmware_trace(run_dir, note["period_s"], "gait" in read_scenario(run_dir).get("scene", {}))
    if can_log.exists() and bus not in NOT_SHARED:
        from hil.record.bus_reconstruction import doubt_two_firmwares
        from hil.record.candump import StoredBus

        outcome.not_judged += doubt_two_firmwares(StoredBus(can_log))
    stored = {key: value for key, value in vars(outcome).items() if key != "faults_acted"}
    run_folder.write_json(run_dir / RunFile.OUTCOME, stored)
    return finish(run_dir, only_if_failed)


def finish(run_dir: Path, only_if_failed: bool = False) -> RunVerdict:
    """Judge the run in `run_dir`, also an interrupted one, and write its log, report and verdict.

    `only_if_failed`: a run that has passed keeps only its verdict, `run.json` and its scenario.
    """
    traces = read_run(run_dir)
    verdict = judge(traces, run_dir)
    if only_if_failed and verdict.passed:
        run_folder.clear(run_dir, keep=(RunFile.NOTE, RunFile.SCENARIO))
        run_folder.write_json(run_dir / RunFile.VERDICT, document_of(verdict))
    else:
        publish(run_dir, traces, verdict)
    return verdict


def publish(run_dir: Path, traces: RunTraces, verdict: RunVerdict) -> None:
    """Write the views of a verdict: log, report, JUnit and JSON.

    Until log and report are complete, the verdict names a kill as the reason.
    """
    write_verdict(failed_for(verdict, [*verdict.reasons, KILLED]))
    write_log(run_dir / RunFile.LOG, traces, verdict)
    write_report(run_dir / RunFile.REPORT, traces, verdict)
    write_verdict(verdict)
