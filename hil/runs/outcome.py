"""The end of a run, as stored in outcome.json."""

from dataclasses import dataclass, field
from typing import Any


@dataclass
class Outcome:
    """What a run reports of itself; it is filled during the run."""

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
