"""A bare sleep loop beside a run: what this machine does to a loop that does nothing.

`python -m hil.baseline --ticks N` waits for the start time on standard input like the nodes, sleeps through
its ticks with their settings, and prints what it missed. Its deadlines lie a quarter of a tick before the
plant's, where no node wakes up.
"""

import argparse
import json
import signal

from hil.clock import NS_PER_S, MonotonicClock
from hil.loop import FixedRateLoop, LoopTiming
from hil.processes import read_start
from hil.realtime import BASELINE, become_realtime, die_with_parent

PERIOD_NS = NS_PER_S // 1000


def main() -> None:
    """Sleep, and say how it went."""
    parser = argparse.ArgumentParser(description="A bare sleep loop at 1 kHz.")
    parser.add_argument("--ticks", type=int, required=True)
    ticks: int = parser.parse_args().ticks
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    become_realtime(BASELINE)
    print("ready", flush=True)
    loop = FixedRateLoop(MonotonicClock(), read_start().t0_ns, PERIOD_NS, offset_ns=3 * PERIOD_NS // 4)
    signal.signal(signal.SIGTERM, lambda *_: loop.stop())
    late_wakeups = 0

    def record(_: int, timing: LoopTiming) -> None:
        nonlocal late_wakeups
        late_wakeups += timing.wake_latency_us * 1000 > PERIOD_NS / 2

    loop.run(ticks, lambda *_: None, record)
    print(json.dumps({"overruns": loop.overruns, "late_wakeups": late_wakeups}), flush=True)


if __name__ == "__main__":
    main()
