"""What a step of the bring-up is, and the bus as it sees it: frames played by period, all of them logged.

`Bench` has two users: `real.RealBench` on a bus in real time, and `lockstep.LockstepBench`, which steps a
simulated module in this process.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from firmware_py.interface import codec
from firmware_py.interface.enums import AxisState
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import DriveEstop, SetAxisState, SetInputTorque
from tools.tuning.result import Value

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
    step_ticks: int
    """The periods between two calls in real time: 1 for a step that commands the drive itself."""

    def play(self, tick: int, received: Sequence[Frame]) -> Sequence[Frame] | None:
        """The frames to send in this period, after those received since the last; None: the step has ended.

        `tick` counts the periods since the step began; in real time some may be left out.
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


class Largest(NamedTuple):
    """Bounds of a step, or the largest values that it has seen: peak force at the stop, torque, angle, speed.

    An angle of 0 as a bound: none.
    """

    force_n: float = 0.0
    torque_n_m: float = 0.0
    angle_rad: float = 0.0
    speed_rad_s: float = 0.0


NOTHING = Largest()


class StepFailedError(Exception):
    """A step has ended without success; the message says why and what to do."""


class Figure(NamedTuple):
    """A measured quantity for the report."""

    name: str
    value: float
    unit: str


class Curve(NamedTuple):
    """A line of the report's picture: x and y, each of shape (n,)."""

    name: str
    x: Any
    y: Any


@dataclass
class Findings:
    """What a step has found; it stands in the report even if the step fails."""

    parameters: dict[str, Value] = field(default_factory=dict)
    figures: list[Figure] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    curves: list[Curve] = field(default_factory=list)
    axes: tuple[str, str] = ("time in s", "")
    largest: Largest = NOTHING

    def add(self, name: str, value: float, unit: str) -> None:
        """Note a figure."""
        self.figures.append(Figure(name, float(value), unit))


@dataclass
class Context:
    """What a step may use: the bench, its folder, all parameters found so far, and the user's consent.

    `asks(sentence)`: whether the user agrees to a change of a parameter. `says(sentence)`: progress. `ratio`:
    the wanted one. `logs`: the files of the frames by name, those of this step before those of earlier ones.
    """

    bench: Bench
    folder: Path
    values: dict[str, float]
    bounds: Mapping[str, Value]
    asks: Callable[[str], bool]
    says: Callable[[str], None]
    ratio: float
    logs: dict[str, str] = field(default_factory=dict)

    def log(self, name: str) -> Path:
        """A file for frames, which is new: a repeated step keeps those of its former attempt."""
        file, number = f"{name}.log", 1
        while file == self.logs.get(name) or (self.folder / file).exists():
            number += 1
            file = f"{name}-{number}.log"
        self.logs[name] = file
        return self.folder / file

    def last_log(self, name: str) -> Path:
        """The frames of this name that count."""
        return self.folder / self.logs.get(name, f"{name}.log")


class Step(NamedTuple):
    """One step: `moves` says in a sentence what it will move, empty if nothing; `bound` holds it within.

    `lasts_s`: about how long, for the terminal.
    """

    name: str
    does: str
    moves: str
    lasts_s: float
    bound: Callable[[Context], Largest]
    run: Callable[[Context, Findings], None]
