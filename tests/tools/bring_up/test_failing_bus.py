"""A bus that fails in a bring-up: an adapter that dies in each step, and samples that are lost.

After a death the module rests, a status says why, and the step is repeated.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware_py.interface import codec
from firmware_py.interface.enums import AxisError, AxisState
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import Accelerometer, DriveHeartbeat, EncoderEstimates
from firmware_py.shell.parameters import with_overrides
from hil.bus import BusFailedError
from hil.bus.base import NodeBus
from hil.bus.log.can_log import CanLog
from hil.drive.axis import disarm
from hil.timing.clock import TICK_S
from tools.bring_up.lockstep import LockstepBench
from tools.bring_up.module_fit import SMOOTHED, TURNING_RAD_S, fit_module, read_turning
from tools.bring_up.operated import ErrorCleared, Operated, operate
from tools.bring_up.session import Session, User, read_state
from tools.bring_up.step import Context, Player, StepFailedError
from tools.bring_up.trials import bench_of, beyond_bounds, brought_up

DIES_RAD_S = {"listen": 0.0, "at-rest": 0.0, "drive": 1.0, "below-impacts": 2.0, "first-impacts": 5.0}
"""The steps that use the bus, and the crank's speed at which the adapter dies."""


class DyingAdapter:
    """A line to the bus that carries nothing once the crank is faster than `speed_rad_s`."""

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


def dying_play(bench: LockstepBench, name: str, speed_rad_s: float) -> Callable[..., None]:
    """The bench's `play`, with an adapter that dies while the log of this name is written."""
    line, play = bench.own, bench.play

    def play_on(player: Any, longest_s: float, log: Path, parameters: Any = None) -> None:
        if log.stem == name:
            bench.own = DyingAdapter(line, bench, speed_rad_s)
        play(player, longest_s, log, parameters)

    return play_on


def test_an_adapter_that_dies_in_a_step_leaves_the_module_at_rest(tmp_path: Path) -> None:
    """The firmware falls silent with the adapter, no E-stop passes it, and the drive's watchdog remains."""
    bench, folder = bench_of({}, [], 1), tmp_path / "out"
    line, play = bench.own, bench.play
    for name, speed_rad_s in DIES_RAD_S.items():
        bench.play = dying_play(bench, name, speed_rad_s)  # type: ignore[method-assign]
        with pytest.raises(BusFailedError, match="the device is gone"):
            brought_up(bench, folder, "first-impacts")
        bench.own, bench.play = line, play  # type: ignore[method-assign]
        bench.rest(15.0)
        last = read_state(folder).records[-1]
        assert (last["name"], last["passed"]) == (name, False)
        assert "the bus has failed" in last["reason"]
        assert bench.plant.node.drive.axis.state == AxisState.IDLE
        assert abs(bench.plant.node.plant.now.omega_rad_s) < 0.1
    result = brought_up(bench, folder, "first-impacts")
    assert result["passed"], result["steps"][-1]["reason"]
    assert beyond_bounds(bench, result["steps"]) == []


@pytest.mark.parametrize(
    ("error", "is_cleared"),
    [
        (AxisError.ESTOP_REQUESTED, True),
        (AxisError.ESTOP_REQUESTED | AxisError.DRV_FAULT, False),
        (AxisError.WATCHDOG_TIMER_EXPIRED, False),
        (0, False),
    ],
)
def test_no_other_error_of_the_drive_is_cleared(error: int, is_cleared: bool) -> None:
    beat = DriveHeartbeat(*[0] * len(DriveHeartbeat._fields))._replace(axis_error=error)
    player = ErrorCleared(AxisError.ESTOP_REQUESTED)
    assert player.play(0, []) == ()
    assert player.play(1, [codec.DRIVE_HEARTBEAT.encode(beat)]) == ()
    sent = player.play(2, [codec.DRIVE_HEARTBEAT.encode(beat)])
    assert [one.can_id for one in sent or ()] == [codec.CLEAR_ERRORS.can_id] * is_cleared
    assert (sent is None) != is_cleared


