"""A bus that fails in a bring-up: an adapter that dies in each step, and samples that are lost.

After a death the module rests, a status says why, and the step is repeated.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from firmware_py.interface import codec
from firmware_py.interface.enums import AxisState
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import Accelerometer, EncoderEstimates
from firmware_py.shell.parameters import with_overrides
from hil.bus import BusFailedError
from hil.bus.base import NodeBus
from hil.bus.can_log import CanLog
from tools.bring_up.lockstep import LockstepBench
from tools.bring_up.module_fit import read_turning
from tools.bring_up.session import read_state
from tools.bring_up.trials import bench_of, beyond_bounds, brought_up

LOGS = {
    "listen": ("listen", 0.0),
    "at-rest": ("at-rest", 0.0),
    "drive": ("drive", 1.0),
    "below-impacts": ("below-impacts", 3.0),
    "first-impacts": ("first-impacts", 7.0),
    "hold": ("first-impacts", 11.0),
}
"""Logs of the steps that use the bus: the step of each, and the speed in rad/s at which the adapter dies."""


class DyingAdapter:
    """A line to the bus that carries nothing once the crank is faster than `speed_rad_s` after some periods."""

    def __init__(self, line: NodeBus, bench: LockstepBench, speed_rad_s: float) -> None:
        self._line, self._bench, self._speed_rad_s = line, bench, speed_rad_s
        self._periods = 0
        self.is_dead = False

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Send the frames, or lose them, those of an E-stop too."""
        if not self.is_dead:
            self._line.send_all(frames)

    def receive(self) -> list[Frame]:
        """The frames that have arrived; raises BusFailedError."""
        self._periods += 1
        is_fast = abs(self._bench.plant.node.plant.now.omega_rad_s) >= self._speed_rad_s
        self.is_dead = self.is_dead or (is_fast and self._periods > 500)
        if self.is_dead:
            raise BusFailedError("the adapter has failed: the device is gone")
        return self._line.receive()


def test_an_adapter_that_dies_in_a_step_leaves_the_module_at_rest(tmp_path: Path) -> None:
    """The firmware falls silent with the adapter, no E-stop passes it, and the drive's watchdog remains."""
    bench, folder = bench_of({}, [], 1), tmp_path / "out"
    line, play = bench.own, bench.play
    for name, (step, speed_rad_s) in LOGS.items():

        def dying(player: Any, longest_s: float, log: Path, *others: Any, name: str = name) -> None:
            if log.stem == name:
                bench.own = DyingAdapter(line, bench, LOGS[name][1])
            play(player, longest_s, log, *others)

        bench.play = dying  # type: ignore[method-assign]
        with pytest.raises(BusFailedError, match="the device is gone"):
            brought_up(bench, folder, "first-impacts")
        bench.own, bench.play = line, play  # type: ignore[method-assign]
        bench.rest(15.0)
        last = read_state(folder).records[-1]
        assert (last["name"], last["passed"]) == (step, False)
        assert "the bus has failed" in last["reason"]
        assert bench.plant.node.drive.axis.state == AxisState.IDLE
        assert abs(bench.plant.node.plant.now.omega_rad_s) < 0.1, name
    result = brought_up(bench, folder, "first-impacts")
    assert result["passed"], result["steps"][-1]["reason"]
    assert beyond_bounds(bench, result["steps"]) == []


def test_pieces_between_lost_samples_are_read_where_the_crank_turns(tmp_path: Path) -> None:
    """A piece that is shorter than the average of the speed shows no speed."""
    log, lost = tmp_path / "steps.log", {400, 402, 450}
    with CanLog(log) as file:
        for tick in set(range(1000)) - lost:
            angle_rev = 0.5e-3 * tick
            frames = [
                codec.ACCELEROMETER.encode(Accelerometer(0.01 * (tick % 7), 0.0, 0.0), tick % 256),
                codec.ENCODER_ESTIMATES.encode(EncoderEstimates(angle_rev, 0.5)),
            ]
            file.write(1000 * tick, frames)
    pieces = read_turning([log], with_overrides({})).pieces
    assert [begin for begin, _ in pieces] == [0, 451]
    assert [end for _, end in pieces] == [400, 1000]
