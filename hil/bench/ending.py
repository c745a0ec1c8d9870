"""The end of a run. This module ensures that every ending leaves a verdict with its reason.

A verdict that names a kill as its reason is written before the run begins, and remains if no other can be
written. Signals that request an end are raised as `Interrupted` during the run; after the run they are only
recorded, so that they cannot interrupt the judgement.
"""

import errno
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from hil.bench.verdict import KILLED, failed_for, finish, prejudge, write
from hil.bus.base import BusError
from hil.judge.figures.figures import OWN_BUSES
from hil.judge.verdict import RunVerdict, read_verdict
from hil.nodes.own_controller import OwnControllerError
from hil.record import run_folder
from hil.record.run_faults import with_effects
from hil.record.run_traces import read_scenario
from hil.record.traces import trace
from hil.record.traces.own_trace import is_build
from hil.run_files import RunFile
from hil.runs.outcome import Outcome
from hil.timing.processes import ChildError, ChildRefusalError
from hil.timing.signals import Interrupted, ending_signals, interruption

NOT_SHARED = (*OWN_BUSES, "in-process")
"""Buses, by their names in run.json, that are made for one run alone."""
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def was_cut_short(verdict: RunVerdict) -> bool:
    """Whether a run was interrupted or not judged, so that its result is unknown."""
    return any(reason == KILLED or reason.startswith("interrupted by") for reason in verdict.reasons)


def is_no_room(error: BaseException) -> bool:
    """Whether the error is a full disk, an exceeded quota, or a file beyond `ulimit -f`."""
    return isinstance(error, OSError) and error.errno in NO_ROOM


def is_verdict(error: BaseException) -> bool:
    """Whether the error only makes the run fail: a full disk, a process that ended at its start, or a user's
    controller that failed in a tick.
    """
    died = isinstance(error, ChildError) and not isinstance(error, ChildRefusalError)
    return died or isinstance(error, OwnControllerError) or is_no_room(error)


def reason_of(error: BaseException) -> str:
    """The reason for a run's end by an exception, as a sentence of its verdict."""
    if isinstance(error, Interrupted | KeyboardInterrupt):
        return str(error) or interruption(signal.SIGINT)
    if is_no_room(error):
        return f"no room on the disk: {error}"
    if isinstance(error, ChildError | OwnControllerError):
        return str(error)
    return f"broke off: {type(error).__name__}: {error}"


@dataclass
class Ending:
    """A run's outcome, filled during the run, and its verdict: until its end, that of a killed run."""

    verdict: RunVerdict
    outcome: Outcome = field(default_factory=Outcome)

    def amend(self) -> None:
        """Write the verdict again, with the figures in the folder, failed for the outcome's reasons."""
        found = read_verdict(self.verdict.folder / RunFile.VERDICT)
        self.verdict = failed_for(found, self.outcome.reasons)
        write(self.verdict)


@contextmanager
def ending_with_a_verdict(
    run_dir: Path, only_if_failed: bool = False, of_a_suite: bool = False
) -> Iterator[Ending]:
    """Judge the run in `run_dir` after the block, however the block ended.

    An exception that ended the block or the judgement is raised again after the verdict is written, unless it
    only makes the run fail (`is_verdict`). If the disk is full at the start, the block is not entered.
    `only_if_failed`: as in `finish`. `of_a_suite`: an interrupted run is not judged, since its suite must end
    at once and runs it again.
    """
    ending = Ending(prejudge(run_dir, KILLED))
    reasons = ending.outcome.reasons
    take_room(run_dir)
    with ending_signals() as signals:
        raised: BaseException | None = None
        try:
            yield ending
        except BaseException as error:
            raised = signals.raised or error
            if (reason := reason_of(raised)) not in reasons:
                reasons.append(reason)
        signals.raises = False
        if of_a_suite and isinstance(raised, Interrupted):
            raise raised
        if (
            isinstance(raised, BusError | ChildRefusalError) and ending.outcome.wall_s == 0.0
        ):  # the bus is wrong: nothing ran
            run_folder.discard(run_dir)
            raise raised
        try:
            ending.verdict = close(run_dir, ending.outcome, only_if_failed)
        except Exception as error:
            reasons.append(f"while its log and report were written: {reason_of(error)}")
            ending.amend()
            raised = raised or error
        if signals.came and (raised is None or is_verdict(raised)):
            reasons.append(f"{signals.came[0]} while its log and report were written")
            ending.amend()
            raised = Interrupted(signals.came[0])
    if raised is not None and not is_verdict(raised):
        raise raised


def take_room(run_dir: Path) -> None:
    """Reserve disk space for the verdict; on failure write a verdict with this reason and raise the error."""
    try:
        run_folder.reserve(run_dir)
    except OSError as error:
        run_folder.free_reserve(run_dir)
        prejudge(run_dir, reason_of(error))
        raise


def close(run_dir: Path, outcome: Outcome, only_if_failed: bool = False) -> RunVerdict:
    """Collect the files of a run that has ended, and judge it."""
    run_folder.free_reserve(run_dir)
    trace.bring_home(run_dir)
    note = run_folder.read_note(run_dir / RunFile.NOTE)
    run_folder.note(run_dir, faults=with_effects(note, outcome.faults_acted))
    can_log, bus = run_dir / RunFile.CAN_LOG, note.get("bus")
    if "firmware" in note and not is_build(note["firmware"]):
        from hil.bench.sent_decisions import write_firmware_trace  # what decodes frames is loaded if needed

        write_firmware_trace(run_dir, note["period_s"], "gait" in read_scenario(run_dir).get("scene", {}))
    if can_log.exists() and bus not in NOT_SHARED:
        from hil.record.bus_reconstruction import doubt_two_firmwares
        from hil.record.candump import StoredBus

        outcome.not_judged += doubt_two_firmwares(StoredBus(can_log))
    stored = {key: value for key, value in vars(outcome).items() if key != "faults_acted"}
    run_folder.write_json(run_dir / RunFile.OUTCOME, stored)
    return finish(run_dir, only_if_failed)
