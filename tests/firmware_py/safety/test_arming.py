"""How the axis of the drive is closed and opened, seen by frames on the bus."""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest
from closed_loop import Bench, scene_with
from xcp_session import command

from firmware_py.interface import codec
from firmware_py.interface.enums import MOVING, AxisState, Fault, Mode, OperatorRequest, XcpCommandCode
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import (
    DriveEstop,
    DriveHeartbeat,
    DriveTemperature,
    FaultEvent,
    SetAxisState,
    SetControllerMode,
    SetInputTorque,
    SetLimits,
)

IDLE = SetAxisState(AxisState.IDLE)
CLOSED_LOOP = SetAxisState(AxisState.CLOSED_LOOP_CONTROL)
ARMING = (SetControllerMode, SetLimits)
REPEAT_TICKS = 20


def records(bench: Bench) -> list[object]:
    return [codec.decode(frame) for frame in bench.sent]


def arms(record: object) -> bool:
    return isinstance(record, ARMING) or record == CLOSED_LOOP


def until(bench: Bench, reached: Callable[[], bool], longest_s: float = 2.0) -> None:
    """Run to the tick in which `reached` first holds."""
    for _ in range(round(1000 * longest_s)):
        bench.run(0.001, keep=False)
        if reached():
            return
    raise AssertionError(f"not reached in {longest_s} s; the mode is {bench.node.outputs.mode.name}")


def in_soft_start(**tables: dict[str, Any]) -> Bench:
    """In the first tick of SOFT_START: the first arming frame has left, the axis is still idle."""
    bench = Bench(scene=scene_with(**tables)).started()
    until(bench, lambda: bench.node.outputs.mode == Mode.SOFT_START)
    assert any(map(arms, records(bench)))
    assert bench.axis_state == AxisState.IDLE
    return bench


def armed() -> Bench:
    """In SOFT_START with a closed axis that the firmware knows of."""
    bench = in_soft_start()
    until(bench, lambda: bench.node.outputs.torque_n_m != 0.0)
    return bench


@pytest.mark.parametrize("ticks_after", range(6))
def test_a_fault_right_after_run_arms_nothing(ticks_after: int) -> None:
    bench = in_soft_start()
    for _ in range(ticks_after):
        bench.run(0.001, keep=False)
    hot = codec.DRIVE_TEMPERATURE.encode(DriveTemperature(95.0, 30.0))
    bench.change = lambda _, frames: [*frames, hot]
    for tick in range(300):
        bench.run(0.001, keep=False)
        assert bench.node.outputs.fault == Fault.OVERTEMPERATURE
        assert not any(map(arms, records(bench)))
        assert SetInputTorque(0.0) in records(bench)
        if tick == 0:
            assert IDLE in records(bench)
    assert bench.axis_state == AxisState.IDLE


def test_a_stop_right_after_run_arms_nothing() -> None:
    bench = in_soft_start(initial={"x_m": 0.13})  # the striker swings and turns the free crank
    bench._obey = lambda frames: None  # type: ignore[method-assign] # every frame to the drive is lost
    bench.request = OperatorRequest.IDLE
    until(bench, lambda: bench.node.outputs.mode == Mode.STOPPING)
    stopping = 0
    for _ in range(300):
        assert not any(map(arms, records(bench)))
        stopping += bench.node.outputs.mode == Mode.STOPPING
        bench.run(0.001, keep=False)
    assert stopping > 100


def test_idle_is_repeated_while_there_is_no_heartbeat() -> None:
    bench = armed()
    bench.change = lambda _, frames: [f for f in frames if f.can_id != codec.DRIVE_HEARTBEAT.can_id]
    until(bench, lambda: bench.node.outputs.fault == Fault.DRIVE_TIMEOUT)
    since = []
    for tick in range(3000):
        if IDLE in records(bench):
            since.append(tick)
        bench.run(0.001, keep=False)
    assert since == list(range(0, 3000, REPEAT_TICKS))
    assert bench.axis_state == AxisState.IDLE


def test_an_old_heartbeat_confirms_nothing() -> None:
    """The heartbeat that said IDLE before the axis closed does not end the requests for IDLE."""
    bench = in_soft_start()
    until(bench, lambda: bench.axis_state == AxisState.CLOSED_LOOP_CONTROL)
    beat = codec.DRIVE_HEARTBEAT.encode(DriveHeartbeat(0, AxisState.IDLE.value, 0, 0))
    hot = codec.DRIVE_TEMPERATURE.encode(DriveTemperature(95.0, 30.0))
    bench.change = lambda _, frames: [hot, beat]
    bench.run(0.001, keep=False)
    assert IDLE in records(bench)
    bench.change = lambda _, frames: [f for f in frames if f.can_id != codec.DRIVE_HEARTBEAT.can_id]
    repeated = 0
    for _ in range(200):
        bench.run(0.001, keep=False)
        repeated += IDLE in records(bench)
    assert repeated == 200 // REPEAT_TICKS


