"""The reasons for which a run fails regardless of its checks."""

from hil.record.run_traces import RunTraces

IMPORTED = "imported"
"""Clock name of a log imported from a real bench, which has no truth and no scenario."""


def reasons_of(traces: RunTraces) -> list[str]:
    """The reasons why this run fails regardless of its checks, one sentence each."""
    reasons = [*traces.outcome.get("reasons", []), *traces.damage]
    if not traces.outcome:
        reasons.append("the run was cut short: it left no outcome.json")
    if traces.run.get("clock") == IMPORTED:
        return reasons
    nodes = {"plant": traces.plant, "firmware": traces.firmware}
    return reasons + [f"{name} left no trace" for name, records in nodes.items() if len(records) == 0]
