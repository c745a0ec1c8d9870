"""Fuzzing finds nothing in the nodes as they are, and finds what is put into them."""

import itertools
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fuzzing import frames as fuzz
from fuzzing import kill as killing
from fuzzing import kills as fuzz_kills
from fuzzing import queue_kills

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError
from firmware_py.interface.frame import Frame, WordFrame
from firmware_py.interface.generated import unpacking
from firmware_py.node import tick
from hil.bench.workers import Workers
from hil.drive import axis as drive


def test_random_frames_do_no_harm(pytestconfig: pytest.Config) -> None:
    """No exception, no torque beyond its limit, and every frame counted."""
    count = pytestconfig.getoption("fuzz_count") or 60_000
    outcome = fuzz.fuzz(count, pytestconfig.getoption("fuzz_seed"))
    assert outcome.failures == ()
    assert outcome.frames >= count
    assert outcome.frames == outcome.taken + outcome.dropped + outcome.not_addressed
    assert outcome.dropped > 1000
    assert outcome.ticks_with_torque > 100


def test_all_kinds_of_strangers_come() -> None:
    strangers = fuzz.Strangers(3)
    strangers.seen = [Frame(0x123, bytes(range(8)))]
    accepted = refused = unknown = 0
    for frame in strangers.burst(4000):
        try:
            codec.decode(frame)
            accepted += 1
        except FrameError as error:
            unknown += error.reason == codec.FrameErrorReason.UNKNOWN_ID
            refused += error.reason != codec.FrameErrorReason.UNKNOWN_ID
    assert min(accepted, refused, unknown) > 400


def test_a_mutation_is_one_to_three_bits_a_shorter_frame_or_a_repetition() -> None:
    frame = Frame(0x123, bytes(8))
    changes = [fuzz.mutated(frame, number) for number in range(1000)]
    assert frame in changes
    assert any(len(changed.data) < 8 for changed in changes)
    bits = {sum(byte.bit_count() for byte in changed.data) for changed in changes if len(changed.data) == 8}
    assert bits <= {0, 1, 2, 3}
    assert 3 in bits


def test_a_torque_beyond_its_limit_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drive, "torque_n_m", lambda _, state, __: state.setpoint.torque_n_m)
    assert any("the drive gave" in failure.what for failure in fuzz.one_life(2).failures)


def test_an_exception_is_found_and_its_life_can_be_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    unpack = unpacking.unpack_drive_temperature

    def touchy(length: int, word: int) -> Any:
        record, reason = unpack(length, word)
        if record.motor_degc > 1e6:
            raise OverflowError("too hot to count")
        return record, reason

    monkeypatch.setattr(unpacking, "unpack_drive_temperature", touchy)
    found = fuzz.fuzz(1, 2).failures[0]
    assert found.what == "OverflowError: too hot to count"
    assert fuzz.one_life(found.seed).failures == (found,)


def test_a_frame_that_nobody_counts_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    receive = tick.receive

    def deaf(now: Any, before: Any, counters: Any, frame: WordFrame) -> Any:
        if frame.length == 1:
            return before, counters, False
        return receive(now, before, counters, frame)

    monkeypatch.setattr(tick, "receive", deaf)
    assert "frames for the firmware" in fuzz.fuzz(30_000, 1).failures[0].what


def test_every_kind_of_kill_comes_once_before_any_comes_again() -> None:
    # The program at each stage: in real time, in lockstep, of a suite, of a campaign; until the end five
    # other processes of a run, and a worker of each; a campaign writes no report.
    kinds = 4 * 5 * 4 - 5 + 5 * 5 * 3 + 2 * 5 * 3
    first = list(itertools.islice(fuzz_kills.kills(3), kinds))
    assert len({(kill.of, kill.process, kill.number, kill.stage) for kill in first}) == kinds
    assert first == list(itertools.islice(fuzz_kills.kills(3), kinds))


def idle(_: int) -> int:
    return os.getpid()


def test_kills_find_the_workers_of_a_suite_and_a_campaign_as_they_are_started() -> None:
    with Workers(idle, 1) as some:
        pid = dict(some.results([1]))[1]
        assert queue_kills.worker_of(SimpleNamespace(pid=os.getpid())) == pid
    assert queue_kills.worker_of(SimpleNamespace(pid=os.getpid())) == 0


@pytest.mark.parametrize("of", fuzz_kills.QUEUES)
def test_a_kill_without_a_victim_is_a_failure(of: str, monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def already_over(arguments: list[str], folder: Path) -> Iterator["subprocess.Popen[bytes]"]:
        (folder / "tmp").mkdir()
        (folder / "said").write_text("")
        program = subprocess.Popen([sys.executable, "-c", ""])
        program.wait()
        yield program

    monkeypatch.setattr(killing, "begun", already_over)
    kill = killing.Kill(of, queue_kills.WORKER, signal.SIGKILL, "middle", 0.0)
    assert killing.NO_VICTIM in queue_kills.killed_queue(kill)


@pytest.mark.realtime
def test_kills_leave_nothing_but_a_verdict(pytestconfig: pytest.Config) -> None:
    """The first two are of a campaign's worker and of a suite's program."""
    count = pytestconfig.getoption("fuzz_count") or 2
    assert fuzz_kills.fuzz_kills(count, pytestconfig.getoption("fuzz_seed")) == []
