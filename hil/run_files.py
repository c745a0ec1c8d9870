"""The files of a run folder, by their names: the one place that knows them."""

from enum import StrEnum

from hil.roster import processes_of_a_run, trace_names

TRACES = ("plant", "firmware", "impacts", "operator", "bus_errors")
"""The traces of a run, by the names of the fields of `RunTraces`."""
OTHER_TRACES = tuple(name for name in trace_names() if name not in TRACES)
"""The traces of nodes whose records are logged, and neither judged nor drawn."""
OWN = "own"
"""Trace of a user's controller, and prefix of its signals."""


class RunFile(StrEnum):
    """A file of a run folder, beside the traces and the errors of each process."""

    NOTE = "run.json"
    """Scenario, clock, bus, seed, versions and start of the run."""
    SCENARIO = "scenario.toml"
    """The scenario as run."""
    CAN_LOG = "can.log"
    """The frames on the bus, in candump's format."""
    PROCESSES = "processes.json"
    OUTCOME = "outcome.json"
    """The end of the run: elapsed time, a bare loop's overruns, and reasons for failure."""
    VERDICT = "verdict.json"
    LOG = "run.rrd"
    JUNIT = "junit.xml"
    REPORT = "report.html"
    RESERVE = "reserve"
    """Disk space reserved for the files of the verdict."""


def trace_file(name: str) -> str:
    """The file of a trace."""
    return f"{name}.trace"


TRACE_FILES = tuple(map(trace_file, (*TRACES, *OTHER_TRACES, OWN)))
WRITTEN_WHOLE = (
    *TRACE_FILES,
    *(RunFile.LOG, RunFile.NOTE, RunFile.OUTCOME, RunFile.PROCESSES, RunFile.VERDICT),
)
MADE_BY_A_RUN = (
    *RunFile,
    *TRACE_FILES,
    *(f"{name}.new" for name in WRITTEN_WHOLE),
    *(f"{name}.log" for name in (*processes_of_a_run(), "baseline", "recorder", "live")),
)
"""Every file that a run may write; the suffix `.new` marks unfinished files."""
