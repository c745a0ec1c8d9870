"""The bench: buses, clocks and loops, the plant's CAN node, scenarios, checks, traces, recorder, report.

From Python: `hil.run(scenario)` and `hil.open_run(folder)` return a `hil.Run`. These names are imported at
first use, so that a node's process does not load the log and the report.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hil.runs.library import run
    from hil.runs.recorded_run import Run, open_run

__all__ = ["Run", "open_run", "run"]


def __getattr__(name: str) -> Any:
    if name == "run":
        from hil.runs.library import run

        return run
    if name in ("Run", "open_run"):
        from hil.runs import recorded_run

        return getattr(recorded_run, name)
    raise AttributeError(f"module 'hil' has no attribute {name!r}")
