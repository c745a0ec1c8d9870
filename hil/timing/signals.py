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


class EndingSignals:
    """SIGINT, SIGTERM and SIGHUP within a block: the first raises `Interrupted`, later ones are recorded."""

    def __init__(self) -> None:
        self.raises = True
        self.came: list[str] = []

    def handle(self, number: int, _: FrameType | None) -> None:
        """Raise `Interrupted` at the first signal; record the later ones."""
        reason = interruption(signal.Signals(number))
        if self.raises:
            self.raises = False
            raise Interrupted(reason)
        self.came.append(reason)


@contextmanager
def delayed_signals() -> Iterator[None]:
    """Deliver the signals at the end of a block of imports: an exception within an import may be lost."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


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
