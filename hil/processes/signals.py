"""Signals that end the program: the first is raised, later ones are recorded while the program ends."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(BaseException):
    """A signal has requested the end of the program; the message names the signal."""


def interruption(number: signal.Signals) -> str:
    """Describe the signal for a verdict."""
    return f"interrupted by {'Ctrl-C' if number == signal.SIGINT else number.name}"


def is_ctrl_c(error: BaseException) -> bool:
    """Whether the exception is an interruption by Ctrl-C, and not by SIGTERM or SIGHUP."""
    return isinstance(error, KeyboardInterrupt) or str(error) == interruption(signal.SIGINT)


class EndingSignals:
    """SIGINT, SIGTERM and SIGHUP within a block: the first raises `Interrupted`, later ones are recorded."""

    def __init__(self) -> None:
        self.raises = True
        self.raised: Interrupted | None = None
        """The interruption; a library may have lost it, or have made another error of it."""
        self.came: list[str] = []

    def handle(self, number: int, _: FrameType | None) -> None:
        """Raise `Interrupted` at the first signal, if need be after a delay; record the later ones."""
        if DELAYS:
            DELAYS[-1].append((self, signal.Signals(number)))
            return
        reason = interruption(signal.Signals(number))
        if self.raises:
            self.raises = False
            self.raised = Interrupted(reason)
            raise self.raised
        self.came.append(reason)


DELAYS: list[list[tuple[EndingSignals, signal.Signals]]] = []
"""The signals that came within each nested block of `delayed_signals`."""


@contextmanager
def delayed_signals() -> Iterator[None]:
    """Raise `Interrupted` only at the end of a block that no exception may interrupt.

    Within an import, a destructor or a callback of a library the exception may be lost. Where compiled code
    makes records of its results, numba does not check for it, and the process would end with a segmentation
    fault. So a tick of the simulation is never interrupted, only what follows it.
    """
    delayed: list[tuple[EndingSignals, signal.Signals]] = []
    DELAYS.append(delayed)
    try:
        yield
    finally:
        DELAYS.pop()
        if delayed:
            signals, number = delayed[0]
            signals.handle(number, None)


@contextmanager
def ending_signals() -> Iterator[EndingSignals]:
    """Handle the signals that request an end; a signal that was ignored stays ignored, as under nohup."""
    signals = EndingSignals()
    before: dict[signal.Signals, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for number in ENDING_SIGNALS:
            if signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, signals.handle)
    try:
        yield signals
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
