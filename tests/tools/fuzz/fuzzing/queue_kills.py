"""A suite, a campaign or a worker receives a signal: finished runs are kept, and the rest can be continued.

A suite leaves a JUnit file that names the cause; a campaign has no JUnit file. A repetition of the same
command must end successfully without repeating finished runs.
"""

import signal
import subprocess
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from xml.etree import ElementTree

from fuzzing import kill as killing
from hil.judge.verdict_files import read_verdict
from hil.processes.workers import PROGRAM
from hil.record.run_traces import read_json
from hil.runs.bench import was_cut_short

WORKER = "a worker"
RUNS = 3
"""Number of scenarios of the suite, and of trials of the campaign.

It is odd, so that the last run of two workers has just begun when all others are finished.
"""
FINISHED_BEFORE = {"early": 0, "middle": 1, "end": RUNS - 1, killing.REPORT: RUNS}
"""Number of finished runs at the beginning of a stage; at `early` the first run has begun."""
STAGES = {"early": (0.0, 0.5), "middle": (0.0, 0.5), "end": (0.0, 0.3), killing.REPORT: (0.0, 0.2)}
"""Time of the kill after the beginning of the stage, lowest and highest, s."""
INTERRUPTED = 2
FINISHED = {"suite": (0,), "campaign": (0, 1, 5)}
"""Exit statuses of a queue that has finished; so few and so short trials may miss a goal of the campaign."""
STATUSES_WITHOUT_A_WORKER = {"suite": (1,), "campaign": (4,)}
"""Exit statuses after the loss of a worker: a suite has a failed run, a campaign cannot be judged."""


class Queue:
    """A suite or a campaign in a folder."""

    def __init__(self, of: str, folder: Path) -> None:
        self.is_suite = of == "suite"
        self.out = folder / "suite"
        self._campaigns = folder / "runs"
        names = [f"killed-{number}.toml" for number in range(RUNS)]
        for name in names:
            (folder / name).write_text(killing.SCENARIO)
        if self.is_suite:
            self.command = ["suite", *names, "--out", str(self.out)]
        else:
            self.command = ["campaign", "start-up", "--trials", str(RUNS), "--workers", "2", "--seed", "7"]
            self.command += ["--set", "campaign.duration_s=3"]
        self.command += ["--firmware", "python"]  # compiled, a run would end before the kill

    def has_begun(self) -> bool:
        """Return whether the first run has begun."""
        if self.is_suite:
            return any(self.out.glob("*/operator.trace"))
        return any(self._campaigns.glob("campaign-*"))

    def finished(self) -> dict[str, str]:
        """Return the names of the finished runs, each with the time at which it was made (empty for trials).

        This time distinguishes a run from its repetition.
        """
        if not self.is_suite:
            pieces = self._campaigns.glob("campaign-*/pieces/*.json")
            return {path.name: "" for path in pieces}  # so few trials are a piece each
        runs = {path.parent: read_verdict(path) for path in self.out.glob("*/verdict.json")}
        return {
            run.name: str(read_json(run / "run.json").get("created"))
            for run, verdict in runs.items()
            if verdict and not was_cut_short(verdict)
        }

    def wrong_junit(self, cause: str) -> list[str]:
        """Return the failures of the suite's JUnit file; it must name the cause unless all runs finished."""
        if not self.is_suite:
            return []
        try:
            root = ElementTree.parse(self.out / "junit.xml").getroot()
        except (OSError, ElementTree.ParseError) as error:
            return [f"junit.xml: {error}"]
        said = [error.get("message", "") for error in root.iter("error")]
        whole = len(self.finished()) == RUNS and not said
        return (
            [] if whole or any(cause in one for one in said) else [f"junit.xml does not name {cause}: {said}"]
        )


def worker_of(program: "subprocess.Popen[bytes]") -> int:
    """Return the process id of the first worker, which is found by its program text; 0 if there is none."""
    with suppress(OSError):  # a process has ended meanwhile
        for child in Path(f"/proc/{program.pid}/task/{program.pid}/children").read_text().split():
            if PROGRAM.encode() in Path(f"/proc/{child}/cmdline").read_bytes():
                return int(child)
    return 0


