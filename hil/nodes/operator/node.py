"""The operator's node: sends a script's commands at 10 Hz, and an E-stop at once.

A line of the script acts in the first tick at or after its time; of several lines in one tick the last acts.
An E-stop is an exception: its frame is sent in its tick and repeated until a heartbeat of the firmware
confirms it, and no other line acts before. The command that belongs to it follows in the next tick, because
the node sends at most one frame per tick.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError
from firmware_py.interface.enums import Fault, Mode, OperatorRequest
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import DriveEstop, OperatorCommand
from hil.scenario.commands import Command, Request
from hil.timing.clock import OPERATOR_PERIOD_S

COMMAND_PERIOD_S = codec.OPERATOR_COMMAND.period_s or 0.1
"""Period at which the operator repeats its command; the firmware monitors it."""
ESTOP_PERIOD_S = 0.02
"""Period of the E-stop until it is confirmed; also the shortest time to a confirming heartbeat."""
RECEIVED_IDS = (codec.FIRMWARE_HEARTBEAT.can_id,)
"""Identifiers that the operator receives."""


ON_THE_BUS = {
    Request.IDLE: OperatorRequest.IDLE,
    Request.RUN: OperatorRequest.RUN,
    Request.CLEAR_FAULTS: OperatorRequest.CLEAR_FAULTS,
    Request.E_STOP: OperatorRequest.IDLE,
    Request.PROVE_WATCHDOG: OperatorRequest.PROVE_WATCHDOG,
    Request.SILENT: OperatorRequest.IDLE,
}


EMERGENCY_STOP = Command(0.0, Request.E_STOP, 0.0)
STOP = Command(0.0, Request.IDLE, 0.0)


class OperatorRecord(NamedTuple):
    """The operator's request in one of its steps; `tick` counts the bench's ticks.

    `estop`: an E-stop is the last line of the script, or is not confirmed yet.
    """

    tick: int
    t_s: float
    request: OperatorRequest
    target_ratio: float
    target_impulse_n_s: float
    estop: bool


def reported_state(frame: Frame) -> tuple[Mode, Fault] | None:
    """The mode and latched fault that a valid heartbeat of the firmware reports; None for other frames."""
    if frame.can_id != codec.FIRMWARE_HEARTBEAT.can_id:
        return None
    try:
        heartbeat = codec.FIRMWARE_HEARTBEAT.decode(frame.data)
        return Mode(heartbeat.mode), Fault(heartbeat.fault)
    except (FrameError, ValueError):
        return None


def reports_estop(frame: Frame) -> bool:
    """Whether `frame` is a valid heartbeat of a firmware that is in E_STOP."""
    state = reported_state(frame)
    return state is not None and state[0] == Mode.E_STOP


class OperatorNode:
    """Executes a script: call `publish` in tick `due_tick`, or as soon afterwards as possible."""

    def __init__(self, commands: Sequence[Command], period_s: float, is_recorded: bool = True) -> None:
        """`period_s`: the bench's period. `is_recorded`: whether there are also steps that send nothing."""
        in_order = sorted(commands, key=lambda command: command.at_s)
        self._lines = [(math.ceil(command.at_s / period_s - 1e-6), command) for command in in_order]
        self._period_s = period_s
        self._is_recorded = is_recorded
        self._step_ticks, self._command_ticks, self._repeat_ticks = (
            max(round(duration_s / period_s), 1)
            for duration_s in (OPERATOR_PERIOD_S, COMMAND_PERIOD_S, ESTOP_PERIOD_S)
        )
        self._line = Command(0.0, Request.IDLE, 0.0)
        self._next_line = 0
        self._tick = 0
        self._counter = -1
        self._command_tick = 0
        self._estop_since_tick: int | None = None
        self._estop_tick = 0
        self._waiting: deque[Frame] = deque()
        self.due_tick = 0
        """Tick of the next step."""

    @property
    def estop_is_unconfirmed(self) -> bool:
        """Whether an E-stop is repeated that no heartbeat has confirmed."""
        return self._estop_since_tick is not None

    def emergency_stop(self, tick: int) -> None:
        """End the script with an E-stop in `tick`."""
        self.finish(tick, EMERGENCY_STOP)

    def finish(self, tick: int, line: Command = STOP) -> None:
        """End the script with a last line in `tick`, by default a controlled stop."""
        self._lines = []
        self._next_line = 0
        self._begin(line, tick)
        self.due_tick = tick

    def publish(self, tick: int, received: Sequence[Frame] = ()) -> list[Frame]:
        """The frames of `tick`; `received`: the frames that have arrived since the last step."""
        self._tick = tick
        before = self._acting
        if self._confirms(tick, received):
            self._estop_since_tick = None
        while self._next_line < len(self._lines) and self._lines[self._next_line][0] <= tick:
            self._begin(self._lines[self._next_line][1], tick)
            self._next_line += 1
        if self.estop_is_unconfirmed and tick >= self._estop_tick:
            self._estop_tick = tick + self._repeat_ticks
            self._waiting.appendleft(codec.DRIVE_ESTOP.encode(DriveEstop()))
        acting = self._acting
        if acting is not before or tick >= self._command_tick:
            self._command_tick = (tick // self._command_ticks + 1) * self._command_ticks
            if acting.request is not Request.SILENT:
                self._counter += 1
                command = OperatorCommand(
                    ON_THE_BUS[acting.request], acting.target_ratio, acting.target_impulse_n_s
                )
                self._waiting.append(codec.OPERATOR_COMMAND.encode(command, self._counter))
        frames = [self._waiting.popleft()] if self._waiting else []
        self.due_tick = self._next_step(tick)
        return [] if acting.request is Request.SILENT else frames

    def record(self) -> OperatorRecord:
        """The operator's record of its last step."""
        _, request, target_ratio, target_impulse_n_s = self._acting
        return OperatorRecord(
            self._tick,
            self._tick * self._period_s,
            ON_THE_BUS[request],
            target_ratio,
            target_impulse_n_s,
            request is Request.E_STOP,
        )

    @property
    def _acting(self) -> Command:
        """The command that is sent: an unconfirmed E-stop, else the last line of the script."""
        return EMERGENCY_STOP if self.estop_is_unconfirmed else self._line

    def _confirms(self, tick: int, received: Sequence[Frame]) -> bool:
        """Whether a received heartbeat confirms the E-stop.

        A heartbeat that arrives within `ESTOP_PERIOD_S` may have been sent before the firmware received it.
        """
        since_tick = self._estop_since_tick
        is_answered = since_tick is not None and tick > since_tick + self._repeat_ticks
        return is_answered and any(map(reports_estop, received))

    def _begin(self, line: Command, tick: int) -> None:
        """Let a line of the script begin in `tick`."""
        self._line = line
        if line.request is Request.E_STOP:
            self._estop_since_tick = self._estop_tick = tick

    def _next_step(self, tick: int) -> int:
        """The tick of the step after the one in `tick`."""
        if self._waiting:
            return tick + 1
        due_ticks = [self._command_tick]
        if self._is_recorded or self.estop_is_unconfirmed:
            due_ticks.append((tick // self._step_ticks + 1) * self._step_ticks)
        if self.estop_is_unconfirmed:
            due_ticks.append(self._estop_tick)
        if self._next_line < len(self._lines):
            due_ticks.append(self._lines[self._next_line][0])
        return min(due_ticks)
