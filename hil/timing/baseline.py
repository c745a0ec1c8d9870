"""A bare sleep loop beside a run: the timing of an idle loop on this machine.

`python -m hil.timing.baseline --ticks N` waits for the start time on standard input like the nodes, sleeps
until each tick with the nodes' scheduling settings, and prints its overruns. Its deadlines lie a quarter of a
tick before the plant's, where no node wakes up.
"""

import argparse
import json
import signal

from hil.timing.clock import NS_PER_S, Clock, MonotonicClock
from hil.timing.loop import FixedRateLoop
from hil.timing.processes import READY, read_start, report_to_parent
from hil.timing.realtime import BASELINE, become_realtime, die_with_parent

PERIOD_NS = NS_PER_S // 1000


class BareLoop:
    """A loop at 1 kHz that does nothing, from `t0_ns` of its clock on."""

    def __init__(self, clock: Clock, t0_ns: int) -> None:
        self._loop = FixedRateLoop(clock, t0_ns, PERIOD_NS, offset_ns=3 * PERIOD_NS // 4)
        self.stop = self._loop.stop

    @property
    def overruns(self) -> int:
        """Number of skipped ticks."""
        return self._loop.overruns

    def run(self, ticks: int) -> None:
        """Run for `ticks`, or until `stop`."""
        self._loop.run(ticks, lambda *_: None, None)


def main() -> None:
    """Run the loop and report its overruns."""
    parser = argparse.ArgumentParser(description="A bare sleep loop at 1 kHz.")
    parser.add_argument("--ticks", type=int, required=True)
    ticks: int = parser.parse_args().ticks
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    become_realtime(BASELINE)
    report_to_parent(READY)
    start = read_start()
    loop = BareLoop(MonotonicClock(), start.t0_ns)
    signal.signal(signal.SIGTERM, lambda *_: loop.stop())
    loop.run(ticks)
    report_to_parent(json.dumps({"overruns": loop.overruns}))


if __name__ == "__main__":
    main()
