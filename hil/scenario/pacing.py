"""Pacing of a node's frames: at most one slow frame per tick.

If a node sent all its slow frames at once, they would delay the frames of every tick on the bus, its own and
those of other nodes. With one slow frame per tick there is no such delay, and no slow frame waits long: the
cyclic frames need only a small share of the ticks.
"""

from collections import deque
from enum import IntEnum
from typing import Generic, TypeVar

T = TypeVar("T")

CAPACITY = 32
"""Most waiting frames, and so the longest wait in ticks; nodes never have nearly as many due at once."""


class Urgency(IntEnum):
    """Priority of a waiting frame; frames of equal urgency are sent in the order of their arrival."""

    AT_ONCE = 0
    """Sent first, and dropped last: a fault, an E-stop."""
    PROMPT = 1
    """Sent after frames AT_ONCE only: an event with a time of its own."""
    IN_TURN = 2


class Pacer(Generic[T]):
    """Waiting frames, or functions that make them when they are sent; call `take` once per tick.

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
        """Number of dropped frames; a full queue drops the newest of its least urgent frames."""

    def __len__(self) -> int:
        return sum(map(len, self._waiting))

    def push(self, item: T, urgency: Urgency = Urgency.IN_TURN) -> None:
        """Queue `item`; if the queue is full, drop a frame."""
        self._waiting[urgency].append(item)
        if len(self) > self._capacity:
            next(waiting for waiting in reversed(self._waiting) if waiting).pop()
            self.lost += 1

    def take(self) -> T | None:
        """Remove and return the next item to be sent; None if none waits."""
        for waiting in self._waiting:
            if waiting:
                return waiting.popleft()
        return None
