"""The whole node by frames: whatever comes in whatever order, nothing moves that must not.

    python -m pytest tests/firmware_py/safety/test_any_order.py

takes some 10,000 ticks; with VIBROHIL_LONG_TICKS=2000000 in the environment two million, compiled.

Events are requests of the operator, errors of the drive, readings beyond their limits, frames that are lost,
late, repeated or corrupted, a drive that ignores its commands, commands of an XCP master, E-stops and host
stalls. The rules below see frames and the mode alone.
"""

import os
import random
from collections import deque
from typing import ClassVar

import pytest
from closed_loop import Bench
from due_frames import due_frames
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    precondition,
    rule,
    run_state_machine_as_test,
)
from xcp_session import commands_of

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError
from firmware_py.interface.enums import AxisState, Mode, OperatorRequest
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import (
    DriveEstop,
    DriveHeartbeat,
    DriveSupply,
    DriveTemperature,
    OperatorCommand,
    SetAxisState,
    SetControllerMode,
    SetInputTorque,
    SetLimits,
    XcpResponse,
)
from firmware_py.interface.modes import LATCHED, MOVING
from firmware_py.node.inbox import behind_ticks

TICKS = int(os.environ.get("VIBROHIL_LONG_TICKS", "10000"))
LONG = TICKS >= 200_000
"""Long enough to reach every mode, and to be worth the compiled build."""
EXAMPLES = 10
"""Of one seed; the first of them is the shortest there is."""
MOST_SEEDS = 20
"""More ticks are run, up to this seed, until every mode has been reached."""
REPEAT_TICKS = 20
FRESH_TICKS = 350
TORQUE_LIMIT_N_M = 0.6
QUICK = {"start.rise_s": 0.5, "start.approach_s": 0.3, "start.stop_s": 0.3, "start.confirm_periods": 1.0}
"""Every stage is reached soon."""

SOURCES = (
    codec.ACCELEROMETER,
    codec.ENCODER_ESTIMATES,
    codec.DRIVE_HEARTBEAT,
    codec.DRIVE_CURRENT,
    codec.DRIVE_TEMPERATURE,
    codec.DRIVE_SUPPLY,
    codec.DRIVE_ERRORS,
    codec.OPERATOR_COMMAND,
)
IDS = st.sampled_from([source.can_id for source in SOURCES])
DURATIONS = st.integers(1, 500)
ARMING = (SetControllerMode, SetLimits)
CLOSED_LOOP = SetAxisState(AxisState.CLOSED_LOOP_CONTROL)
IDLE = SetAxisState(AxisState.IDLE)
CONSENT = (OperatorRequest.CLEAR_FAULTS, OperatorRequest.IDLE, OperatorRequest.RUN)
"""What has to be received in this order between a latched fault and motion."""


class Rules:
    """What must hold in every tick, by the frames that reach the node and those that leave it."""

    def __init__(self) -> None:
        self.tick = 0
        self.mode = Mode.INIT
        self.consent = 1
        """How much of CONSENT has been received; at power-up there is nothing to clear."""
        self.latched_tick = self.idle_tick = 0
        self.heartbeat_tick = self.answer_tick = -FRESH_TICKS
        self.request = -1
        self.estop = False

    def received(self, frames: list[Frame]) -> None:
        """Take note of what this tick receives."""
        self.tick += 1
        self.estop = any(frame.can_id == codec.DRIVE_ESTOP.can_id for frame in frames)
        for frame in frames:
            try:
                record = codec.decode(frame)
            except FrameError:
                continue
            if isinstance(record, DriveHeartbeat):
                self.heartbeat_tick = self.tick
                self.answer_tick = self.tick if record.axis_state == AxisState.IDLE else -FRESH_TICKS
            if isinstance(record, OperatorCommand):
                last = frame is [f for f in frames if f.can_id == frame.can_id][-1]
                self.request = record.request
                if last and self.consent < 3 and record.request == CONSENT[self.consent]:
                    self.consent += 1

    def sent(self, frames: list[Frame], mode: Mode, is_current: bool) -> None:
        """Judge what this tick sends; a tick that catches up sends no torque."""
        records = [codec.decode(frame) for frame in frames]
        torques = [record for record in records if isinstance(record, SetInputTorque)]
        others = [record for record in records if not isinstance(record, SetInputTorque | XcpResponse)]
        # A torque leads every present tick, unless the drive's watchdog is tested.
        assert records[:1] == torques or ((mode == Mode.PROOF or not is_current) and not torques)
        assert len(others) <= 1
        assert len(records) <= 3
        assert is_current or not torques
        for torque in torques:
            assert abs(torque.torque_n_m) <= TORQUE_LIMIT_N_M + 1e-6
            assert mode in MOVING or torque.torque_n_m == 0.0, f"{torque} in {mode.name}"
        for record in others:
            if isinstance(record, ARMING) or record == CLOSED_LOOP:
                assert mode in (Mode.SOFT_START, Mode.PROOF), f"{record} in {mode.name}"
        # An E-stop is passed on to the drive in its tick.
        if self.estop:
            assert mode == Mode.E_STOP
            assert self.mode == Mode.E_STOP or others == [DriveEstop()], f"{others} at an E-stop"
        # Motion begins only with the operator's consent, given since the last fault or stop.
        if mode in MOVING and self.mode not in MOVING:
            assert self.consent == len(CONSENT), f"{mode.name} after {CONSENT[: self.consent]}"
        if mode in LATCHED and self.mode not in LATCHED:
            self.latched_tick = self.tick
            self.idle_tick = self.tick - REPEAT_TICKS + 2
            self.consent = 0
        elif mode not in MOVING and self.mode in MOVING:
            self.consent = 2 if self.request == OperatorRequest.IDLE else 1
        if mode in LATCHED:
            confirmed = (
                self.answer_tick >= self.latched_tick + REPEAT_TICKS
                and self.tick - self.heartbeat_tick <= FRESH_TICKS
            )
            if IDLE in others or confirmed:
                self.idle_tick = self.tick
            late_ticks = self.tick - self.idle_tick - REPEAT_TICKS
            assert late_ticks <= 0, f"no IDLE for {self.tick - self.idle_tick} ticks"
        self.mode = mode


