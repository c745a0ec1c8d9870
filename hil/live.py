"""The live view, a process of its own beside a run in real time: what is new, to an open viewer.

`python -m hil.live RUN_DIR --to URL` waits for the start like the nodes and then reads along, as the recorder
does, some times a second. It shares nothing with the others but the files they write anyway: a viewer that is
slow, stopped or closed holds up neither the loops nor the recorder, and costs at most this view.
"""

import argparse
import os
import select
import sys
from pathlib import Path

from hil.follower import TRACES, Follower
from hil.processes import READY, read_start, stop_requests
from hil.rerun_log import RunLog
from hil.run_traces import RunTraces, read_json, read_scenario

APPEND_PERIOD_S = 0.25
NICENESS = 15
"""Below the recorder."""


def follow(run_dir: Path, url: str, wakers: list[int]) -> None:
    """Show the run until one of the descriptors `wakers` becomes readable."""
    follower = Follower(run_dir)
    with RunLog(url, read_json(run_dir / "run.json"), read_scenario(run_dir)) as log:
        ending = False
        while not ending:
            ending = bool(select.select(wakers, [], [], APPEND_PERIOD_S)[0])
            plant, firmware, impacts, operator = (follower.new_records(name) for name in TRACES)
            log.append(RunTraces(plant, firmware, impacts, operator, follower.new_frames()))


def main() -> None:
    """Show the run in a folder until asked to stop, or until the viewer is gone."""
    parser = argparse.ArgumentParser(description="Show a run that is going on.")
    parser.add_argument("run_dir", type=Path)
    parser.add_argument("--to", required=True, help="the viewer's address, rerun+http://HOST:PORT/proxy")
    arguments = parser.parse_args()
    os.nice(NICENESS)
    stopping = stop_requests()
    print(READY, flush=True)
    read_start()
    try:
        follow(arguments.run_dir, arguments.to, [stopping.fileno(), sys.stdin.fileno()])
    except RuntimeError as error:
        sys.exit(f"the live view ended: {error}")


if __name__ == "__main__":
    main()
