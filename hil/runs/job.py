"""A job: all that decides the result of a run in lockstep, and where the run reports how it goes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from firmware_py.shell.node import MakeNode
from hil.runs.outcome import Outcome
from hil.scenario.scenario import Scenario

Progress: TypeAlias = Callable[[float, str], None]
"""Called with the completed share of the run, 0…1, and the present activity."""
Kept: TypeAlias = Mapping[str, Sequence[str]]
"""The columns that are kept of each trace; other traces are not kept, nor are the frames."""


def silent(_: float, __: str) -> None:
    """Show no progress."""


@dataclass(frozen=True)
class Job:
    """A run in lockstep."""

    scenario: Scenario
    seed: int
    firmware: str | MakeNode = "compiled"
    """A build, a user's controller as `FILE.py:FUNCTION`, or a function that makes the firmware's node."""
    folder: Path | None = None
    """The run folder; None if the run leaves no files."""
    outcome: Outcome = field(default_factory=Outcome)
    progress: Progress = silent
    kept: Kept | None = None
    """None: all columns of all traces, and the frames."""
