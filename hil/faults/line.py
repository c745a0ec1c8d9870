"""Bus faults at a node's connection, in real time and in lockstep: a wrapper around the node's bus.

Faults alter frames where they leave their sender. Frames of a foreign node are sent through the plant's
connection, and the plant receives them too.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from firmware_py.interface.frame import Frame
from hil.bus.base import NodeBus
from hil.scenario import fault_tables as tables

PLANT = "plant"
IDENTIFIERS = 0x800
TIME_RESOLUTION_S = 1e-9

Held = tuple["Late", ...]


class Late(NamedTuple):
    """A frame that is held back until `due_s`."""

    due_s: float
    frame: Frame


def broken(frame: Frame, noise: np.random.Generator) -> Frame:
    """The frame with some bits of one byte inverted; a frame without data is unchanged."""
    if not frame.data:
        return frame
    place, pattern = int(noise.integers(len(frame.data))), int(noise.integers(1, 256))
    data = bytearray(frame.data)
    data[place] ^= pattern
    return Frame(frame.can_id, bytes(data))


def swapped(frames: Sequence[Frame], can_ids: frozenset[int], held: Held) -> tuple[list[Frame], Held]:
    """Swap frames of the same identifier in pairs; an unpaired frame is held until the next one comes."""
    waiting = {late.frame.can_id: late.frame for late in held}
    passed: list[Frame] = []
    for frame in frames:
        if frame.can_id not in can_ids:
            passed.append(frame)
        elif frame.can_id in waiting:
            passed += [frame, waiting.pop(frame.can_id)]
        else:
            waiting[frame.can_id] = frame
    return passed, tuple(Late(0.0, frame) for frame in waiting.values())


def periods_begun(at_s: float, period_s: float, t_s: float, since_s: float) -> int:
    """Number of periods, counted from `at_s`, that begin after `since_s` and not after `t_s`."""
    begun = int((t_s - at_s) / period_s + TIME_RESOLUTION_S) + 1
    before = int((since_s - at_s) / period_s + TIME_RESOLUTION_S) + 1 if since_s >= at_s else 0
    return begun - before


def outgoing(  # noqa: PLR0911 - one case a fault
    fault: tables.LineFault,
    t_s: float,
    since_s: float,
    frames: Sequence[Frame],
    held: Held,
    noise: np.random.Generator,
) -> tuple[list[Frame], Held]:
    """Return the frames that leave a node at `t_s` under one fault, and the frames that are held back.

    `since_s`: the time of the node's previous step.
    """
    if not fault.acts(t_s):
        return [*(late.frame for late in held), *frames], ()
    match fault:
        case tables.Dropped(can_ids=can_ids, share=share):
            return [f for f in frames if f.can_id not in can_ids or noise.random() >= share], ()
        case tables.Duplicated(can_ids=can_ids, copies=copies):
            return [f for f in frames for _ in range(copies if f.can_id in can_ids else 1)], ()
        case tables.Corrupted(can_ids=can_ids, share=share):
            hit = [f.can_id in can_ids and noise.random() < share for f in frames]
            return [broken(f, noise) if is_hit else f for f, is_hit in zip(frames, hit, strict=True)], ()
        case tables.Thinned(can_ids=can_ids, period_s=period_s, at_s=at_s):
            leave = periods_begun(at_s, period_s, t_s, since_s) > 0
            return [f for f in frames if leave or f.can_id not in can_ids], ()
        case tables.Bundled(can_ids=can_ids, period_s=period_s, at_s=at_s):
            bundle = (*held, *(Late(t_s, f) for f in frames if f.can_id in can_ids))
            passed = [f for f in frames if f.can_id not in can_ids]
            if periods_begun(at_s, period_s, t_s, since_s) > 0:
                return [*(late.frame for late in bundle), *passed], ()
            return passed, bundle
        case tables.Reordered(can_ids=can_ids):
            return swapped(frames, can_ids, held)
        case tables.Delayed(can_ids=can_ids, delay_s=delay_s):
            late = (*held, *(Late(t_s + delay_s, f) for f in frames if f.can_id in can_ids))
            due = [frame for due_s, frame in late if due_s <= t_s + TIME_RESOLUTION_S]
            on_time = [f for f in frames if f.can_id not in can_ids]
            return [*due, *on_time], late[len(due) :]
        case _:
            return list(frames), held


def foreign_frames(
    fault: tables.LineFault, t_s: float, since_s: float, noise: np.random.Generator
) -> list[Frame]:
    """The frames of a foreign node after `since_s` and not after `t_s`."""
    if not fault.acts(t_s):
        return []
    match fault:
        case tables.Babbling(can_id=can_id, data_hex=data_hex, period_s=period_s, at_s=at_s):
            return [Frame(can_id, bytes.fromhex(data_hex))] * periods_begun(at_s, period_s, t_s, since_s)
        case tables.Flood(frames_a_tick=frames_a_tick):
            return [
                Frame(int(noise.integers(IDENTIFIERS)), noise.bytes(int(noise.integers(9))))
                for _ in range(frames_a_tick)
            ]
        case _:
            return []


class FaultyBus:
    """One node's connection with faults; `move_to` sets the time."""

    def __init__(self, bus: NodeBus, node: str, faults: Sequence[tables.Fault], seed: int) -> None:
        self._bus = bus
        self._node = node
        self._faults = [fault for fault in faults if isinstance(fault, tables.LineFault)]
        self._noise = [np.random.default_rng([seed, number]) for number in range(len(self._faults))]
        self._held: list[Held] = [()] * len(self._faults)
        self._t_s = self._since_s = 0.0
        self._foreign: list[Frame] = []

    def move_to(self, t_s: float) -> None:
        """Begin the node's step at `t_s`; frames of foreign nodes are sent first."""
        self._since_s, self._t_s = self._t_s, t_s
        if self._node != PLANT:
            return
        for fault, noise in zip(self._faults, self._noise, strict=True):
            frames = foreign_frames(fault, t_s, self._since_s, noise)
            if frames:
                self._bus.send_all(frames)
                self._foreign += frames

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Send the frames that the faults let through."""
        passed = list(frames)
        for number, (fault, noise) in enumerate(zip(self._faults, self._noise, strict=True)):
            passed, self._held[number] = outgoing(
                fault, self._t_s, self._since_s, passed, self._held[number], noise
            )
        if not self._is_unplugged:
            self._bus.send_all(passed)

    def receive(self) -> list[Frame]:
        """The frames of foreign nodes, then the received frames."""
        received = [*self._foreign, *self._bus.receive()]
        self._foreign = []
        return [] if self._is_unplugged else received

    def wait(self, timeout_s: float) -> None:
        """Return when frames have arrived, or after `timeout_s`."""
        self._bus.wait(timeout_s)

    @property
    def _is_unplugged(self) -> bool:
        return any(
            isinstance(fault, tables.Unplugged) and fault.node == self._node and fault.acts(self._t_s)
            for fault in self._faults
        )


def with_faults(
    bus: NodeBus, node: str, faults: Sequence[tables.Fault], seed: int
) -> tuple[NodeBus, Callable[[float], None]]:
    """Return a node's bus with faults, and the function that sets its time; `bus` itself without faults."""
    if not any(isinstance(fault, tables.LineFault) for fault in faults):
        return bus, lambda _: None
    faulty = FaultyBus(bus, node, faults, seed)
    return faulty, faulty.move_to
