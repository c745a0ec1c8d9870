"""A run before it begins and after it has ended: its options, its job in lockstep, and its outcome."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from firmware_py.shell.node import MakeNode
from hil.scenario.scenario import Scenario
from hil.timing.clock import ClockName, TimeName

Progress: TypeAlias = Callable[[float, str], None]
"""Called with the completed share of the run, 0…1, and the present activity."""
Kept: TypeAlias = Mapping[str, Sequence[str] | None]
"""The columns that are kept of each trace, None for all; other traces are not kept, nor are the frames."""


def silent(_: float, __: str) -> None:
    """Show no progress."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """The options of a run, and of each run of a suite."""

    clock: ClockName = "real"
    time: TimeName = "held"
    """Whether real time is held while a node is late; on a bus that is not the run's own it never is."""
    bus: str = "auto"
    firmware: str = "compiled"
    """A build of the firmware (`firmware_py.shell.builds.Build`), a user's controller as `FILE.py:FUNCTION`,
    or `none` where another program on the bus is the controller.
    """
    viewer: str | None = None
    """URL of an open viewer, or `window`, which shows the run while it runs in real time."""
    keep_traces: bool = True
    """If False, the traces of a run that has passed are removed; its log remains."""
    only_if_failed: bool = False
    """Whether a run that has passed leaves only its verdict and its scenario."""
    of_a_suite: bool = False
    """Whether an interrupted run is not judged, since its suite runs it again."""

    @property
    def of_the_result(self) -> dict[str, str]:
        """The options on which the result of a suite depends, as stored in suite.json."""
        return {"clock": self.clock, "time": self.time, "bus": self.bus, "firmware": self.firmware}


@dataclass
class Outcome:
    """What a run reports of itself, as stored in outcome.json; it is filled during the run."""

    wall_s: float = 0.0
    """Elapsed time from the start to the end of the loops."""
    reasons: list[str] = field(default_factory=list)
    """Reasons why the run fails regardless of its checks, one sentence each."""
    faults_acted: list[int | None] = field(default_factory=list)
    """What each fault of the script acted on: frames, readings, ticks or starts; kept in run.json."""
    not_judged: list[str] = field(default_factory=list)
    """Reasons why the run proves nothing, one sentence each; it is not judged unless it fails."""
    held_s: float | None = None
    """Time for which the host held the run up; None where time was not held."""
    own_late_s: float | None = None
    """Time for which nodes held the run up by their own work."""
    holds: list[dict[str, Any]] = field(default_factory=list)
    """The holds, as of `hil.timing.pacemaker.Hold`."""
    cut_s: float | None = None
    """Time at which a run was ended because a process, `cut_by`, was held up for too long."""
    cut_by: str | None = None
    baseline_overruns: int | None = None
    memory_growth_mb: dict[str, float] = field(default_factory=dict)
    """Growth by process after it has settled, in runs that are long enough."""
    memory_watched_s: float = 0.0
    """Time over which the growth was measured."""


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
