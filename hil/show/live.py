"""The live view, a process of its own beside a run: what is new, to an open viewer.

`python -m hil.show.live RUN_DIR --to URL` waits for the start like the nodes and then reads along, as the
recorder does, some times a second; with `--whole` it sends a run that is over. It shares nothing with the
others but the files they write anyway: a viewer that is slow, stopped or closed holds up neither the loops,
nor the recorder, nor the verdict, and costs at most this view. The SDK waits without end for a viewer that is
gone while it connects or disconnects: both have a bound here, and this process ends without its leave.
"""

import argparse
import os
import select
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from hil.record.follower import TRACES, Follower
from hil.record.run_traces import RunTraces, pieces, read_json, read_scenario
from hil.show.log_stream import VIEWER_TIMEOUT_S
from hil.show.rerun_log import RunLog, judged
from hil.timing.processes import READY, read_start, stop_requests

APPEND_PERIOD_S = 0.25
NICENESS = 15
"""Below the recorder."""


def follow(run_dir: Path, url: str, wakers: list[int]) -> None:
    """Show the run until one of the descriptors `wakers` becomes readable."""
    follower = Follower(run_dir)
    with bounded(f"connecting to {url}"):
        log = RunLog(url, read_json(run_dir / "run.json"), read_scenario(run_dir))
    ending = False
    while not ending:
        ending = bool(select.select(wakers, [], [], APPEND_PERIOD_S)[0])
        plant, firmware, impacts, operator = (follower.new_records(name) for name in TRACES)
        log.append(RunTraces(plant, firmware, impacts, operator, follower.new_frames()))
    with bounded("closing the connection"):
        log.close()


def send(run_dir: Path, url: str) -> None:
    """Show a run that is over."""
    traces, figures, results = judged(run_dir)
    with bounded(f"connecting to {url}"):
        log = RunLog(url, traces.run, traces.scenario)
    for piece in pieces(traces):
        log.append(piece)
    log.conclude(traces, figures, results)
    with bounded("closing the connection"):
        log.close()


def show(run_dir: Path, url: str) -> None:
    """Show a run that is over in an open viewer; that it is gone is reported on standard error."""
    command = [sys.executable, "-m", "hil.show.live", str(run_dir), "--to", url, "--whole"]
    subprocess.run(command, check=False)


@contextmanager
def bounded(what: str) -> Iterator[None]:
    """End this process if the block takes longer than `VIEWER_TIMEOUT_S`."""
    late = threading.Timer(VIEWER_TIMEOUT_S, give_up, [f"{what} took longer than {VIEWER_TIMEOUT_S:g} s"])
    late.start()
    try:
        yield
    finally:
        late.cancel()


def give_up(reason: str) -> NoReturn:
    """End at once, without the SDK's own goodbye to a viewer that may be gone."""
    sys.stderr.write(f"the live view ended: {reason}\n")
    sys.stderr.flush()
    os._exit(1)


def main() -> None:
    """Show the run in a folder until asked to stop, or until the viewer is gone."""
    parser = argparse.ArgumentParser(description="Show a run that is going on.")
    parser.add_argument("run_dir", type=Path)
    parser.add_argument("--whole", action="store_true", help="a run that is over, all at once")
    parser.add_argument("--to", required=True, help="the viewer's address, rerun+http://HOST:PORT/proxy")
    arguments = parser.parse_args()
    os.nice(NICENESS)
    try:
        if arguments.whole:
            send(arguments.run_dir, arguments.to)
            return
        stopping = stop_requests()
        print(READY, flush=True)
        read_start()
        follow(arguments.run_dir, arguments.to, [stopping.fileno(), sys.stdin.fileno()])
    except RuntimeError as error:
        give_up(str(error))


if __name__ == "__main__":
    main()
