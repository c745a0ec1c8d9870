"""The operator's node: sends a script's commands at 10 Hz, and an E-stop at once.

It sends one frame per period: the command that belongs to an E-stop follows in the next period.
"""

from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

from firmware_py.interface import codec
from firmware_py.interface.enums import OperatorRequest
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import DriveEstop, OperatorCommand
from firmware_py.interface.pacing import Pacer, Urgency

OPERATOR_PERIOD_S = 0.01
"""Period at which the operator reads the script; an E-stop or a change is sent within it."""
COMMAND_PERIOD_S = codec.OPERATOR_COMMAND.period_s or 0.1
"""Period at which the operator repeats its command; the firmware monitors it."""
PERIODS_A_COMMAND = round(COMMAND_PERIOD_S / OPERATOR_PERIOD_S)


class Request(StrEnum):
    """The request of a line of the script, valid until the next line."""

    IDLE = "idle"
    RUN = "run"
    CLEAR_FAULTS = "clear-faults"
    E_STOP = "e-stop"
    SILENT = "silent"
    """The operator's node is absent: it sends no frames."""


ON_THE_BUS = {
    Request.IDLE: OperatorRequest.IDLE,
    Request.RUN: OperatorRequest.RUN,
    Request.CLEAR_FAULTS: OperatorRequest.CLEAR_FAULTS,
    Request.E_STOP: OperatorRequest.IDLE,
    Request.SILENT: OperatorRequest.IDLE,
}


class Command(NamedTuple):
    """The request from `at_s` on; the ratio is Ω over the nominal ω, and an impulse of 0 means none."""

    at_s: float
    request: Request
    target_ratio: float
    target_impulse_n_s: float = 0.0


class OperatorRecord(NamedTuple):
    """The operator's request in one of its periods; `tick` counts the bench's ticks."""

    tick: int
    t_s: float
    request: OperatorRequest
    target_ratio: float
    target_impulse_n_s: float
    estop: bool


class OperatorNode:
    """Executes a script: `publish` at each multiple of `OPERATOR_PERIOD_S` returns the frames to send."""

    def __init__(self, commands: Sequence[Command], bench_period_s: float) -> None:
        self._commands = sorted(commands, key=lambda command: command.at_s)
        self._bench_period_s = bench_period_s
        self._acting = Command(0.0, Request.IDLE, 0.0)
        self._next = 0
        self._counter = -1
        self._due_period = 0
        self._pacer: Pacer[Frame] = Pacer()

    def publish(self, period: int) -> list[Frame]:
        """The frames of period number `period`: the command every 100 ms and whenever it changes."""
        t_s = period * OPERATOR_PERIOD_S
        changed = False
        while self._next < len(self._commands) and self._commands[self._next].at_s <= t_s + 1e-9:
            self._acting = self._commands[self._next]
            self._next += 1
            changed = True
        is_silent = self._acting.request is Request.SILENT
        if changed or period >= self._due_period:
            self._due_period = (period // PERIODS_A_COMMAND + 1) * PERIODS_A_COMMAND
            if not is_silent:
                self._queue(self._acting)
        frame = self._pacer.take()
        return [] if frame is None or is_silent else [frame]

    def record(self, period: int) -> OperatorRecord:
        """The operator's record in period number `period`, the last one published."""
        t_s = period * OPERATOR_PERIOD_S
        _, request, target_ratio, target_impulse_n_s = self._acting
        return OperatorRecord(
            round(t_s / self._bench_period_s),
            t_s,
            ON_THE_BUS[request],
            target_ratio,
            target_impulse_n_s,
            request is Request.E_STOP,
        )

    def _queue(self, acting: Command) -> None:
        _, request, target_ratio, target_impulse_n_s = acting
        if request is Request.E_STOP:
            self._pacer.push(codec.DRIVE_ESTOP.encode(DriveEstop()), Urgency.AT_ONCE)
        self._counter += 1
        command = OperatorCommand(ON_THE_BUS[request], target_ratio, target_impulse_n_s)
        self._pacer.push(codec.OPERATOR_COMMAND.encode(command, self._counter))
