"""The outcome of one trial; small enough to send between processes."""

from dataclasses import dataclass, field


@dataclass
class Outcome:
    """Outcome of one trial.

    `why` is empty for a success. An ineligible trial is not counted; its `why` gives the reason. `metrics`
    are one value per trial by name, `counts` (of hits, misses, …) are summed over trials, `samples` are
    pooled.
    """

    trial: int
    cell: int
    eligible: bool = True
    why: str = ""
    simulated_s: float = 0.0
    compute_s: float = 0.0
    metrics: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    samples: dict[str, list[float]] = field(default_factory=dict)

    def leave_out(self, why: str) -> None:
        """Mark the trial as ineligible."""
        self.eligible, self.why = False, why
