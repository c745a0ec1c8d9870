"""A bare sleep loop beside a run: the timing of an idle loop on this machine.

`python -m hil.processes.baseline --ticks N` waits for the start time on standard input like the nodes, sleeps
until each tick with the nodes' scheduling settings, and prints its overruns. Its deadlines lie a quarter of a
tick before the plant's, where no node wakes up.
"""

import argparse
import json
import signal

from hil.processes.child import READY, read_start, report_to_parent
from hil.timing.clock import NS_PER_S, MonotonicClock
from hil.timing.loop import FixedRateLoop
from hil.timing.realtime import BASELINE, become_realtime, die_with_parent

PERIOD_NS = NS_PER_S // 1000


def main() -> None:
    """Run the loop and report its overruns."""
    parser = argparse.ArgumentParser(description="A bare sleep loop at 1 kHz.")
    parser.add_argument("--ticks", type=int, required=True)
    ticks: int = parser.parse_args().ticks
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    become_realtime(BASELINE)
    report_to_parent(READY)
    loop = FixedRateLoop(MonotonicClock(), read_start().t0_ns, PERIOD_NS, offset_ns=3 * PERIOD_NS // 4)
    signal.signal(signal.SIGTERM, lambda *_: loop.stop())
    loop.run(ticks, lambda tick: tick + 1, None)
    report_to_parent(json.dumps({"overruns": loop.overruns}))


if __name__ == "__main__":
    main()
