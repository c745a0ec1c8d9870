"""Counts what each fault of a script has acted on: frames, readings, ticks or starts of a process."""

from collections.abc import Iterable, Sequence
from typing import overload

from hil.faults.fault import Fault

FAULTS_ACTED = "faults_acted"
"""Key of a node's final report: the number of effects of each fault of the script."""


class CountedFaults(Sequence[Fault]):
    """The faults of a script, or some of them, with the counts of the whole script.

    Nodes and buses that make the faults act receive this sequence and report each effect to it.
    """

    def __init__(self, faults: Sequence[Fault], whole: "CountedFaults | None" = None) -> None:
        """`whole`: the faults of the whole script, if `faults` are some of them."""
        self._faults = tuple(faults)
        self._places: dict[int, int] = (
            {id(fault): place for place, fault in enumerate(faults)} if whole is None else whole._places
        )
        self.counts: list[int] = [0] * len(self._faults) if whole is None else whole.counts
        """The number of effects of each fault of the whole script so far."""

    @overload
    def __getitem__(self, place: int) -> Fault: ...
    @overload
    def __getitem__(self, place: slice) -> tuple[Fault, ...]: ...
    def __getitem__(self, place: int | slice) -> Fault | tuple[Fault, ...]:
        return self._faults[place]

    def __len__(self) -> int:
        return len(self._faults)

    def acted(self, fault: Fault, times: int = 1) -> None:
        """Count that a fault of the script has acted on this many frames, readings, ticks or starts."""
        self.counts[self._places[id(fault)]] += times

    def some(self, faults: Iterable[Fault]) -> "CountedFaults":
        """Some of these faults, which share the counts."""
        return CountedFaults(tuple(faults), self)


def counted(faults: Sequence[Fault]) -> CountedFaults:
    """The faults with their counts; they themselves if they are counted already."""
    return faults if isinstance(faults, CountedFaults) else CountedFaults(faults)
