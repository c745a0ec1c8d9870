"""The fixed-rate loop on a clock that a test drives, and the machine's clock."""

import signal
import time

import pytest

from hil.timing.clock import MonotonicClock
from hil.timing.loop import FixedRateLoop, LoopTiming

MS = 1_000_000


class FakeClock:
    """Wakes exactly on time unless the test says otherwise; work is time the test adds."""

    def __init__(self) -> None:
        self.time_ns = 0
        self.readings = 0
        self.late_ns: dict[int, int] = {}

    def now_ns(self) -> int:
        self.readings += 1
        return self.time_ns

    def sleep_until(self, deadline_ns: int) -> None:
        self.time_ns = max(self.time_ns, deadline_ns) + self.late_ns.pop(deadline_ns, 0)


class Probe:
    def __init__(self, clock: FakeClock, work_ns: dict[int, int]) -> None:
        self.clock = clock
        self.work_ns = work_ns
        self.steps: list[int] = []
        self.started_ns: list[int] = []
        self.timings: list[tuple[int, LoopTiming]] = []

    def step(self, tick: int) -> int:
        self.steps.append(tick)
        self.started_ns.append(self.clock.time_ns)
        self.clock.time_ns += self.work_ns.get(tick, 100_000)
        return tick + 1

    def record(self, tick: int, timing: LoopTiming) -> None:
        self.timings.append((tick, timing._replace(cpu_us=0.0)))  # CPU time is the real one


def run(
    ticks: int, work_ns: dict[int, int] | None = None, late_ns: dict[int, int] | None = None
) -> tuple[FixedRateLoop, Probe]:
    clock = FakeClock()
    clock.late_ns = late_ns or {}
    probe = Probe(clock, work_ns or {})
    loop = FixedRateLoop(clock, t0_ns=10 * MS, period_ns=MS, offset_ns=MS // 2)
    loop.run(ticks, probe.step, probe.record)
    return loop, probe


def test_ticks_start_on_absolute_deadlines() -> None:
    loop, probe = run(1000)
    assert probe.started_ns == [10 * MS + MS // 2 + tick * MS for tick in range(1000)]
    assert probe.steps == [*range(1000)]
    assert loop.overruns == 0
    assert probe.timings[3] == (3, LoopTiming(13 * MS + MS // 2, 0.0, 100.0, 0))


def test_clock_is_read_twice_a_tick() -> None:
    clock = FakeClock()
    probe = Probe(clock, {})
    FixedRateLoop(clock, 0, MS).run(50, probe.step, probe.record)
    assert clock.readings == 100


def test_a_step_names_the_next_one_and_without_a_record_the_clock_is_read_once() -> None:
    """Under user-mode Linux a wake-up and each reading take a fiftieth of a period."""
    clock, steps = FakeClock(), list[tuple[int, int]]()

    def step(tick: int) -> int:
        steps.append((tick, clock.time_ns))
        return tick + 10

    loop = FixedRateLoop(clock, 0, MS)
    loop.run(45, step, None)
    assert steps == [(tick, tick * MS) for tick in (0, 10, 20, 30, 40)]
    assert (loop.overruns, clock.readings) == (0, 5)


@pytest.mark.parametrize(
    ("work_ms", "late_by_ms", "skipped"),
    [
        (0.9, 0.0, 0),  # done in time
        (1.4, 0.4, 0),  # the next one starts late but before its successor's deadline: it runs
        (2.0, 0.0, 1),  # done on the successor's deadline: tick 6 is skipped, 7 is on time
        (2.5, 0.5, 1),
        (81.2, 0.2, 80),  # a pause of the whole machine
    ],
)
def test_long_work_skips_ticks_once_and_never_replays(
    work_ms: float, late_by_ms: float, skipped: int
) -> None:
    loop, probe = run(200, work_ns={5: int(work_ms * MS)})
    next_tick = 6 + skipped
    assert probe.steps[6] == next_tick
    assert probe.timings[6][1].wake_latency_us == pytest.approx(1e3 * late_by_ms)
    assert loop.overruns == skipped
    assert probe.steps == [*range(6), *range(next_tick, 200)]
    assert probe.timings[7][1].wake_latency_us == 0.0


def test_late_wake_up_skips_as_long_work_does() -> None:
    loop, probe = run(20, late_ns={10 * MS + MS // 2 + 4 * MS: 3 * MS + 1000})
    assert probe.steps[3:6] == [3, 7, 8]
    assert loop.overruns == 3


def test_pause_past_the_end_still_ends_with_the_last_tick() -> None:
    loop, probe = run(20, work_ns={5: 1000 * MS})
    assert probe.steps[-2:] == [5, 19]
    assert loop.overruns == 13


def test_stop_ends_after_the_current_tick() -> None:
    clock = FakeClock()
    loop = FixedRateLoop(clock, 0, MS)
    seen: list[int] = []

    def step(tick: int) -> int:
        seen.append(tick)
        if tick == 3:
            loop.stop()
        return tick + 1

    loop.run(None, step, lambda *_: None)
    assert seen == [0, 1, 2, 3]


def test_a_loop_that_is_stopped_in_its_sleep_does_not_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = FakeClock()
    loop, probe = FixedRateLoop(clock, 0, MS), Probe(clock, {})
    monkeypatch.setattr(clock, "sleep_until", lambda _: loop.stop())
    loop.run(10, probe.step, probe.record)
    assert probe.steps == []


def test_a_later_first_tick_has_its_own_deadline_and_skips_nothing() -> None:
    clock = FakeClock()
    probe = Probe(clock, {})
    loop = FixedRateLoop(clock, 0, MS)
    loop.run(8, probe.step, probe.record, first_tick=5)
    assert probe.steps == [5, 6, 7]
    assert probe.started_ns == [5 * MS, 6 * MS, 7 * MS]
    assert loop.overruns == 0


def test_a_signal_acts_in_a_sleep_which_then_continues() -> None:
    clock, acted_ns = MonotonicClock(), list[int]()
    before = signal.signal(signal.SIGALRM, lambda *_: acted_ns.append(clock.now_ns()))
    try:
        begin_ns = clock.now_ns()
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        clock.sleep_until(begin_ns + 200 * MS)
        clock.sleep_until(begin_ns)  # has passed
    finally:
        signal.signal(signal.SIGALRM, before)
    assert len(acted_ns) == 1
    assert begin_ns + 20 * MS <= acted_ns[0] < begin_ns + 200 * MS <= time.monotonic_ns()