class AnyOrder(RuleBasedStateMachine):
    """The node on the simulated module, and everything that can happen to its frames."""

    ticks = 0
    modes: ClassVar[set[Mode]] = set()

    def __init__(self) -> None:
        super().__init__()
        self.bench = Bench(QUICK, ratio=1.1, change=self.on_the_way, build="compiled" if LONG else "python")
        self.rules = Rules()
        self.lost: dict[int, int] = {}
        self.late: dict[int, tuple[int, int]] = {}
        self.repeated: dict[int, int] = {}
        self.corrupted: dict[int, tuple[int, int]] = {}
        self.stalled_until = 0
        self.deaf_until = 0
        self.extra: list[tuple[int, Frame]] = []
        self.waiting: deque[tuple[int, Frame]] = deque()
        self.bench.overrun = lambda tick: tick < self.stalled_until
        obey = self.bench._obey
        self.bench._obey = lambda frames: (  # type: ignore[method-assign]
            obey(frames) if self.bench.tick >= self.deaf_until else None
        )
        run_period = self.bench.node.run_period

        def judge_period() -> list[Frame]:
            is_current = behind_ticks(self.bench.node.inbox) == 0
            self.rules.received(due_frames(self.bench.node.inbox))
            sent = run_period()
            self.rules.sent(sent, self.bench.mode, is_current)
            AnyOrder.modes.add(self.bench.mode)
            return sent

        self.bench.node.run_period = judge_period  # type: ignore[method-assign,assignment]

    def on_the_way(self, tick: int, frames: list[Frame]) -> list[Frame]:
        """What becomes of the frames of a tick on their way to the node."""
        arrive = [frame for at, frame in self.waiting if at <= tick]
        self.waiting = deque((at, frame) for at, frame in self.waiting if at > tick)
        for sent in frames:
            frame, can_id = sent, sent.can_id
            if self.lost.get(can_id, 0) > tick:
                continue
            until, bit = self.corrupted.get(can_id, (0, 0))
            if until > tick:
                data = bytearray(frame.data)
                data[bit // 8 % len(data)] ^= 1 << bit % 8
                frame = Frame(can_id, bytes(data))
            until, delay = self.late.get(can_id, (0, 0))
            if until > tick:
                self.waiting.append((tick + delay, frame))
                continue
            arrive += [frame] * (2 if self.repeated.get(can_id, 0) > tick else 1)
        arrive += [frame for until, frame in self.extra if until > tick]
        return arrive

    def go_on(self, ticks: int) -> None:
        """Run this number of ticks."""
        self.bench.run(0.001 * ticks, keep=False)
        AnyOrder.ticks += ticks

    @initialize(started=st.booleans())
    def power_up(self, started: bool) -> None:
        self.go_on(300)
        if started:
            self.bench.request = OperatorRequest.RUN
            self.go_on(300)

    @rule(ticks=st.integers(1, 300))
    def wait(self, ticks: int) -> None:
        self.go_on(ticks)

    @precondition(lambda self: self.bench.mode in MOVING)
    @rule(ticks=st.integers(300, 2500))
    def wait_in_motion(self, ticks: int) -> None:
        self.go_on(ticks)

    @precondition(lambda self: self.bench.mode in MOVING)
    @rule(ticks=st.integers(1, 1500))
    def stop(self, ticks: int) -> None:
        self.bench.request = OperatorRequest.IDLE
        self.go_on(ticks)

    @rule(request=st.sampled_from(list(OperatorRequest)), ratio=st.sampled_from([0.0, 0.9, 1.1, 1.3, 3.0]))
    def ask(self, request: OperatorRequest, ratio: float) -> None:
        self.bench.request, self.bench.ratio = request, ratio
        self.go_on(1)

    @rule(idle_ticks=st.integers(50, 400), run_ticks=st.integers(50, 700))
    def clear_and_start(self, idle_ticks: int, run_ticks: int) -> None:
        """The way back to motion, for as long as the operator takes over each step."""
        self.lost.clear(), self.late.clear(), self.corrupted.clear(), self.extra.clear()
        self.bench.ratio = 1.1
        for request, ticks in zip(CONSENT, (idle_ticks, idle_ticks, run_ticks), strict=True):
            self.bench.request = request
            self.go_on(ticks)

    @rule(error=st.sampled_from([0x200, 0x8000, 0x02000000]))
    def drive_error(self, error: int) -> None:
        self.bench.axis_error, self.bench.axis_state = error, AxisState.IDLE.value
        self.go_on(1)

    @rule(closed=st.booleans())
    def axis_by_itself(self, closed: bool) -> None:
        state = AxisState.CLOSED_LOOP_CONTROL if closed else AxisState.IDLE
        self.bench.axis_state = state.value
        self.go_on(1)

    @rule(can_id=IDS, ticks=DURATIONS)
    def lose(self, can_id: int, ticks: int) -> None:
        self.lost[can_id] = self.bench.tick + ticks
        self.go_on(1)

    @rule(can_id=IDS, ticks=DURATIONS, delay=st.integers(1, 120))
    def delay(self, can_id: int, ticks: int, delay: int) -> None:
        self.late[can_id] = (self.bench.tick + ticks, delay)
        self.go_on(1)

    @rule(can_id=IDS, ticks=DURATIONS)
    def repeat(self, can_id: int, ticks: int) -> None:
        self.repeated[can_id] = self.bench.tick + ticks
        self.go_on(1)

    @rule(can_id=IDS, ticks=DURATIONS, bit=st.integers(0, 63))
    def corrupt(self, can_id: int, ticks: int, bit: int) -> None:
        self.corrupted[can_id] = (self.bench.tick + ticks, bit)
        self.go_on(1)

    @rule(number=st.integers(0, 1 << 30), count=st.integers(1, 200))
    def measure_and_calibrate(self, number: int, count: int) -> None:
        """Commands of a master, one a tick: a plausible session, and any bytes of any length."""
        for frame in commands_of(random.Random(number), count):
            self.extra.append((self.bench.tick + 1, frame))
            self.go_on(1)

    @rule(ticks=st.integers(1, 300))
    def host_stall(self, ticks: int) -> None:
        self.stalled_until = self.bench.tick + ticks
        self.go_on(ticks + 1)

    @rule(ticks=DURATIONS)
    def deaf_drive(self, ticks: int) -> None:
        self.deaf_until = self.bench.tick + ticks
        self.go_on(1)

    @rule(ticks=st.integers(0, 60))
    def emergency_stop(self, ticks: int) -> None:
        """At any tick after the request of the rule before, for one tick."""
        self.go_on(ticks)
        self.extra.append((self.bench.tick + 1, codec.encode(DriveEstop())))
        self.go_on(1)

    @rule(idle_ticks=st.integers(310, 400), test_ticks=st.integers(50, 500))
    def prove_the_watchdog(self, idle_ticks: int, test_ticks: int) -> None:
        """The way to the test of the drive's watchdog; the drive of this bench has none."""
        for request, ticks in (
            (OperatorRequest.CLEAR_FAULTS, 50),
            (OperatorRequest.IDLE, idle_ticks),
            (OperatorRequest.PROVE_WATCHDOG, test_ticks),
        ):
            self.bench.request = request
            self.go_on(ticks)

    @rule(
        record=st.sampled_from(
            [DriveTemperature(95.0, 30.0), DriveSupply(10.0, 0.5), DriveSupply(40.0, 0.5), DriveEstop()]
        ),
        ticks=st.integers(1, 300),
    )
    def beyond_a_limit(self, record: object, ticks: int) -> None:
        self.extra.append((self.bench.tick + ticks, codec.encode(record)))
        self.go_on(1)


@pytest.mark.requirement("S-02", "S-05", "S-07")
def test_nothing_moves_that_must_not_whatever_comes_in_whatever_order() -> None:
    reached = set(Mode) if LONG else set(Mode) - {Mode.RUN, Mode.PROOF}
    AnyOrder.ticks = 0
    number = 1
    while AnyOrder.ticks < TICKS or (number <= MOST_SEEDS and not AnyOrder.modes >= reached):
        machine = seed(number)(AnyOrder)
        run_state_machine_as_test(
            machine,
            settings=settings(
                max_examples=EXAMPLES,
                stateful_step_count=30,
                database=None,
                phases=[Phase.generate],
                report_multiple_bugs=False,
                suppress_health_check=list(HealthCheck),
            ),
        )
        number += 1
    assert AnyOrder.modes >= reached
