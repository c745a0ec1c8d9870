"""A bus in real time: the steps are a node on it, and the firmware is a process beside them."""

import select
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from firmware_py.interface.addresses import Addresses
from hil.bus import BusFailedError, open_bus
from hil.bus.addressed import addressed
from hil.bus.base import Bus
from hil.bus.can_log import CanLog
from hil.record.new_file import make_anew
from hil.timing.clock import NS_PER_S, MonotonicClock
from hil.timing.loop import FixedRateLoop
from hil.timing.processes import Child
from tools.bring_up.bench import EMERGENCY, PERIOD_S, Player

STARTING_S = 120.0
"""Longest start of the firmware's process: it may have to compile."""
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
            if parameters is not None:
                stack.enter_context(FirmwareProcess(provided.address, parameters))
            bus.receive()
            self._play(bus, player, longest_s, stack.enter_context(CanLog(make_anew(log))))

    def _play(self, bus: Bus, player: Player, longest_s: float, file: CanLog) -> None:
        clock = MonotonicClock()
        begin_ns = clock.now_ns()
        loop = FixedRateLoop(clock, begin_ns, round(PERIOD_S * NS_PER_S))

        def step(tick: int) -> None:
            received = bus.receive()
            frames = player.play(tick, received)
            file.write((clock.now_ns() - begin_ns) // 1000, [*received, *(frames or ())])
            if frames is None:
                loop.stop()
                return
            bus.send_all(frames)

        try:
            loop.run(round(longest_s / PERIOD_S), step, None)
        except BaseException:
            if player.moves:
                bus.send_all(EMERGENCY)
            raise
        if bus.failure:
            raise BusFailedError(bus.failure)


class FirmwareProcess:
    """`vibrohil firmware` with these parameters on a bus, while the block runs."""

    def __init__(self, address: str, parameters: Mapping[str, float]) -> None:
        settings = [f"--set=firmware.{name}={value!r}" for name, value in parameters.items()]
        self._command = [sys.executable, "-m", "tools.cli", "firmware", "--bus", address, *settings]
        self._stack = ExitStack()

    def __enter__(self) -> "FirmwareProcess":
        folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="vibrohil-bring-up-")))
        self.child = Child("firmware", self._command, folder / "firmware.log")
        self._stack.callback(self.child.stop)
        deadline_s = time.monotonic() + STARTING_S
        while RUNNING not in self.child.last_errors():
            if self.child.ended or time.monotonic() > deadline_s:
                raise BusFailedError(f"{self.child.how_it_ended()}: {self.child.last_errors()}")
            select.select([], [], [], 0.05)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()