def await_moment(kill: killing.Kill, queue: Queue, program: "subprocess.Popen[bytes]") -> None:
    """Wait until the time of the kill, or until the program has ended."""
    due = FINISHED_BEFORE[kill.stage]

    def is_reached() -> bool:
        is_there = kill.is_of_program or worker_of(program) != 0
        return is_there and queue.has_begun() and len(queue.finished()) >= due

    killing.wait_for(
        lambda: program.poll() is not None or is_reached(),
        f"{due} runs were not finished, or no worker began",
    )
    time.sleep(kill.at_s)


def cause_of(kill: killing.Kill) -> str:
    """Return the cause that must be named."""
    if kill.is_of_program:
        return kill.programs_cause
    return "stopped by a signal" if kill.number == signal.SIGSTOP else f"by {kill.signal_name}"


def wrong_end(kill: killing.Kill, program: "subprocess.Popen[bytes]", is_hit: bool) -> list[str]:
    """Wait for the end of the program and return the failures; `is_hit`: it received the signal itself."""
    finished = FINISHED[kill.of]
    if is_hit:
        # At REPORT the signal may come when all files are written.
        wanted = (-signal.SIGKILL if kill.number in killing.FINAL else INTERRUPTED,)
        wanted += finished if kill.stage == killing.REPORT else ()
    else:
        wanted = (*STATUSES_WITHOUT_A_WORKER[kill.of], *finished)  # it may be idle or ignore Ctrl-C
    status = killing.ended(kill, program, killing.GONE_S if is_hit else killing.END_LIMIT_S)
    return [] if status in wanted else [f"exit status {status}, wanted one of {wanted}"]


def killed_queue(kill: killing.Kill) -> list[str]:
    """Start the program, kill it, and start it again; return the failures."""
    with tempfile.TemporaryDirectory(prefix="vibrohil-kills-") as name:
        folder = Path(name)
        queue = Queue(kill.of, folder)
        try:
            with killing.begun(queue.command, folder) as program:
                await_moment(kill, queue, program)
                before = queue.finished()
                pid = program.pid if kill.is_of_program else worker_of(program)
                was_there = program.poll() is None and pid != 0 and kill.sent_to(pid)
                wrong = wrong_end(kill, program, kill.is_of_program and was_there)
        except (killing.KillError, subprocess.TimeoutExpired) as error:
            return [str(error)]
        wrong += killing.left_over(folder)
        said = (folder / "said").read_text(errors="replace")
        if "Traceback" in said:
            wrong.append(said[-1000:])
        if not was_there:
            wrong.append(killing.NO_VICTIM)
        is_finished = program.returncode in FINISHED[kill.of]
        if was_there and not is_finished:
            wrong += queue.wrong_junit(cause_of(kill))
            if kill.of == "campaign" and program.returncode > 0 and cause_of(kill) not in said:
                wrong.append(f"it does not say {cause_of(kill)}: {said[-300:]}")
        return wrong if is_finished else wrong + gone_on(kill, queue, before, folder)


def gone_on(kill: killing.Kill, queue: Queue, before: dict[str, str], folder: Path) -> list[str]:
    """Repeat the same command and return the failures."""
    kept = queue.finished()
    wrong = [f"{name} was finished and is not kept" for name in before if kept.get(name) != before[name]]
    try:
        with killing.begun(queue.command, folder) as program:
            status = program.wait(killing.START_LIMIT_S)
    except subprocess.TimeoutExpired:
        return [*wrong, "given again it does not end"]
    if status not in FINISHED[kill.of]:
        said = (folder / "said").read_text(errors="replace")
        wrong.append(f"given again it ends with {status}: {said[-500:]}")
    if queue.is_suite and kill.is_of_program:
        now = queue.finished()
        wrong += [f"{name} was run again" for name in before if now.get(name) != before[name]]
    return wrong
