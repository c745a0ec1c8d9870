"""The reasons for which a run fails, or is not judged, regardless of its checks."""

from hil.judge.verdict import IMPORTED, FaultEffect
from hil.record.run_traces import RunTraces


def reasons_of(traces: RunTraces) -> list[str]:
    """The reasons why this run fails regardless of its checks, one sentence each."""
    reasons = [*traces.outcome.get("reasons", []), *traces.damage]
    if not traces.outcome:
        reasons.append("the run was cut short: it left no outcome.json")
    was_cut_by_host = traces.outcome.get("cut_s") is not None
    if traces.run.get("clock") == IMPORTED or was_cut_by_host:
        return reasons
    nodes = {"plant": traces.plant, "firmware": traces.firmware}
    return reasons + [f"{name} left no trace" for name, records in nodes.items() if len(records) == 0]


def fault_effects(traces: RunTraces) -> list[FaultEffect]:
    """The effect of each fault of the script, in its order; unknown for runs that did not count."""
    faults = traces.scenario.get("script", {}).get("faults", [])
    counts = traces.outcome.get("faults_acted") or [None] * len(faults)
    return [
        FaultEffect(fault["kind"], float(fault["at_s"]), count)
        for fault, count in zip(faults, counts, strict=True)
    ]


def doubts_of(traces: RunTraces) -> list[str]:
    """The reasons why this run is not judged, one sentence each."""
    idle = [
        f"the fault {effect.kind!r} at {effect.at_s:g} s acted on nothing, so the run shows nothing of it"
        for effect in fault_effects(traces)
        if effect.acted_on == 0
    ]
    return [*traces.outcome.get("not_judged", []), *idle]