class Reports:
    """A bench whose drive reports `error` until it is cleared; `played` has the players with a firmware."""

    def __init__(self, error: int) -> None:
        self.error = error
        self.played: list[Player] = []

    def play(self, player: Player, _longest_s: float, _log: Path, parameters: Any = None) -> None:
        """Report the error in each period."""
        if parameters:
            self.played.append(player)
            return
        for tick in range(100):
            beat = DriveHeartbeat(*[0] * len(DriveHeartbeat._fields))._replace(axis_error=self.error)
            frames = player.play(tick, [codec.DRIVE_HEARTBEAT.encode(beat)])
            if frames is None:
                return
            self.error = 0 if frames else self.error


@pytest.mark.parametrize(
    ("error", "agrees", "reason"),
    [
        (AxisError.WATCHDOG_TIMER_EXPIRED, True, ""),
        (AxisError.WATCHDOG_TIMER_EXPIRED, False, "WATCHDOG_TIMER_EXPIRED"),
        (AxisError.ESTOP_REQUESTED, True, ""),
        (AxisError.ESTOP_REQUESTED, False, "ESTOP_REQUESTED"),
        (0x80, True, "0x80"),
        (AxisError.DRV_FAULT | AxisError.ESTOP_REQUESTED, True, "DRV_FAULT, ESTOP_REQUESTED"),
    ],
)
def test_an_error_of_the_drive_is_cleared_after_a_yes_or_named(
    error: int, agrees: bool, reason: str, tmp_path: Path
) -> None:
    bench, player = Reports(error), Operated([], 0.0)
    context = Context(bench, tmp_path, {"any": 0.0}, {}, lambda _: agrees, lambda _: None, 1.25)
    if reason:
        with pytest.raises(StepFailedError, match=f"the drive reports {reason}: "):
            operate(context, player, tmp_path / "motion.log", context.values)
    else:
        operate(context, player, tmp_path / "motion.log", context.values)
    assert bench.played == ([] if reason else [player])


@pytest.mark.parametrize(
    ("error", "is_yes"),
    [
        (AxisError.DRV_FAULT, True),
        (AxisError.WATCHDOG_TIMER_EXPIRED, False),
        (AxisError.ESTOP_REQUESTED, False),
        (AxisError.ESTOP_REQUESTED, True),
    ],
)
def test_the_drives_step_neither_arms_nor_clears_an_error_without_a_yes(
    error: AxisError, is_yes: bool, tmp_path: Path
) -> None:
    bench, asked = bench_of({}, [], 1), list[str]()
    node = bench.plant.node
    node.state = node.state._replace(drive=disarm(node.drive, error))

    def answer(question: str) -> bool:
        asked.append(question)
        return is_yes or question.startswith("Begin the step")

    user = User(lambda _: None, answer)
    result = Session(bench, tmp_path / "out", {}, 1.25, user).run(None, "drive")
    may_be_cleared = error != AxisError.DRV_FAULT
    assert [error.name in one for one in asked] == [False] + [True] * may_be_cleared
    if may_be_cleared and is_yes:
        assert result["passed"], result["steps"][-1]["reason"]
        return
    assert result["steps"][-1]["name"] == "drive"
    assert f"the drive reports {error.name}: " in result["steps"][-1]["reason"]
    assert (bench.plant.node.drive.axis.errors, bench.largest["before"].torque_n_m) == (error, 0.0)
    assert "drive" not in bench.largest


def test_a_damaged_heartbeat_is_passed_over() -> None:
    player, damaged = ErrorCleared(0), Frame(codec.DRIVE_HEARTBEAT.can_id, b"\x01")
    assert [player.play(tick, [damaged]) for tick in range(3)] == [()] * 3


