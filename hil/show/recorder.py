"""The recorder: a separate process in real time that writes the bus to can.log and all traces to run.rrd.

`python -m hil.show.recorder RUN_DIR --bus ADDRESS` waits for the start like the nodes. Once a second it
appends the new records, so that after a kill of any process, this one included, the log lacks at most that
second; the traces lose nothing. It ends on SIGTERM, or when its parent ends, after all data are written.
"""

import argparse
import json
import os
import select
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware_py.shell.parameters import addresses_from
from hil.bus import Bus, join
from hil.bus.addressed import addressed
from hil.bus.log.can_log import CanLog
from hil.processes.child import READY, read_start, report_to_parent, stop_requests
from hil.record.candump import bus_log
from hil.record.run_traces import read_json, read_scenario
from hil.run_files import RunFile
from hil.show.follower import Follower
from hil.show.rerun_log import RunLog
from hil.timing.clock import NS_PER_S
from hil.timing.pacemaker import TurnTimes
from hil.timing.realtime import settle_garbage

APPEND_PERIOD_S = 1.0
DRAIN_PERIOD_S = 0.02
"""Period of reading the bus; about sixty frames wait in its buffer, with their arrival times."""
LATEST_DELIVERY_S = 0.05
"""Longest wait for frames that an adapter delivers late, after the end of the run."""
NICENESS = 10
"""A lower priority than the loops', even if they run at ordinary priority.

It is taken at the start: on a busy machine it would make the imports many times slower, while all nodes wait
for them.
"""


class Recorder:
    """Follows one run: reads the bus, appends to can.log and run.rrd."""

    def __init__(self, run_dir: Path, bus: Bus | None, times: TurnTimes | None = None) -> None:
        """`times`: the times of the turns, in a run whose time is held."""
        self.times = times
        self.run_dir = run_dir
        self.bus = bus
        self.follower = Follower(run_dir)
        run = read_json(run_dir / RunFile.NOTE)
        self.wall_start_ns = round(float(run["wall_start_s"]) * 1e9)
        self.log = RunLog(run_dir / RunFile.LOG, run, read_scenario(run_dir))
        self.can_log = CanLog(run_dir / RunFile.CAN_LOG)
        self.frames = 0
        self._arrived_s: list[float] = []
        self._can_ids: list[int] = []
        self._payloads: list[bytes] = []

    def drain(self, until_ns: int | None = None) -> None:
        """Read the frames that have arrived up to a time on the wall clock, by default now.

        It ends, however many frames come; if the clock has fallen back, where it fell.
        """
        if self.bus is None:
            return
        until_ns = until_ns or max(time.time_ns(), self.bus.newest_ns + 1)
        if not (arrived := self.bus.receive_stamped(until_ns)):
            return
        stamps_ns = np.array([wall_ns for wall_ns, _ in arrived], np.int64)
        times_us = self.since_start_ns(stamps_ns) // 1000
        for t_us, (_, frame) in zip(times_us.tolist(), arrived, strict=True):
            if t_us >= 0:  # frames sent before the start are not part of this run
                self.can_log.write(t_us, (frame,))
                self._arrived_s.append(t_us * 1e-6)
                self._can_ids.append(frame.can_id)
                self._payloads.append(frame.data)

    def since_start_ns(self, wall_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Convert times of the wall clock to times of the run, both in ns."""
        return wall_ns - self.wall_start_ns if self.times is None else self.times.since_start_ns(wall_ns)

    def append(self) -> None:
        """Append all new data to both logs, and pass them to the operating system."""
        self.frames += len(self._payloads)
        bus = bus_log(np.array(self._arrived_s), np.array(self._can_ids, np.int64), self._payloads)
        self._arrived_s, self._can_ids, self._payloads = [], [], []
        self.can_log.flush()
        self.log.append(self.follower.new_traces(bus))

    def close(self) -> None:
        """Write all frames sent up to now and the remaining records, and close both files."""
        latest_ns = time.time_ns() + round(LATEST_DELIVERY_S * NS_PER_S)
        bus = self.bus
        while bus is not None and bus.newest_ns < latest_ns and is_readable(bus, LATEST_DELIVERY_S):
            before_ns = bus.newest_ns
            self.drain(latest_ns)
            if bus.newest_ns == before_ns and time.time_ns() > latest_ns:
                break  # the bus has ended
        self.append()
        self.can_log.close()
        self.log.close()


def is_readable(bus: Bus, timeout_s: float) -> bool:
    """Whether frames arrive within `timeout_s`."""
    return bool(select.select([bus], [], [], timeout_s)[0])


def record(recorder: Recorder, wakers: list[int]) -> None:
    """Follow the run until one of the descriptors `wakers` becomes readable."""
    due_s = time.monotonic() + APPEND_PERIOD_S
    while not select.select(wakers, [], [], DRAIN_PERIOD_S)[0]:
        recorder.drain()
        if time.monotonic() >= due_s:
            recorder.append()
            due_s += APPEND_PERIOD_S
    recorder.close()


def main() -> None:
    """Record the run in a folder until a stop is requested."""
    parser = argparse.ArgumentParser(description="Record a run that is going on.")
    parser.add_argument("run_dir", type=Path)
    parser.add_argument("--bus", help="the address of the bus whose frames go to can.log")
    parser.add_argument("--turn-times", type=int, help="descriptor of the memory with the turns' times")
    arguments = parser.parse_args()
    stopping = stop_requests()
    places = addresses_from(read_scenario(arguments.run_dir).get("firmware", {}))
    bus = None if arguments.bus is None else addressed(join(arguments.bus, stamped=True), places)
    settle_garbage()
    report_to_parent(READY)
    read_start()
    os.nice(NICENESS)
    times = None if arguments.turn_times is None else TurnTimes(arguments.turn_times)
    recorder = Recorder(arguments.run_dir, bus, times)
    lost_before = 0 if bus is None else bus.counters.lost
    record(recorder, [stopping.fileno(), sys.stdin.fileno()])
    lost = None if bus is None else bus.counters.lost - lost_before
    if bus is not None:
        bus.close()
    report_to_parent(json.dumps({"frames": recorder.frames, "lost": lost}))


if __name__ == "__main__":
    main()
