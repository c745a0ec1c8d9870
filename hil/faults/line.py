"""Bus faults at a node's connection, in real time and in lockstep: a wrapper around the node's bus.

Faults alter frames where they leave their sender. Frames of a foreign node are sent through the plant's
connection, and the plant receives them too.
"""

from collections import deque
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from firmware_py.interface.frame import Frame
from hil.bus.base import NodeBus
from hil.faults.counted import counted
from hil.faults.fault import Fault
from hil.faults.on_bus import Held, LineFault, Sending, Step

PLANT = "plant"


class FaultyBus:
    """One node's connection with faults; `move_to` sets the time.

    A foreign node sends what is due since the step before, at most a period ago: it stands at the plant's
    connection, and sends nothing while the plant's process is paused or ended.
    """

    def __init__(self, bus: NodeBus, node: str, faults: Sequence[Fault], seed: int, period_s: float) -> None:
        self._bus = bus
        self._node = node
        self._counts = counted(faults)
        self._faults = [fault for fault in faults if isinstance(fault, LineFault)]
        self._seed = seed
        self._period_s = period_s
        self._step = Step(0.0, 0.0)
        self.restart()

    def restart(self) -> None:
        """Begin anew, as in a process that starts: nothing is held, and noise is sampled from its start."""
        self._noise = [np.random.default_rng([self._seed, number]) for number in range(len(self._faults))]
        self._held: list[Held] = [deque() for _ in self._faults]
        self._step = Step(self._step.t_s, 0.0)
        self._foreign: list[Frame] = []

    def move_to(self, t_s: float) -> None:
        """Begin the node's step at `t_s`; frames of foreign nodes are sent first."""
        self._step = Step(t_s, self._step.t_s)
        if self._node != PLANT:
            return
        step = Step(t_s, max(self._step.since_s, t_s - self._period_s))
        for fault, noise in zip(self._faults, self._noise, strict=True):
            if fault.acts(t_s) and (frames := fault.foreign_frames(step, noise)):
                self._counts.acted(fault, len(frames))
                self._bus.send_all(frames)
                self._foreign += frames

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Send the frames that the faults let through."""
        passed = list(frames)
        for number, (fault, noise) in enumerate(zip(self._faults, self._noise, strict=True)):
            held = self._held[number]
            if fault.acts(self._step.t_s):
                sending = Sending(self._step, passed, held)
                passed, self._held[number], acted = fault.outgoing(sending, noise)
                self._counts.acted(fault, acted)
            else:
                passed, self._held[number] = [*(late.frame for late in held), *passed], deque()
        if self._passes(passed):
            self._bus.send_all(passed)

    def receive(self) -> list[Frame]:
        """The frames of foreign nodes, then the received frames."""
        received = [*self._foreign, *self._bus.receive()]
        self._foreign = []
        return received if self._passes(received) else []

    def wait(self, timeout_s: float) -> None:
        """Return when frames have arrived, or after `timeout_s`."""
        self._bus.wait(timeout_s)

    def _passes(self, frames: Sequence[Frame]) -> bool:
        """Whether the node is connected; otherwise the frames are lost."""
        pulled = [fault for fault in self._faults if fault.acts(self._step.t_s) and fault.unplugs(self._node)]
        for fault in pulled:
            self._counts.acted(fault, len(frames))
        return not pulled


def with_faults(
    bus: NodeBus, node: str, faults: Sequence[Fault], seed: int, period_s: float
) -> tuple[NodeBus, Callable[[float], None]]:
    """Return a node's bus with faults, and the function that sets its time; `bus` itself without faults."""
    if not any(isinstance(fault, LineFault) for fault in faults):
        return bus, lambda _: None
    faulty = FaultyBus(bus, node, faults, seed, period_s)
    return faulty, faulty.move_to
