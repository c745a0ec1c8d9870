"""Signals that end the program: raised once, and noted while the program ends."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Interrupted(BaseException):
    """A signal has asked the program to end; says which."""


def interruption(number: signal.Signals) -> str:
    """The signal in a sentence of a verdict."""
    return f"interrupted by {'Ctrl-C' if number == signal.SIGINT else number.name}"


class EndingSignals:
    """SIGINT, SIGTERM and SIGHUP within a block: raised as `Interrupted` once, later ones are noted."""

    def __init__(self) -> None:
        self.raises = True
        self.came: list[str] = []

    def handle(self, number: int, _: FrameType | None) -> None:
        """Raise, or note where that has been done already."""
        reason = interruption(signal.Signals(number))
        if self.raises:
            self.raises = False
            raise Interrupted(reason)
        self.came.append(reason)


@contextmanager
def ending_signals() -> Iterator[EndingSignals]:
    """Catch the signals that ask for an end; what is ignored stays so, as under nohup."""
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
