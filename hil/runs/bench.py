"""A whole run in the steps prepare, begin, run, judge, publish; every ending leaves a verdict.

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

from firmware_py.shell.builds import is_build
from hil.bus.base import BusError
from hil.judge.verdict import KILLED, RunVerdict, failed_for, without_records
from hil.judge.verdict_files import read_verdict, write_verdict
from hil.nodes.firmware.own_controller import OwnControllerError, load_own
from hil.processes.child import ChildError, ChildRefusalError
from hil.processes.signals import Interrupted, ending_signals, interruption
from hil.record import run_folder
from hil.record.traces.own_trace import NONE
from hil.run_files import RunFile
from hil.runs.job import Job, Outcome, Progress, RunOptions
from hil.runs.recording import begin, simulate
from hil.scenario.files import ScenarioError
from hil.scenario.scenario import Scenario, refuse_modelled_bus, refuse_other_periods

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def run_scenario(
    scenario: Scenario, options: RunOptions, out_dir: Path | None, seed: int, progress: Progress
) -> RunVerdict:
    """Run `scenario` and return its verdict; all files of the run are in its folder."""
    prepare(options)
    in_lockstep = options.clock == "lockstep"
    if not in_lockstep:
        refuse_other_periods(scenario.period_s)
        refuse_modelled_bus(scenario)
    with run_folder.claimed(scenario.name, out_dir) as run_dir:
        begin(run_dir, scenario, options.clock, seed)
        run = run_folder.note(run_dir, firmware=options.firmware)
        killed = without_records(run, scenario.checks, KILLED, run_dir)
        with ending_with_a_verdict(killed, options.only_if_failed, options.of_a_suite) as ending:
            if in_lockstep:
                simulate(Job(scenario, seed, options.firmware, run_dir, ending.outcome, progress))
            else:
                from hil.runs.realtime import ProcessesRun  # noqa: PLC0415 - lockstep needs no bus

                ProcessesRun(scenario, options, run_dir, seed, ending.outcome, progress).run()
            progress(1.0, "writing log and verdict")
        if not options.keep_traces and ending.verdict.passed:
            run_folder.keep_the_log(run_dir)
    return ending.verdict


def prepare(options: RunOptions) -> None:
    """Make the image of an emulated build, and look at a user's controller.

    Raises BoardError if the build cannot run here, TextInputError for a controller that cannot.
    """
    if options.firmware == NONE:
        if options.clock == "lockstep":
            raise ScenarioError(
                "--firmware none with --clock lockstep: another program joins the bus in real time; give "
                "--clock real, or --firmware FILE.py:FUNCTION for a controller that lockstep calls"
            )
        return
    if not is_build(options.firmware):
        load_own(options.firmware)
        return
    if options.firmware not in ("cortex-m7", "cortex-m4f"):
        return
    from firmware_py.builds.board import BoardError, image  # noqa: PLC0415 - imports LLVM

    if options.clock != "lockstep":
        raise BoardError(
            f"--firmware {options.firmware} with --clock {options.clock}: an emulated board keeps no wall "
            "clock's time; give --clock lockstep"
        )
    image("cortex-m7" if options.firmware == "cortex-m7" else "cortex-m4f")


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
        write_verdict(self.verdict)


@contextmanager
def ending_with_a_verdict(
    killed: RunVerdict, only_if_failed: bool = False, of_a_suite: bool = False
) -> Iterator[Ending]:
    """Judge a run after the block, however the block ended; `killed`: its verdict until then.

    An exception that ended the block or the judgement is raised again after the verdict is written, unless it
    only makes the run fail (`is_verdict`). If the disk is full at the start, the block is not entered.
    `only_if_failed`: as in `finish`. `of_a_suite`: an interrupted run is not judged, since its suite must end
    at once and runs it again.
    """
    ending, run_dir = Ending(killed), killed.folder
    reasons = ending.outcome.reasons
    write_verdict(killed)
    take_room(killed)
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
            from hil.runs.verdict import close  # noqa: PLC0415 - loaded after the last tick

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


def take_room(killed: RunVerdict) -> None:
    """Reserve disk space for the verdict; on failure write a verdict with this reason and raise the error."""
    try:
        run_folder.reserve(killed.folder)
    except OSError as error:
        run_folder.free_reserve(killed.folder)
        write_verdict(failed_for(killed, [reason_of(error)]))
        raise
