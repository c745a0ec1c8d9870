"""The outcome of one trial; small enough to send between processes."""

from dataclasses import dataclass, field


@dataclass
class Outcome:
    """`why` is empty for a success. An ineligible trial is not counted; its `why` says what is missing.

    `metrics` are numbers by name, `counts` are added up over trials (matched, missed and the like), `samples`
    are pooled.
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
