"""Real time on a busy machine, or with stalls of the firmware: the verdict must name the machine.

    python -m tools.dev.pauses --runs 20

Runs the scenario beside two busy loops, and with the firmware paused for 5, 15, 25 and 40 ms at random times,
about once a second; the conditions alternate. A run is in order if its physics pass, or if its verdict names
the machine as the cause. Without permission for real-time priority (as an ordinary user), the busy loops
delay the ticks. The exit status is 1 if a run failed and its verdict does not name the machine.
"""

import argparse
import json
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from hil.record.run_traces import read_json
from tools.fuzz.kill import signalled

SCENARIO = "quick-start-below-the-band"
BUSY = "two busy loops"
PAUSES_MS = (5, 15, 25, 40)
MEAN_GAP_S = 1.0
LOOK_S = 0.01
COLUMNS = ("condition", "runs", "passed", "host named", "neither", "faults latched")


class Outcome(NamedTuple):
    """The outcome of a run."""

    passed: bool
    host_named: bool
    fault: str
    said: str
    """The failure of a run whose verdict does not name the machine."""


@contextmanager
def busy_loops() -> Iterator[None]:
    """Two processes in endless loops, which end with the context."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def pause_at_random(run: "subprocess.Popen[bytes]", folder: Path, pause_s: float, seed: int) -> None:
    """Pause the firmware at random times, from the start of the script until the run ends."""
    random_numbers = random.Random(seed)
    while "t0_ns" not in read_json(folder / "run.json") and run.poll() is None:
        time.sleep(LOOK_S)
    while run.poll() is None and not (folder / "outcome.json").exists():
        firmware = read_json(folder / "processes.json")["firmware"]
        if not signalled(firmware, signal.SIGSTOP):
            return
        time.sleep(pause_s)
        signalled(firmware, signal.SIGCONT)
        time.sleep(random_numbers.expovariate(1.0 / MEAN_GAP_S))


def one_run(condition: str, pause_ms: int, seed: int) -> Outcome:
    """Run the scenario under a condition."""
    with tempfile.TemporaryDirectory(prefix="vibrohil-pauses-") as place:
        folder = Path(place) / "run"
        program = Path(sys.executable).with_name("vibrohil")
        options = ["--clock", "real", "--bus", "local", "--firmware", "compiled", "--seed", str(seed)]
        command = [str(program), "run", SCENARIO, *options, "--out", str(folder)]

        def run() -> None:
            with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as program:
                if pause_ms:
                    pause_at_random(program, folder, 1e-3 * pause_ms, seed)

        if condition == BUSY:
            with busy_loops():
                run()
        else:
            run()
        return outcome_of(read_json(folder / "verdict.json"))


def outcome_of(verdict: dict[str, Any]) -> Outcome:
    """The outcome of a run according to its verdict."""
    failed = [f"{check['name']} = {check['value']}" for check in verdict["checks"] if not check["passed"]]
    said = verdict["reasons"] + failed
    host_named = verdict["host_stall"] is not None
    return Outcome(verdict["passed"], host_named, verdict["fault"], "" if host_named else "; ".join(said))


def neither(outcomes: list[Outcome]) -> int:
    """Number of runs that neither passed nor named the machine."""
    return sum(not one.passed and not one.host_named for one in outcomes)


def main() -> int:
    """Run all conditions with each seed; print every outcome, then a table by condition."""
    parser = argparse.ArgumentParser(prog="python -m tools.dev.pauses", description=__doc__)
    parser.add_argument("--runs", type=int, default=20, help="of each condition")
    runs: int = parser.parse_args().runs
    conditions = {BUSY: 0, **{f"pauses of {pause_ms} ms": pause_ms for pause_ms in PAUSES_MS}}
    found: dict[str, list[Outcome]] = {condition: [] for condition in conditions}
    for seed in range(1, runs + 1):
        for condition, pause_ms in conditions.items():
            outcome = one_run(condition, pause_ms, seed)
            found[condition].append(outcome)
            print(f"seed {seed}, {condition}: {json.dumps(outcome._asdict())}", flush=True)
    print("| " + " | ".join(COLUMNS) + " |\n" + "|---" * len(COLUMNS) + "|")
    for condition, some in found.items():
        passed, named = sum(one.passed for one in some), sum(one.host_named for one in some)
        faults = ", ".join(sorted({one.fault for one in some} - {"none"}))
        print(f"| {condition} | {len(some)} | {passed} | {named} | {neither(some)} | {faults} |")
    return int(any(neither(some) for some in found.values()))


if __name__ == "__main__":
    sys.exit(main())
