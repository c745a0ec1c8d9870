"""A bring-up in real time: its steps begin with the frames sent from then on, and its firmware ends."""

import io
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from firmware_py.interface import codec
from firmware_py.interface.addresses import DEFAULT
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import Accelerometer
from hil.bus import BusFailedError
from tools import cli
from tools.bring_up import real, session
from tools.bring_up.listen import LISTEN
from tools.bring_up.step import Context, Findings, StepFailedError


class Waiting:
    """A bus on which frames have waited since it was opened, more than one read takes."""

    failure = ""

    def __init__(self) -> None:
        self.reads = [[Frame(codec.ACCELEROMETER.can_id, bytes(codec.ACCELEROMETER.length))] * 50] * 7

    def receive(self) -> list[Frame]:
        return self.reads.pop() if self.reads else []

    def send_all(self, frames: Sequence[Frame]) -> None:
        assert not frames


class First:
    """Keeps what it receives in its first period, and ends."""

    moves = False
    step_ticks = 1
    received: Sequence[Frame] | None = None

    def play(self, _: int, received: Sequence[Frame]) -> None:
        self.received = received


class Counting:
    """Notes the periods in which it acts, while many frames arrive; and what stands in the log."""

    FRAMES = 10_000
    moves = False

    def __init__(self, step_ticks: int, bus: Waiting, log: Path) -> None:
        self.step_ticks, self._bus, self._log = step_ticks, bus, log
        self.ticks: list[int] = []
        self.written_bytes = 0

    def play(self, tick: int, _: Sequence[Frame]) -> Sequence[Frame]:
        self.ticks.append(tick)
        self.written_bytes = max(self.written_bytes, self._log.stat().st_size)
        self._bus.reads = [[Frame(codec.ENCODER_ESTIMATES.can_id, bytes(8))] * self.FRAMES]
        return ()


class Punctual:
    """A clock on which every sleep ends on time, at once."""

    def __init__(self) -> None:
        self.time_ns = 0

    def now_ns(self) -> int:
        return self.time_ns

    def sleep_until(self, deadline_ns: int) -> None:
        self.time_ns = max(self.time_ns, deadline_ns)


class Raising:
    """Fails in the period in which the first frame arrives."""

    moves = False
    step_ticks = 1

    def play(self, _: int, received: Sequence[Frame]) -> Sequence[Frame]:
        if received:
            raise StepFailedError("stopped")
        return ()


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Waiting:
    """The bus of a `RealBench` on a clock that never waits, without real-time priority."""
    bus = Waiting()

    @contextmanager
    def opened(_: str) -> Iterator[tuple[SimpleNamespace, Waiting]]:
        yield SimpleNamespace(address=""), bus

    monkeypatch.setattr(real, "open_bus", opened)
    monkeypatch.setattr(real, "become_realtime", lambda _: None)
    monkeypatch.setattr(real, "leave_realtime", lambda: None)
    monkeypatch.setattr(real, "MonotonicClock", Punctual)
    return bus


def test_a_step_receives_nothing_that_was_sent_before_it(tmp_path: Path, bus: Waiting) -> None:
    player = First()
    real.RealBench("local", DEFAULT).play(player, 1.0, tmp_path / "log")
    assert player.received == []


@pytest.mark.parametrize(("step_ticks", "ticks"), [(1, [*range(30)]), (10, [0, 10, 20])])
def test_an_operator_wakes_every_ten_periods_and_a_killed_one_leaves_its_log(
    tmp_path: Path, bus: Waiting, step_ticks: int, ticks: list[int]
) -> None:
    """A wake-up of each period costs a machine a tenth of its time."""
    log = tmp_path / "log"
    player = Counting(step_ticks, bus, log)
    real.RealBench("local", DEFAULT).play(player, 0.03, log)
    assert player.ticks == ticks
    assert player.written_bytes > 0
    assert len(log.read_text().splitlines()) == (len(ticks) - 1) * Counting.FRAMES


def test_the_log_has_the_frames_that_end_a_step(
    tmp_path: Path, bus: Waiting, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(real, "discard_waiting", lambda _: None)
    with pytest.raises(StepFailedError):
        real.RealBench("local", DEFAULT).play(Raising(), 0.03, tmp_path / "log")
    assert len((tmp_path / "log").read_text().splitlines()) == 50


def lose(firmware: real.FirmwareProcess) -> None:
    """Miss the heartbeat of a firmware that ends."""
    with firmware:
        while not firmware.child.ended:
            time.sleep(0.01)
        raise StepFailedError("the heartbeat is missing")


def test_a_firmware_that_has_ended_is_named_with_its_last_words(monkeypatch: pytest.MonkeyPatch) -> None:
    says = "import sys; print('running at', file=sys.stderr); sys.exit('out of memory')"
    firmware = real.FirmwareProcess("", {})
    monkeypatch.setattr(firmware, "_command", [sys.executable, "-c", says])
    with pytest.raises(StepFailedError) as raised:
        lose(firmware)
    said = str(raised.value)
    assert said.startswith("the heartbeat is missing; firmware ended with status 1: ")
    assert said.endswith("out of memory")


@pytest.mark.parametrize(
    "data", [b"\x01", bytes(codec.ACCELEROMETER.length), b"\xff" * codec.ACCELEROMETER.length]
)
def test_a_damaged_sample_does_not_date_those_after_it(data: bytes) -> None:
    """A counter that its CRC does not confirm would shift all later times by a quarter of a second."""
    dating, times_us = real.Dating(), []
    for tick in range(20):
        sample = codec.ACCELEROMETER.encode(Accelerometer(0.0, 0.0, 0.0), tick + 100)
        damaged = sample._replace(data=data) if tick == 10 else sample
        times_us.append(dating.time_us(damaged, tick * 1e-3))
    assert times_us == [*range(0, 10_000, 1000), 9000, *range(11_000, 20_000, 1000)]


def test_a_firmware_that_does_not_start_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would drive the module once it has compiled, without an operator."""
    monkeypatch.setattr(real, "STARTING_S", 0.2)
    process = real.FirmwareProcess("local", {})
    monkeypatch.setattr(process, "_command", [sys.executable, "-c", "import time; time.sleep(60)"])
    with pytest.raises(BusFailedError, match="firmware is running"):
        process.__enter__()
    assert process.child.ended


def test_the_end_of_the_input_is_no_yes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And no error of the program, as which the step would be recorded."""
    answers: list[bool] = []

    def ask(context: Context, _: Findings) -> None:
        answers.append(context.asks("Clear the error?"))

    monkeypatch.setattr(session, "STEPS", (LISTEN._replace(run=ask), *session.STEPS[1:]))
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    cli.run(["bring-up", "--bus", "local", "--out", str(tmp_path / "out"), "--until", "listen"])
    assert answers == [False]
    assert session.read_state(tmp_path / "out").records[-1]["reason"] == ""
