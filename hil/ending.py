"""How a run ends. Whatever ends it, a verdict is left that says so; this is the one place that sees to it.

A verdict that blames a kill is written before the run begins, so it stands where nothing else can be written.
Signals that ask for an end are raised as `Interrupted` while the run goes on; once it is over they are only
noted, so that they cannot cut the judgement short.
"""

import errno
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from hil import run_folder, trace
from hil.processes import ChildError, ChildRefusalError
from hil.verdict import amend, finish, prejudge

NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
KILLED = "the run is still going on, or its process was killed before it could be judged"


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


@dataclass
class Outcome:
    """How a run ended; outcome.json."""

    wall_s: float = 0.0
    """Elapsed from the start to the end of the loops."""
    reasons: list[str] = field(default_factory=list)
    """Why the run is no good whatever its checks say: one sentence each."""
    baseline_overruns: int | None = None
    memory_growth_mb: dict[str, float] = field(default_factory=dict)
    """By process since it had settled, in runs that are long enough."""
    memory_watched_s: float = 0.0
    """The time from then on."""


def is_no_room(error: BaseException) -> bool:
    """Whether it blames a full disk or a used-up quota."""
    return isinstance(error, OSError) and error.errno in NO_ROOM


def is_verdict(error: BaseException) -> bool:
    """Whether it is a failed run like any other: the disk is full, or a process has died at its start."""
    died = isinstance(error, ChildError) and not isinstance(error, ChildRefusalError)
    return died or is_no_room(error)


def reason_of(error: BaseException) -> str:
    """Why a run ended that something was raised in, as a sentence of its verdict."""
    if isinstance(error, Interrupted | KeyboardInterrupt):
        return str(error) or interruption(signal.SIGINT)
    if is_no_room(error):
        return f"no room on the disk: {error}"
    if isinstance(error, ChildError):
        return str(error)
    return f"broke off: {type(error).__name__}: {error}"


@dataclass
class Ending:
    """A run's outcome while it goes on, and its verdict afterwards."""

    outcome: Outcome = field(default_factory=Outcome)
    verdict: dict[str, Any] = field(default_factory=dict)


@contextmanager
def ending_with_a_verdict(run_dir: Path, only_if_failed: bool = False) -> Iterator[Ending]:
    """Run in the block; after it, however it ended, the run in `run_dir` is judged.

    What ended the block early, or broke off the judgement, is raised again once the verdict is written,
    unless it is a verdict like any other (`is_verdict`).
    """
    ending = Ending()
    reasons = ending.outcome.reasons
    run_folder.reserve(run_dir)
    prejudge(run_dir, KILLED)
    with ending_signals() as signals:
        raised: BaseException | None = None
        try:
            yield ending
        except BaseException as error:
            raised = error
            if (reason := reason_of(error)) not in reasons:
                reasons.append(reason)
        signals.raises = False
        run_folder.free_reserve(run_dir)
        try:
            trace.bring_home(run_dir)
            run_folder.write_json(run_dir / "outcome.json", vars(ending.outcome))
            ending.verdict = finish(run_dir, only_if_failed)
        except Exception as error:
            reasons.append(f"while its log and report were written: {reason_of(error)}")
            ending.verdict = amend(run_dir, reasons)
            raised = raised or error
        if signals.came and (raised is None or is_verdict(raised)):
            reasons.append(f"{signals.came[0]} while its log and report were written")
            ending.verdict = amend(run_dir, reasons)
            raised = Interrupted(signals.came[0])
    if raised is not None and not is_verdict(raised):
        raise raised
