"""The bus as a step of the bring-up sees it: it plays frames period by period, and has all of them logged.

`Bench` has two users: `real.RealBench` on a bus in real time, and `lockstep.LockstepBench`, which steps a
simulated module in this process.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from firmware_py.interface import codec
from firmware_py.interface.enums import AxisState
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import DriveEstop, SetAxisState, SetInputTorque

PERIOD_S = 1e-3
"""The period of the fastest frame on the bus."""
EMERGENCY = (
    codec.SET_INPUT_TORQUE.encode(SetInputTorque(0.0)),
    codec.DRIVE_ESTOP.encode(DriveEstop()),
    codec.SET_AXIS_STATE.encode(SetAxisState(AxisState.IDLE)),
)
"""The frames of an E-stop, sent when a step that moves the module ends early."""


class Player(Protocol):
    """One step's part on the bus."""

    moves: bool
    """Whether the step may move the module; then an E-stop follows its interruption."""

    def play(self, tick: int, received: Sequence[Frame]) -> Sequence[Frame] | None:
        """The frames to send in this period, after those received since the last; None: the step has ended.

        `tick` counts the periods since the step began.
        """


class Bench(Protocol):
    """A bus with the module on it."""

    def play(
        self, player: Player, longest_s: float, log: Path, parameters: Mapping[str, float] | None = None
    ) -> None:
        """Let `player` act until it ends or for `longest_s`; write every frame to `log` (candump's format).

        With `parameters` the firmware runs beside it with these. An exception, Ctrl-C among them, sends an
        E-stop if the player moves the module, and is raised again. Raises BusFailedError.
        """
