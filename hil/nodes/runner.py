"""Runners connect the bench's nodes to bus and trace; a loop calls them in each tick, on every clock."""

from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import ClassVar, NamedTuple, Self

from firmware_py.interface.frame import Frame
from firmware_py.shell.node import MakeNode
from hil.faults.fault import Fault
from hil.faults.line import FaultyBus
from hil.record.traces.trace import Fields, OpenTrace, TraceWriter, no_trace
from hil.run_files import trace_file
from hil.scenario.scenario import Scenario

WARM_TICKS = 300
"""Ticks in which a node runs all its code before its clock starts: compiled kernels, imports, caches."""


class Pace(NamedTuple):
    """Period and duration of the nodes' ticks; a duration of None: until they are stopped."""

    period_s: float
    duration_s: float | None
    is_timed: bool = True
    """Whether ticks have deadlines; a trace's pages must then be in memory before the loop begins."""
    first_tick: int = 0
    """Above 0 for a process that replaces another and continues its traces."""

    @property
    def ticks(self) -> int | None:
        """Ticks of the whole run."""
        return None if self.duration_s is None else round(self.duration_s / self.period_s)

    @property
    def expected_records(self) -> int:
        """Records for which a trace needs room at once; 0 if it continues another, or has no end."""
        return 0 if self.first_tick > 0 else self.ticks or 0


class Making(NamedTuple):
    """What a node's runner is made from."""

    scenario: Scenario
    seed: int
    pace: Pace
    bus: FaultyBus
    faults: Sequence[Fault]
    """The script's faults for this node."""
    traces: OpenTrace = no_trace
    firmware: str | MakeNode = "compiled"
    """The build of the firmware, or a user's controller as `FILE.py:FUNCTION`, or what makes its node."""
    say: Callable[[str], object] = lambda _: None
    """Receives what the node reports to a person."""


def traces_in(folder: Path | None, pace: Pace) -> OpenTrace:
    """What opens the traces of a process in `folder`; a process that replaces another continues them."""
    if folder is None:
        return no_trace

    def opened(name: str, fields: Fields, is_ticked: bool = False) -> TraceWriter:
        expected = pace.expected_records if is_ticked else 0
        path = folder / trace_file(name)
        return TraceWriter(path, fields, expected, pace.first_tick > 0, pace.is_timed)

    return opened


class NodeRunner:
    """What the runner of a node that has a process of its own does in addition to a `Runner`."""

    accepted_ids: ClassVar[Collection[int]] = ()
    """The identifiers that it receives where the bus can filter."""

    @classmethod
    def make(cls, making: Making) -> Self:
        """The runner of a run."""
        raise NotImplementedError

    @staticmethod
    def warm(scenario: Scenario, firmware: str) -> None:
        """Run all code of the node once, before its process joins the bus."""

    def last_frames(self) -> list[Frame]:
        """The frames that the node sends last, when it ends."""
        return []

    @property
    def lost_records(self) -> int:
        """Records for which the disk had no room."""
        return 0
