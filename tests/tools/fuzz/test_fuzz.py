"""Fuzzing finds nothing in the nodes as they are, and finds what is put into them."""

import itertools
import json
from typing import Any

import pytest

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError
from firmware_py.interface.frame import Frame, WordFrame
from firmware_py.interface.generated import unpacking
from firmware_py.node import tick
from hil.drive import axis as drive
from tools.cli import run
from tools.fuzz import frames as fuzz
from tools.fuzz import kills as fuzz_kills


def test_sixty_thousand_frames_do_no_harm(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["fuzz", "frames", "--count", "60000", "--seed", "7", "--json"]) == 0
    outcome = json.loads(capsys.readouterr().out)
    assert outcome["failures"] == []
    assert outcome["frames"] >= 60000
    assert outcome["frames"] == outcome["taken"] + outcome["dropped"] + outcome["not_addressed"]
    assert outcome["dropped"] > 1000
    assert outcome["ticks_with_torque"] > 100


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
    assert any("the drive gave" in failure.what for failure in fuzz.fuzz(300_000, 1).failures)


def test_an_exception_is_found_and_its_life_can_be_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    unpack = unpacking.unpack_drive_temperature

    def touchy(length: int, word: int) -> Any:
        record, reason = unpack(length, word)
        if record.motor_degc > 1e6:
            raise OverflowError("too hot to count")
        return record, reason

    monkeypatch.setattr(unpacking, "unpack_drive_temperature", touchy)
    found = fuzz.fuzz(300_000, 1).failures[0]
    assert found.what == "OverflowError: too hot to count"
    assert fuzz.one_life(found.seed).failures == (found,)


def test_a_frame_that_nobody_counts_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    receive = tick.receive

    def deaf(tick_s: float, before: Any, requests: Any, counters: Any, now: int, frame: WordFrame) -> Any:
        if frame.length == 1:
            return before, requests, counters, False
        return receive(tick_s, before, requests, counters, now, frame)

    monkeypatch.setattr(tick, "receive", deaf)
    assert "frames for the firmware" in fuzz.fuzz(30_000, 1).failures[0].what


def test_every_kind_of_kill_comes_once_before_any_comes_again() -> None:
    # The program at each stage: in real time, in lockstep, of a suite, of a campaign; until the end five
    # other processes of a run, and a worker of each.
    kinds = 4 * 5 * 4 + 5 * 5 * 3 + 2 * 5 * 3
    first = list(itertools.islice(fuzz_kills.kills(3), kinds))
    assert len({(kill.of, kill.process, kill.number, kill.stage) for kill in first}) == kinds
    assert first == list(itertools.islice(fuzz_kills.kills(3), kinds))


@pytest.mark.realtime
def test_some_kills_leave_nothing_but_a_verdict() -> None:
    assert fuzz_kills.fuzz_kills(4, seed=1, progress=lambda _: None) == []
