"""The events of the hybrid automaton, which both solvers locate."""

from enum import IntEnum


class Event(IntEnum):
    """The end of a flow of the closed form, or of a step of the adaptive solver.

    The events of the crank and of the current loop are independent of the striker's.
    """

    NONE = 0
    """Its duration is over."""
    TOUCH = 1
    """The striker reaches the stop's surface."""
    LEAVE = 2
    """The force of a soft stop ends."""
    CLEAR = 3
    """The striker clears a stop that released early."""
    PRESS = 4
    """It presses such a stop again."""
    HALT = 5
    """The striker's speed reaches zero."""
    RELEASE = 6
    """A striker at rest breaks away."""
    CRANK_HALT = 7
    CRANK_BREAK = 8
    LIMIT = 9
    """The supply begins to limit the current loop."""
    UNLIMIT = 10
