"""Pacing of a node's frames: at most one a tick beside those of every tick.

A node that queues all its slow frames at once makes the frames of every tick, its own and others', wait for
them on the bus. One at a time they never do, and nothing waits long: the frames that come on a period take a
small part of the ticks.
"""

from collections import deque
from enum import IntEnum
from typing import Generic, TypeVar

T = TypeVar("T")

CAPACITY = 32
"""What waits at most, in frames and so in ticks; far more than nodes have due at once."""


class Urgency(IntEnum):
    """Which waiting frame goes first; equal ones in the order in which they came."""

    AT_ONCE = 0
    """Stands behind nothing, and is the last to be dropped: a fault, an E-stop."""
    PROMPT = 1
    """Waits for nothing but those: what belongs to one instant."""
    IN_TURN = 2


class Pacer(Generic[T]):
    """Frames that wait, or what makes them once it is their turn: `take` once a tick.

    >>> pacer = Pacer[str]()
    >>> for name, urgency in (("heartbeat", Urgency.IN_TURN), ("e-stop", Urgency.AT_ONCE)):
    ...     pacer.push(name, urgency)
    >>> pacer.take(), pacer.take(), pacer.take()
    ('e-stop', 'heartbeat', None)
    """

    def __init__(self, capacity: int = CAPACITY) -> None:
        self._capacity = capacity
        self._waiting: tuple[deque[T], ...] = tuple(deque() for _ in Urgency)
        self.lost = 0
        """Frames that found no place; of the least urgent ones that wait, the newest."""

    def __len__(self) -> int:
        return sum(map(len, self._waiting))

    def push(self, item: T, urgency: Urgency = Urgency.IN_TURN) -> None:
        """Let `item` wait for its turn."""
        self._waiting[urgency].append(item)
        if len(self) > self._capacity:
            next(waiting for waiting in reversed(self._waiting) if waiting).pop()
            self.lost += 1

    def take(self) -> T | None:
        """What this tick sends; None if nothing waits."""
        for waiting in self._waiting:
            if waiting:
                return waiting.popleft()
        return None
