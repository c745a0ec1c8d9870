"""What a step of the bring-up is: its announcement, its bounds, and its result."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from tools.bring_up.bench import Bench
from tools.tuning.result import Value


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

    `asks(sentence)`: whether the user agrees to a change of a parameter. `speed_ratio`: the wanted ratio.
    """

    bench: Bench
    folder: Path
    values: dict[str, float]
    bounds: Mapping[str, Value]
    asks: Callable[[str], bool]
    ratio: float

    def log(self, name: str) -> Path:
        """The file of a step's frames."""
        return self.folder / f"{name}.log"


class Step(NamedTuple):
    """One step: `moves` says in a sentence what it will move, empty if nothing; `bound` holds it within."""

    name: str
    does: str
    moves: str
    bound: Callable[[Context], Largest]
    run: Callable[[Context, Findings], None]
