"""The reasons for which a run fails regardless of its checks."""

from hil.record.run_traces import RunTraces

IMPORTED = "imported"
"""The clock of a log that came from a real bench: it has no truth and no scenario."""


def reasons_of(traces: RunTraces) -> list[str]:
    """Why this is no proper run, whatever its checks say."""
    reasons = [*traces.outcome.get("reasons", []), *traces.damage]
    if not traces.outcome:
        reasons.append("the run was cut short: it left no outcome.json")
    if traces.run.get("clock") == IMPORTED:
        return reasons
    nodes = {"plant": traces.plant, "firmware": traces.firmware}
    return reasons + [f"{name} left no trace" for name, records in nodes.items() if len(records) == 0]