def test_an_e_stop_is_repeated_until_the_drive_has_let_go() -> None:
    bench = armed()
    estop = codec.DRIVE_ESTOP.encode(DriveEstop())
    bench.change = lambda _, frames: [*frames, estop]
    bench._obey = lambda frames: None  # type: ignore[method-assign] # this drive is deaf
    bench.run(0.001, keep=False)
    assert records(bench) == [SetInputTorque(0.0), DriveEstop()]
    bench.change = lambda _, frames: frames
    sent = []
    for _ in range(1000):
        bench.run(0.001, keep=False)
        sent.append(records(bench))
    for wanted in (DriveEstop(), IDLE):
        ticks = [tick for tick, those in enumerate(sent) if wanted in those]
        assert len(ticks) == 1000 // REPEAT_TICKS
        assert {after - before for before, after in pairwise(ticks)} == {REPEAT_TICKS}
    bench.axis_state = AxisState.IDLE.value
    bench.run(0.2, keep=False)
    for _ in range(500):
        bench.run(0.001, keep=False)
        assert all(not isinstance(record, SetAxisState | DriveEstop) for record in records(bench))


def test_idle_and_the_fault_event_stand_behind_nothing() -> None:
    bench = armed()
    asked = [command(XcpCommandCode.CONNECT)] * 40
    hot = codec.DRIVE_TEMPERATURE.encode(DriveTemperature(95.0, 30.0))
    bench.change = lambda _, frames: [*frames, *asked, hot]
    bench.run(0.001, keep=False)
    assert bench.node.outputs.mode == Mode.FAULT
    assert IDLE in records(bench)
    bench.run(0.001, keep=False)
    assert FaultEvent(0, Fault.OVERTEMPERATURE, 0) in records(bench)


def test_nothing_starts_while_the_drive_does_not_let_go() -> None:
    """A drive that ignores IDLE is a fault of the drive, not the state from which a start begins."""
    bench = armed()
    bench.run(0.5, keep=False)
    deaf = bench._obey
    bench._obey = lambda frames: deaf(  # type: ignore[method-assign]
        [frame for frame in frames if codec.decode(frame) != IDLE]
    )
    bench.request = OperatorRequest.IDLE
    until(bench, lambda: bench.node.outputs.mode == Mode.READY, 4.0)
    bench.run(0.2, keep=False)
    bench.request = OperatorRequest.RUN
    for _ in range(1500):
        bench.run(0.001, keep=False)
        assert bench.node.outputs.mode not in MOVING
        assert SetInputTorque(0.0) in records(bench)
    assert bench.node.outputs.fault == Fault.DRIVE_ERROR


def test_a_drive_that_closes_its_axis_by_itself_is_opened_again() -> None:
    bench = Bench()
    bench.run(0.4, keep=False)
    assert bench.node.outputs.mode == Mode.READY
    bench.axis_state = AxisState.CLOSED_LOOP_CONTROL.value
    bench.run(0.11, keep=False)
    assert bench.axis_state == AxisState.IDLE


@pytest.mark.parametrize("lost", ARMING)
def test_no_axis_closes_with_stored_settings_if_a_setting_is_lost_for_20_ms(lost: type) -> None:
    bench = in_soft_start()
    obey, start = bench._obey, bench.tick
    received: list[object] = []

    def hard_of_hearing(frames: list[Frame]) -> None:
        arrived = [f for f in frames if bench.tick >= start + 20 or not isinstance(codec.decode(f), lost)]
        received.extend(map(codec.decode, arrived))
        obey(arrived)

    bench._obey = hard_of_hearing  # type: ignore[method-assign]
    until(bench, lambda: bench.axis_state == AxisState.CLOSED_LOOP_CONTROL)
    settings = {type(record) for record in received[: received.index(CLOSED_LOOP)]}
    assert settings >= set(ARMING)
    bench.run(0.2, keep=False)
    received.clear()
    bench.run(0.3, keep=False)
    assert not any(map(arms, received))


def test_arming_is_repeated_until_the_heartbeat_says_closed() -> None:
    bench = in_soft_start()
    obey = bench._obey
    deaf_until = bench.tick + 120

    def hard_of_hearing(frames: list[Frame]) -> None:
        obey([f for f in frames if bench.tick >= deaf_until or f.can_id != codec.SET_AXIS_STATE.can_id])

    bench._obey = hard_of_hearing  # type: ignore[method-assign]
    bench.run(0.4, keep=False)
    assert bench.axis_state == AxisState.CLOSED_LOOP_CONTROL
    assert bench.node.outputs.mode == Mode.SOFT_START
    for _ in range(300):
        bench.run(0.001, keep=False)
        assert not any(map(arms, records(bench)))
