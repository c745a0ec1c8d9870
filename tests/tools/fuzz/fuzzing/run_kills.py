"""A process of a run receives a signal: verdict and log must be complete, and nothing else may remain."""

import signal
import subprocess
import tempfile
import time
from pathlib import Path
from xml.etree import ElementTree

from fuzzing.kill import (
    NO_VICTIM,
    REPORT,
    SCENARIO,
    Kill,
    KillError,
    begun,
    ended,
    left_over,
    wait_for,
)
from hil.record.rrd.log_file import is_whole
from hil.record.run_traces import read_json
from hil.runs.recorded_run import open_run

CHILDREN = ("firmware", "plant", "recorder", "hub", "baseline")
STAGES = {"early": (0.1, 0.5), "middle": (1.0, 2.0), "end": (2.4, 2.8), REPORT: (0.0, 0.3)}
"""Range of the kill's time, s, from the start of the script, or for REPORT from the end of the run."""


def await_moment(kill: Kill, run_dir: Path) -> None:
    """Wait until the time of the kill."""
    if kill.stage == REPORT:
        wait_for((run_dir / "outcome.json").exists, "the run did not end")
        time.sleep(kill.at_s)
        return
    if kill.of == "lockstep":  # in lockstep simulated time passes faster than wall time
        wait_for((run_dir / "operator.trace").exists, "the run did not begin")
        time.sleep(0.1 * kill.at_s)
        return
    described = run_dir / "run.json"
    t0_ns = wait_for(lambda: read_json(described).get("t0_ns"), "the run did not begin")
    time.sleep(max(0.0, t0_ns * 1e-9 + kill.at_s - time.monotonic()))


def wrong_verdict(kill: Kill, run_dir: Path, was_over: bool) -> list[str]:
    """Return the failures of verdict and JUnit file; `was_over`: the signal came after the run."""
    verdict = read_json(run_dir / "verdict.json")
    try:
        ElementTree.parse(run_dir / "junit.xml")
    except (OSError, ElementTree.ParseError) as error:
        return [f"junit.xml: {error}"]
    if not verdict:
        return ["no verdict"]
    said = "; ".join([*verdict["reasons"], *verdict["not_judged"]])
    is_ignored = kill.number == signal.SIGINT and not kill.is_of_program
    if not is_ignored and (kill.programs_cause if kill.is_of_program else kill.process) not in said:
        # A signal after the run may come when the verdict is already written.
        if was_over and verdict["passed"]:
            return []
        return [f"the verdict does not name the cause: {said or 'passed'}"]
    return []


def killed_run(kill: Kill) -> list[str]:
    """Run the scenario, kill a process, and return the failures."""
    with tempfile.TemporaryDirectory(prefix="vibrohil-kills-") as name:
        folder = Path(name)
        run_dir = folder / "run"
        (folder / "killed.toml").write_text(SCENARIO)
        command = ["run", "killed.toml", "--out", str(run_dir), "--clock", kill.of, "--bus", "local"]
        if kill.of == "lockstep":
            command += ["--firmware", "python"]  # compiled, the run would end before the kill
        try:
            with begun(command, folder) as bench:
                await_moment(kill, run_dir)
                was_over = (run_dir / "outcome.json").exists()  # possible at any stage on a busy machine
                pid = bench.pid if kill.is_of_program else read_json(run_dir / "processes.json")[kill.process]
                was_there = bench.poll() is None and kill.sent_to(pid)
                ended(kill, bench)
        except (KillError, subprocess.TimeoutExpired) as error:
            return [str(error)]
        wrong = left_over(folder)
        wrong += wrong_verdict(kill, run_dir, was_over) if was_there else [NO_VICTIM]
        log = open_run(run_dir).log
        return wrong if is_whole(log) else [*wrong, f"{log.name} does not verify"]
