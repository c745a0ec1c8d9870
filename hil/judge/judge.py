"""The verdict on a run from its traces: figures, checks, and the reasons to fail it or not to judge it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from firmware_py.shell.builds import is_build
from hil.figures.figures import figures_from, refusals_of
from hil.figures.moments import moment_of
from hil.judge.evaluation import evaluate
from hil.judge.verdict import FaultEffect, RunVerdict, Verdict
from hil.record import provenance
from hil.record.run_faults import faults_of
from hil.record.run_traces import RunTraces
from hil.scenario.checks import checks_of
from hil.timing.clock import IMPORTED


def judge(traces: RunTraces, folder: Path) -> RunVerdict:
    """The verdict on a run from its traces; `folder`: the run's folder, which the verdict names."""
    figures = figures_from(traces)
    reasons = tuple(reasons_of(traces))
    checks = tuple(evaluate(checks_of(traces.scenario), figures, traces))
    failures_s = [moment_of(one.name, traces, figures) for one in checks if one.verdict is Verdict.FAILED]
    return RunVerdict(
        figures=figures,
        checks=checks,
        reasons=reasons,
        doubts=() if reasons else tuple(doubts_of(traces)),
        faults=tuple(fault_effects(traces)),
        first_failure_s=min(failures_s, default=None),
        provenance={key: traces.run.get(key) for key in provenance.KEYS},
        folder=folder,
    )


def reasons_of(traces: RunTraces) -> list[str]:
    """The reasons why this run fails regardless of its checks, one sentence each."""
    reasons = [*traces.outcome.get("reasons", []), *traces.damage]
    if not traces.outcome:
        reasons.append("the run was cut short: it left no outcome.json")
    was_cut_by_host = traces.outcome.get("cut_s") is not None
    if traces.run.get("clock") == IMPORTED or was_cut_by_host:
        return reasons
    nodes = {"plant": traces.plant, "firmware": traces.firmware}
    is_own = not is_build(traces.run.get("firmware", "compiled"))
    remark = ": an own controller's is made from the FirmwareHeartbeat that it sends" if is_own else ""
    return reasons + [
        f"{name} left no readable trace{remark if name == 'firmware' else ''}"
        for name, records in nodes.items()
        if len(records) == 0
    ]


def fault_effects(traces: RunTraces) -> list[FaultEffect]:
    """The effect of each fault of the script, in its order; unknown for runs that did not count."""
    return [FaultEffect(fault.kind, fault.from_s, fault.acted) for fault in faults_of(traces.run)]


def doubts_of(traces: RunTraces) -> list[str]:
    """The reasons why this run is not judged, one sentence each."""
    idle = [
        f"the injected fault {effect.kind!r} at {effect.at_s:g} s acted on nothing, and so shows nothing"
        for effect in fault_effects(traces)
        if effect.acted_on == 0
    ]
    return [*traces.outcome.get("not_judged", []), *doubt_refused_frames(traces.run), *idle]


def doubt_refused_frames(run: Mapping[str, Any]) -> list[str]:
    """Frames that the bus refused: the run's commands and readings were not those of its script and nodes."""
    refusals = [one for one in refusals_of(run) if one.get("first_unsent_ns") is not None]
    if not refusals:
        return []
    first = min(refusals, key=lambda one: int(one["first_unsent_ns"]))
    frames, at_s = sum(one["unsent"] for one in refusals), (first["first_unsent_ns"] - run["t0_ns"]) * 1e-9
    return [
        f"the bus refused {frames} frames of the run's nodes, the first at {at_s:.2f} s: {first['refusal']}"
    ]