class Shortened:
    """A line on which one frame of the accelerometers has lost its end."""

    def __init__(self, line: NodeBus) -> None:
        self._line, self._periods = line, 0
        self.send_all = line.send_all

    def receive(self) -> list[Frame]:
        """The frames that have arrived."""
        self._periods += 1
        frames = self._line.receive()
        if self._periods != 1000:
            return frames
        is_sample = [one.can_id == codec.ACCELEROMETER.can_id for one in frames]
        assert any(is_sample)
        return [
            one._replace(data=one.data[:3]) if it else one for one, it in zip(frames, is_sample, strict=True)
        ]


def test_a_damaged_sample_is_one_lost_sample(tmp_path: Path) -> None:
    bench = bench_of({}, [], 1)
    bench.own = Shortened(bench.own)
    step = brought_up(bench, tmp_path / "out", "listen")["steps"][0]
    assert step["passed"], step["reason"]
    figures = {one["name"]: one["value"] for one in step["figures"]}
    assert figures["lost samples"] == pytest.approx(1 / 3000, rel=0.01)


def test_pieces_between_lost_samples_are_read_where_the_crank_turns(tmp_path: Path) -> None:
    """A piece that is shorter than the average of the speed shows no speed."""
    log, lost = tmp_path / "steps.log", {400, 402, 450}
    write_motion(log, [0.5e-3 * tick for tick in range(1000)], lost)
    pieces = read_turning([log], with_overrides({})).pieces
    assert [begin for begin, _ in pieces] == [0, 451]
    assert [end for _, end in pieces] == [400, 1000]


@pytest.mark.parametrize(
    ("every", "reason"), [(134, "150 samples were lost"), (50, "400 samples"), (10_000, "hardly moves")]
)
def test_a_striker_is_not_called_stuck_where_lost_samples_cut_its_motion_to_pieces(
    every: int, reason: str, tmp_path: Path
) -> None:
    """Of pieces in which the crank turns by less than a turn, none shows whether the striker moves."""
    log = tmp_path / "steps.log"
    write_motion(log, [0.5e-3 * tick for tick in range(20_000)], set(range(1, 20_000, every)))
    with pytest.raises(StepFailedError, match=reason):
        fit_module([log], with_overrides({}), is_slow=True)


def test_a_lost_sample_is_not_blamed_for_a_crank_that_rests(tmp_path: Path) -> None:
    log = tmp_path / "rest.log"
    write_motion(log, [0.25] * 3000, {500})
    with pytest.raises(StepFailedError, match="the crank has not turned"):
        fit_module([log], with_overrides({}), is_slow=True)


def test_a_crank_that_only_twitches_does_not_turn(tmp_path: Path) -> None:
    """The part in which its averaged speed exceeds the limit is shorter than the average itself."""
    turned_rev, log = 1.1 * TURNING_RAD_S * SMOOTHED * TICK_S / (2.0 * math.pi), tmp_path / "twitch.log"
    angles_rev = np.interp(
        np.arange(2000), [0, 1000, 1400, 1400 + SMOOTHED], [0.0, 0.5, 0.5, 0.5 + turned_rev]
    )
    write_motion(log, angles_rev.tolist(), set())
    ((_, end),) = read_turning([log], with_overrides({})).pieces
    assert end == pytest.approx(1000, abs=SMOOTHED)


def write_motion(log: Path, angles_rev: Sequence[float], lost: set[int]) -> None:
    """Write the frames of a crank with these angles, without those of the `lost` ticks."""
    with CanLog(log) as file:
        for tick in sorted(set(range(len(angles_rev))) - lost):
            angle_rev = angles_rev[tick]
            frames = [
                codec.ACCELEROMETER.encode(Accelerometer(0.01 * (tick % 7), 0.0, 0.0), tick % 256),
                codec.ENCODER_ESTIMATES.encode(EncoderEstimates(angle_rev, 0.5)),
            ]
            file.write(1000 * tick, frames)
