"""Patient clocks: the order of times among processes, and who is not waited for."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest

from hil.timing.patient_clock import (
    MOST_BEHIND_NS,
    NEVER_NS,
    PatientClock,
    Row,
    RunTimes,
    shared_memory,
    words_of,
)

MS = 1_000_000

LOOP = """
import os, sys, time
from hil.timing.patient_clock import PatientClock, Row
clock = PatientClock(int(sys.argv[1]), Row[sys.argv[2]])
period, offset, ticks, slow = map(int, sys.argv[3:])
for tick in range(ticks):
    clock.sleep_until(offset + tick * period)
    at = clock.now_ns()
    if slow and tick % slow == 0:
        time.sleep(0.02)
    os.write(1, f"{at} {sys.argv[2]}\\n".encode())
clock.leave()
"""


@pytest.fixture
def shared() -> Iterator[int]:
    descriptor = shared_memory()
    yield descriptor
    os.close(descriptor)


def loop(shared: int, row: Row, output: int, *numbers: int) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-c", LOOP, str(shared), row.name, *map(str, numbers)]
    return subprocess.Popen(command, stdout=output, pass_fds=[shared])


def without_recorder(shared: int) -> None:
    words_of(shared)[Row.RECORDER] = NEVER_NS


def test_events_come_in_the_order_of_their_times_however_slow_a_process_is(shared: int) -> None:
    without_recorder(shared)
    readable, writable = os.pipe()
    children = [
        loop(shared, Row.PLANT, writable, MS, 0, 300, 70),
        loop(shared, Row.FIRMWARE, writable, MS, MS // 2, 300, 0),
        loop(shared, Row.OPERATOR, writable, 10 * MS, MS // 4, 30, 0),
    ]
    os.close(writable)
    with os.fdopen(readable) as lines:
        events = [(int(at), name) for at, name in map(str.split, lines)]
    assert [child.wait() for child in children] == [0, 0, 0]
    expected = [(tick * MS, "PLANT") for tick in range(300)]
    expected += [(tick * MS + MS // 2, "FIRMWARE") for tick in range(300)]
    expected += [(10 * tick * MS + MS // 4, "OPERATOR") for tick in range(30)]
    assert events == sorted(expected)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_process_that_is_gone_holds_up_nobody(shared: int, number: signal.Signals) -> None:
    without_recorder(shared)
    words_of(shared)[Row.OPERATOR] = NEVER_NS
    child = loop(shared, Row.PLANT, subprocess.DEVNULL, MS, 0, 1_000_000, 0)
    clock = PatientClock(shared, Row.FIRMWARE)
    clock.sleep_until(5 * MS)
    child.send_signal(number)
    began_s = time.monotonic()
    clock.sleep_until(1_000 * MS)
    clock.sleep_until(2_000 * MS)
    assert time.monotonic() - began_s < 5.0
    child.kill()
    child.wait()


def test_a_process_that_was_stopped_comes_back_late(shared: int) -> None:
    without_recorder(shared)
    words_of(shared)[Row.OPERATOR] = NEVER_NS
    readable, writable = os.pipe()
    child = loop(shared, Row.PLANT, writable, MS, 0, 1_000_000, 0)
    os.close(writable)
    clock = PatientClock(shared, Row.FIRMWARE)
    for tick in range(1, 6):
        clock.sleep_until(tick * MS)
    child.send_signal(signal.SIGSTOP)
    clock.sleep_until(100 * MS)
    words_of(shared)[Row.FIRMWARE] = 120 * MS
    child.send_signal(signal.SIGCONT)
    with os.fdopen(readable) as lines:
        times = [int(next(lines).split()[0]) for _ in range(20)]
    child.kill()
    child.wait()
    late = [at for at in times if at > 50 * MS]
    assert late[0] == 120 * MS
    assert times[: times.index(late[0])] == [tick * MS for tick in range(times.index(late[0]))]


def test_nobody_runs_further_ahead_of_the_recorder_than_it_allows(shared: int) -> None:
    words = words_of(shared)
    words[Row.FIRMWARE] = words[Row.OPERATOR] = NEVER_NS
    times = RunTimes(shared, 0)
    child = loop(shared, Row.PLANT, subprocess.DEVNULL, MS, 0, 1_000_000, 0)
    while words[Row.PLANT] < MOST_BEHIND_NS:
        time.sleep(0.01)
    time.sleep(0.1)
    assert words[Row.PLANT] == MOST_BEHIND_NS + MS
    times.has_caught_up()
    while words[Row.PLANT] < 2 * MOST_BEHIND_NS:
        time.sleep(0.01)
    child.kill()
    child.wait()


def test_what_the_kernel_stamped_is_dated_between_the_plant_s_wake_ups(shared: int) -> None:
    words = words_of(shared)
    words[Row.FIRMWARE] = words[Row.OPERATOR] = NEVER_NS
    times = RunTimes(shared, 2 * MS)
    before_ns = time.time_ns()
    assert times.since_start_ns(np.array([before_ns])).tolist() == [-1]
    clock = PatientClock(shared, Row.PLANT)
    stamps = []
    for tick in range(2, 6):
        clock.sleep_until(tick * MS)
        time.sleep(0.01)
        stamps.append(time.time_ns())
    words[Row.PLANT] = 6 * MS
    dated = times.since_start_ns(np.array([before_ns, *stamps]))
    assert dated[0] == -1
    assert np.all(np.diff(dated[1:]) > 0)
    for tick, at in enumerate(dated[1:].tolist()):
        assert tick * MS <= at <= (tick + 1) * MS
