"""Bus faults at a node's connection, in real time and in lockstep: a wrapper around the node's bus.

Faults alter frames where they leave their sender. Frames of a foreign node are sent through the plant's
connection, and the plant receives them too.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from firmware_py.interface.frame import Frame
from hil.bus.base import MAX_BURST, NodeBus, discard_waiting
from hil.faults.fault import Fault
from hil.faults.on_bus import LineFault, Step
from hil.roster import PLANT
from text_input import RefusalError

MOST_HELD_FRAMES = 100_000
"""Largest number of frames that a fault may hold back: a minute of one frame, and its copies."""


class TrafficError(RefusalError, ValueError):
    """Faults send or hold back too many frames; each of several may multiply the frames of the others."""


class FaultyBus:
    """One node's connection with the script's faults, if there are any; `move_to` sets the time.

    A foreign node sends what is due since the step before, at most a period ago: it stands at the plant's
    connection, and sends nothing while the plant's process is paused or ended.
    """

    def __init__(self, bus: NodeBus, node: str, faults: Sequence[Fault], seed: int, period_s: float) -> None:
        self._bus = bus
        self._node = node
        self._faults = [fault for fault in faults if isinstance(fault, LineFault)]
        self._altering, self._foreign_nodes, self._unplugging = (
            [fault for fault in self._faults if getattr(type(fault), name) is not getattr(LineFault, name)]
            for name in ("outgoing", "foreign_frames", "unplugs")
        )
        self._seed = seed
        self._period_s = period_s
        self._step = Step(0.0, 0.0)
        self._begin()

    def restart(self) -> None:
        """Begin anew, as in a process that starts: without the frames that were sent before."""
        discard_waiting(self._bus)
        self._begin()

    def _begin(self) -> None:
        for number, fault in enumerate(self._faults):
            fault.begin(np.random.default_rng([self._seed, number]))
        self._step = Step(self._step.t_s, 0.0)
        self._foreign: list[Frame] = []
        self.held_frames = 0
        """The number of frames that the faults hold back."""

    def resume(self, t_s: float, since_s: float) -> None:
        """Continue with the node's step at `t_s`; no fault had an effect between `since_s` and this step."""
        self._step = Step(t_s, since_s)

    def move_to(self, t_s: float) -> None:
        """Begin the node's step at `t_s`; frames of foreign nodes are sent first."""
        self._step = Step(t_s, self._step.t_s)
        if self._node != PLANT:
            return
        step = Step(t_s, max(self._step.since_s, t_s - self._period_s))
        foreign: list[Frame] = []
        for fault in self._foreign_nodes:
            if fault.acts(t_s) and (frames := fault.foreign_frames(step)):
                fault.count(len(frames))
                foreign += frames
        self._refuse_beyond(MAX_BURST, len(foreign), "send")
        if foreign:
            self._bus.send_all(foreign)
            self._foreign += foreign

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Send the frames that the faults let through. Raises TrafficError."""
        passed = self.let_through(frames)
        if self._passes(passed):
            self._bus.send_all(passed)

    def let_through(self, frames: Iterable[Frame]) -> list[Frame]:
        """The frames that leave the node now, if it is connected. Raises TrafficError."""
        passed = list(frames)
        all_held = 0
        for fault in self._altering:
            if fault.acts(self._step.t_s):
                passed = fault.outgoing(passed, self._step)
                held_frames = fault.held_frames
                all_held += held_frames
                self._refuse_beyond(MOST_HELD_FRAMES, held_frames, "hold back")
            elif self.held_frames:
                passed = [*fault.released(), *passed]
            self._refuse_beyond(MOST_HELD_FRAMES, len(passed), "send")
        self.held_frames = all_held
        return passed

    def receive(self) -> list[Frame]:
        """The frames of foreign nodes, then the received frames."""
        received = [*self._foreign, *self._bus.receive()]
        self._foreign = []
        return received if self._passes(received) else []

    def _passes(self, frames: Sequence[Frame]) -> bool:
        """Whether the node is connected; otherwise the frames are lost."""
        if not self._unplugging:
            return True
        t_s = self._step.t_s
        pulled = [fault for fault in self._unplugging if fault.acts(t_s) and fault.unplugs(self._node)]
        for fault in pulled:
            fault.count(len(frames))
        return not pulled

    def _refuse_beyond(self, most: int, frames: int, do: str) -> None:
        if frames > most:
            raise TrafficError(
                f"the faults {do} {frames:,} frames at {self._step.t_s:g} s; wanted {most:,} at most, let "
                "fewer of them act at a time, or lower copies, frames_a_tick, delay_s or period_s"
            )
