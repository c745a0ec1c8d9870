"""A bus in real time: the steps are a node on it, and the firmware is a process beside them."""

import select
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import ExitStack
from itertools import groupby
from pathlib import Path

from firmware_py.interface import codec
from firmware_py.interface.addresses import Addresses
from firmware_py.interface.codec import FrameError
from firmware_py.interface.frame import Frame
from hil.bus import BusFailedError, open_bus
from hil.bus.addressed import addressed
from hil.bus.base import Bus, discard_waiting
from hil.bus.log.can_log import CanLog
from hil.processes.child import Child
from hil.record.new_file import make_anew
from hil.timing.clock import NS_PER_S, TICK_S, MonotonicClock
from hil.timing.loop import FixedRateLoop
from hil.timing.realtime import NODE, RECORDING_OPERATOR, become_realtime, leave_realtime
from tools.bring_up.step import EMERGENCY, Player, StepFailedError

STARTING_S = 120.0
"""Longest start of the firmware's process: it may have to compile."""
COUNTERS = 256
"""Values of the accelerometers' rolling counter."""
RUNNING = "running at"
"""What the firmware's process says once it ticks."""


class RealBench:
    """The bus at `spec`; `places` are the module's node numbers."""

    def __init__(self, spec: str, places: Addresses) -> None:
        self._spec, self.places = spec, places

    def play(
        self, player: Player, longest_s: float, log: Path, parameters: Mapping[str, float] | None = None
    ) -> None:
        """See `Bench.play`."""
        with ExitStack() as stack:
            provided, bus = stack.enter_context(open_bus(self._spec))
            bus = addressed(bus, self.places)
            file = stack.enter_context(CanLog(make_anew(log)))
            if parameters is not None:
                stack.enter_context(FirmwareProcess(provided.address, parameters))
            # This may take most of a second, so the step begins after it.
            become_realtime(NODE if player.step_ticks == 1 else RECORDING_OPERATOR)
            stack.callback(leave_realtime)
            discard_waiting(bus)
            self._play(bus, player, longest_s, file)

    def _play(self, bus: Bus, player: Player, longest_s: float, file: CanLog) -> None:
        clock, dating = MonotonicClock(), Dating()
        begin_ns = clock.now_ns()
        loop = FixedRateLoop(clock, begin_ns, round(TICK_S * NS_PER_S))

        def step(tick: int) -> int:
            received = bus.receive()
            now_s = (clock.now_ns() - begin_ns) / NS_PER_S
            for time_us, its_frames in groupby(received, lambda frame: dating.time_us(frame, now_s)):
                file.write(time_us, its_frames)
            frames = player.play(tick, received)  # it may raise, for what the log then shows
            file.write(dating.newest_us, frames or ())
            if frames is None:
                loop.stop()
            else:
                bus.send_all(frames)
            return tick + player.step_ticks

        try:
            loop.run(round(longest_s / TICK_S), step, None)
        except BaseException:
            if player.moves:
                bus.send_all(EMERGENCY)
            raise
        if bus.failure:
            raise BusFailedError(bus.failure)


class Dating:
    """The times of frames by the accelerometers' rolling counter, which advances once in a period.

    Neither a late process nor an adapter that bundles its frames changes these times. Other frames, and
    damaged samples, have the time of the sample before them.
    """

    def __init__(self) -> None:
        self.newest_us = 0
        self._counter: int | None = None

    def time_us(self, frame: Frame, now_s: float) -> int:
        """The frame's time, for one received at `now_s` after the beginning."""
        if frame.can_id != codec.ACCELEROMETER.can_id:
            return self.newest_us
        try:
            codec.ACCELEROMETER.decode(frame.data)
        except FrameError:
            return self.newest_us
        counter = codec.ACCELEROMETER.counter(frame.data)
        if self._counter is None:
            self.newest_us = round(now_s * 1e6)
        else:
            lost_s = now_s - self.newest_us * 1e-6
            rounds = max(0, round((lost_s / TICK_S - COUNTERS / 2) / COUNTERS))
            periods = (counter - self._counter) % COUNTERS + COUNTERS * rounds
            self.newest_us += round(periods * TICK_S * 1e6)
        self._counter = counter
        return self.newest_us


class FirmwareProcess:
    """`vibrohil firmware` with these parameters on a bus, while the block runs."""

    def __init__(self, address: str, parameters: Mapping[str, float]) -> None:
        settings = [f"--set=firmware.{name}={value!r}" for name, value in parameters.items()]
        self._command = [sys.executable, "-P", "-m", "tools.cli", "firmware", "--bus", address, *settings]

    def __enter__(self) -> "FirmwareProcess":
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="vibrohil-bring-up-")))
            self.child = Child("firmware", self._command, folder / "firmware.log")
            stack.callback(self.child.stop)
            deadline_s = time.monotonic() + STARTING_S
            while RUNNING not in self.child.last_errors():
                if self.child.ended or time.monotonic() > deadline_s:
                    raise BusFailedError(f"{self.child.how_it_ended()}: {self.child.last_errors()}")
                select.select([], [], [], 0.05)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        """Raises StepFailedError with the firmware's last words if a step failed because it has ended."""
        ended = self.child.ended and f"{self.child.how_it_ended()}: {self.child.last_errors()}"
        self._stack.close()
        if ended and isinstance(error, StepFailedError):
            raise StepFailedError(f"{error}; {ended}") from error
