"""The live view: a separate process that sends the new records of a run to an open viewer.

`python -m hil.show.live RUN_DIR --to URL` waits for the start like the nodes and then reads new records
several times a second, as the recorder does. `--to window` opens a window of its own, which stays open.

It shares only the run's files with the other processes: a viewer that is slow, stopped or closed delays
neither the loops, nor the recorder, nor the verdict. The SDK waits without limit for a viewer that disappears
while it connects or disconnects, so both have a time limit here, after which this process ends.
"""

import argparse
import os
import select
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn
from urllib.parse import urlsplit

from hil.processes.child import READY, read_start, stop_requests
from hil.record.run_traces import read_json, read_scenario
from hil.run_files import RunFile
from hil.show.follower import Follower
from hil.show.log_stream import VIEWER_TIMEOUT_S
from hil.show.rerun_log import RunLog
from hil.show.window import WINDOW, listening_users, open_window

APPEND_PERIOD_S = 0.25
NICENESS = 12
"""A lower priority than the recorder's."""


def follow(run_dir: Path, url: str, wakers: list[int]) -> None:
    """Show the run until one of the descriptors `wakers` becomes readable.

    Raises RuntimeError if another user listens at `url` by now: a viewer may have ended since it was found.
    """
    follower = Follower(run_dir)
    if set(listening_users(urlsplit(url).port or 0)) - {os.geteuid()}:
        raise RuntimeError(f"another user listens at {url}; nothing is sent")
    with bounded(f"connecting to {url}"):
        log = RunLog(url, read_json(run_dir / RunFile.NOTE), read_scenario(run_dir))
    ending = False
    while not ending:
        ending = bool(select.select(wakers, [], [], APPEND_PERIOD_S)[0])
        log.append(follower.new_traces(follower.new_frames()))
    with bounded("closing the connection"):
        log.close()


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
    """End at once, without the SDK's disconnection, which could wait for a closed viewer."""
    sys.stderr.write(f"the live view ended: {reason}\n")
    sys.stderr.flush()
    os._exit(1)


def main() -> None:
    """Show the run in a folder until a stop is requested or the viewer is closed."""
    parser = argparse.ArgumentParser(description="Show a run that is going on.")
    parser.add_argument("run_dir", type=Path)
    parser.add_argument("--to", required=True, help="window, or a viewer's rerun+http://HOST:PORT/proxy")
    arguments = parser.parse_args()
    try:
        url = open_window(stays=True)[1] if arguments.to == WINDOW else arguments.to
        os.nice(NICENESS)
        stopping = stop_requests()
        print(READY, flush=True)
        read_start()
        follow(arguments.run_dir, url, [stopping.fileno(), sys.stdin.fileno()])
    except RuntimeError as error:
        give_up(str(error))


if __name__ == "__main__":
    main()
