"""Makes the verdict from a run folder.

run.json       scenario, clock, bus, seed, versions and start of the run
scenario.toml  the scenario as run
*.trace        each process's signals at each tick; can.log, the frames on the bus
losses.json    intervals in which the recorder lost frames; absent without a loss
outcome.json   end of the run: elapsed time, a bare loop's overruns, and reasons for failure
run.rrd, verdict.json, junit.xml, report.html   made from the above by `finish`, repeatedly if required
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hil.judge import junit
from hil.judge.checks import CheckResult, checks_of, evaluate
from hil.judge.figures.figures import LONGEST_HOLD_MS, figures_from
from hil.judge.figures.records import Figures, incomplete
from hil.judge.reasons import reasons_of
from hil.record import provenance
from hil.record.run_folder import RUN_NOTE, VERDICT, clear, write_json
from hil.record.run_traces import RunTraces, read_json, read_run, read_scenario
from hil.show.highlights import marks
from hil.show.report.pages import write_report
from hil.show.rerun_log import LOG_NAME, write_log

KILLED = "the run is not finished, or its process was killed before the verdict"


def verdict_of(
    figures: Mapping[str, Any], results: Sequence[CheckResult], reasons: Sequence[str], out: Path
) -> dict[str, Any]:
    """The verdict as it is written and printed: all figures, the checks, and whether the run has passed.

    `passed` is None without checks and without another reason to fail.
    """
    nothing_checked = not results and not reasons
    passed = None if nothing_checked else not reasons and all(result.passed for result in results)
    return {
        **figures,
        "checks": [asdict(result) for result in results],
        "incomplete": incomplete(figures),
        "reasons": list(reasons),
        "passed": passed,
        "out": str(out),
    }


def host_stall(traces: RunTraces, figures: Figures) -> str | None:
    """A sentence on the longest stall of a loop caused by the machine; None without a relevant stall.

    Only runs in real time are examined, and only if the scenario itself has no pause or restart.
    """
    faults = traces.scenario.get("script", {}).get("faults", [])
    if figures.clock != "real" or any(fault["kind"] in ("paused", "restarted") for fault in faults):
        return None
    loops = {"plant": figures.loops.plant, "firmware": figures.loops.firmware}
    name = max(loops, key=lambda one: loops[one].longest_hold_ms or 0.0)
    held_ms, at_s = loops[name].longest_hold_ms, loops[name].longest_hold_at_s
    if held_ms is None or at_s is None or held_ms < LONGEST_HOLD_MS:
        return None
    return (
        f"host stall: the machine held up the {name}'s loop for {held_ms:.0f} ms at {at_s:.2f} s; "
        "the checks that failed may fail for that alone"
    )


def judge(traces: RunTraces, figures: Figures, out: Path) -> tuple[dict[str, Any], list[CheckResult]]:
    """The verdict on a run from its traces and figures, and the results of its checks."""
    content = figures.as_json() | {"provenance": {key: traces.run.get(key) for key in provenance.KEYS}}
    results = evaluate(checks_of(traces.scenario), content, traces)
    failed = not all(result.passed for result in results)
    content["host_stall"] = host_stall(traces, figures) if failed else None
    content["first_failure_s"] = min((mark.t_s for mark in marks(results, traces, figures)), default=None)
    return verdict_of(content, results, reasons_of(traces), out), results


def finish(run_dir: Path, only_if_failed: bool = False) -> dict[str, Any]:
    """Judge the run in `run_dir`, also an interrupted one, and write its log, report and verdict.

    Until log and report are complete, the verdict names a kill as the reason.
    `only_if_failed`: a run that has passed keeps only its verdict and `run.json`.
    """
    traces = read_run(run_dir)
    figures = figures_from(traces)
    verdict, results = judge(traces, figures, run_dir)
    if only_if_failed and verdict["passed"]:
        clear(run_dir, keep=(RUN_NOTE,))
        write_json(run_dir / VERDICT, verdict)
        return verdict
    write(run_dir, {**verdict, "reasons": [*verdict["reasons"], KILLED], "passed": False})
    write_log(run_dir / LOG_NAME, traces, figures, results)
    write_report(run_dir / "report.html", traces, figures, verdict)
    write(run_dir, verdict)
    return verdict


def write(run_dir: Path, verdict: Mapping[str, Any]) -> None:
    """Write verdict.json and junit.xml."""
    write_json(run_dir / VERDICT, verdict)
    (run_dir / "junit.xml").write_text(junit.document([verdict]), encoding="utf-8")


def unjudged(run: Mapping[str, Any], scenario: Mapping[str, Any], reason: str, out: Path) -> dict[str, Any]:
    """The failed verdict on a run without records; `run` is the content of its `run.json`."""
    nothing = RunTraces(run=run, scenario=scenario)
    verdict, _ = judge(nothing, figures_from(nothing), out)
    return {**verdict, "reasons": [reason], "passed": False}


def prejudge(run_dir: Path, reason: str) -> None:
    """Write a failed verdict for a run that has not begun; it remains if no other can be written."""
    run = read_json(run_dir / RUN_NOTE)
    write(run_dir, unjudged(run, read_scenario(run_dir), reason, run_dir))


def amend(run_dir: Path, reasons: Sequence[str]) -> dict[str, Any]:
    """Change the verdict in `run_dir` to failed for these reasons, with the same figures."""
    verdict = {**read_json(run_dir / VERDICT), "reasons": list(reasons), "passed": False}
    write(run_dir, verdict)
    return verdict
