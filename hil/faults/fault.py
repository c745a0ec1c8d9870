"""What all faults have in common. A kind of fault is one class in one file of `hil.faults.kinds`.

The class is the table `[[script.faults]]` of a scenario, and its methods are its effect. Its base class says
where it acts and is called there: `on_bus`, `on_sensor`, `on_plant` or `on_process`. The scenario's checks
state the required reaction, on the truth: motor torque, stop force, impacts.

Each node of a run has the script's faults for itself (`of_a_node`): what they hold, and the number of their
effects.
"""

import math
from collections import deque
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from firmware_py.interface.frame import Frame
from hil.record.run_faults import RunFault
from plant_sim.scene import Scene
from plant_sim.tables.quantities import Duration
from plant_sim.tables.table import Table

TIME_RESOLUTION_S = 1e-9
"""Times that differ by less are the same instant: a tick's time is rounded."""
FAULTS_ACTED = "faults_acted"
"""Key of a node's final report: the number of effects of each fault of the script."""


class Late(NamedTuple):
    """A frame that is held back until `due_s`."""

    due_s: float
    frame: Frame


class Memory:
    """What a fault keeps while it acts."""

    noise: np.random.Generator
    effects: int = 0

    def __init__(self) -> None:
        self.held: deque[Late] = deque()
        """The frames that a fault of a connection holds back, oldest first."""


class Fault(Table):
    """The keys of every fault. It acts at times t with at_s ≤ t < at_s + duration_s."""

    place: ClassVar[str] = ""
    """Where faults of this kind act, as a heading of the reference."""
    is_steady: ClassVar[bool] = False
    """Whether it acts at its beginning and its end alone, and not from tick to tick."""
    is_beyond_log: ClassVar[bool] = False
    """Whether it changes which frames the firmware receives, or when it ticks, after a log has seen them."""

    kind: str
    at_s: Duration = Field(ge=0.0, description="the fault's beginning, in s from the start")
    duration_s: Duration | None = Field(
        default=None, gt=0.0, description="the fault's duration, in s; by default to the end of the run"
    )

    @cached_property
    def memory(self) -> Memory:
        """What it keeps while it acts, as a plain object: private attributes of pydantic are slow."""
        return Memory()

    @property
    def end_s(self) -> float:
        """The end of the fault."""
        return math.inf if self.duration_s is None else self.at_s + self.duration_s

    def acts(self, t_s: float) -> bool:
        """Whether the fault acts at `t_s`."""
        return self.at_s - TIME_RESOLUTION_S <= t_s < self.end_s - TIME_RESOLUTION_S

    @property
    def interval_s(self) -> tuple[float, float]:
        """When it acts: its beginning and its end, in s; the end is infinite for one that does not end."""
        return self.at_s, self.end_s

    @property
    def acts_in(self) -> str | None:
        """The node or process in which it acts; None for a fault on the bus."""
        return getattr(self, "node", None)

    @property
    def silences(self) -> bool:
        """Whether it keeps its process from running."""
        return False

    @property
    def in_words(self) -> str:
        """Its kind and its keys, without its times."""
        given = self.model_dump(exclude={"kind", "at_s", "duration_s"}, exclude_unset=True)
        keys = (
            f"{key} {', '.join(map(str, value)) if isinstance(value, list) else value}"
            for key, value in given.items()
        )
        return f"{self.kind} ({'; '.join(keys)})" if given else self.kind

    def as_record(self) -> RunFault:
        """The fault as a run records it, before anything is known of its effects."""
        from_s, to_s = self.interval_s
        ends_s = None if math.isinf(to_s) else to_s
        frames = getattr(self, "frames", None) or ()
        return RunFault(
            self.kind, self.acts_in, self.silences, from_s, ends_s, self.in_words, frames=tuple(frames)
        )

    def begin(self, noise: np.random.Generator) -> None:
        """Begin anew, as in a process that starts."""
        self.memory.noise = noise

    @property
    def effects(self) -> int:
        """The number of its effects so far: frames, readings, ticks or starts that it has acted on."""
        return self.memory.effects

    def count(self, effects: int = 1) -> None:
        """Count effects."""
        if effects:
            self.memory.effects += effects

    def without_object(self, scene: Scene, faults: Sequence["Fault"]) -> str | None:
        """The reason why it cannot act in this scene, among these faults, with the remedy; None if it can."""
        return None


def of_a_node(script: Iterable[Fault]) -> list[Fault]:
    """The faults of a script for one node, without effects so far."""
    return [fault.model_copy(update={"memory": Memory()}) for fault in script]


def effects_of(nodes: Iterable[Iterable[Fault]]) -> list[int]:
    """The number of effects of each fault of a script, from the faults of all nodes."""
    return [sum(fault.effects for fault in same) for same in zip(*nodes, strict=True)]
