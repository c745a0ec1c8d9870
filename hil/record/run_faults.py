"""The faults of a run, as run.json records them: where each acted, when, and on what."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

EARLIER_VERSION = (
    "run.json does not say when the scenario's faults acted, because an earlier version made it; run the "
    "scenario again"
)


class RunFault(NamedTuple):
    """One fault of the script, in the script's order."""

    kind: str
    node: str | None
    """The node or process in which it acts; None for one on the bus."""
    silences: bool
    """Whether it keeps its process from running."""
    from_s: float
    to_s: float | None
    """None for a fault that does not end."""
    text: str
    """Its kind and keys, without its times."""
    acted: int | None = None
    """The number of frames, readings, ticks or starts that it acted on; None if unknown."""
    frames: Sequence[str] = ()
    """The frames that it is limited to; none for a fault of all frames, or of something else."""

    @property
    def end_s(self) -> float:
        """The end; infinite for a fault that does not end."""
        return math.inf if self.to_s is None else self.to_s


def faults_of(run: Mapping[str, Any]) -> list[RunFault]:
    """The faults in the content of run.json; none for a run of an earlier version.

    >>> record = RunFault("killed", "firmware", True, 6.0, None, "killed (process firmware)")._asdict()
    >>> [fault] = faults_of({"faults": [record]})
    >>> fault.from_s, fault.end_s, fault.acted
    (6.0, inf, None)
    """
    return [RunFault(**one) for one in run.get("faults", [])]


def with_effects(run: Mapping[str, Any], acted: Sequence[int | None]) -> list[dict[str, Any]]:
    """The faults of run.json with the numbers of their effects, in the script's order; none: unknown."""
    faults = faults_of(run)
    counts = acted or [None] * len(faults)
    return [fault._replace(acted=count)._asdict() for fault, count in zip(faults, counts, strict=True)]


def lacks_faults(run: Mapping[str, Any], scenario: Mapping[str, Any]) -> bool:
    """Whether the scenario has faults of which run.json says nothing."""
    return "faults" not in run and bool(scenario.get("script", {}).get("faults"))
