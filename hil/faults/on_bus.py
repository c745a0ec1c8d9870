"""Faults on the bus: at a node's connection (`hil.faults.line`), or in the bus model of lockstep."""

from collections import deque
from collections.abc import Sequence
from functools import cached_property
from typing import Annotated, ClassVar, NamedTuple, TypeAlias

import numpy as np
from pydantic import AfterValidator, Field, field_validator

from firmware_py.interface.codec import CODECS
from firmware_py.interface.frame import Frame
from hil.faults.fault import TIME_RESOLUTION_S, Fault
from hil.roster import as_choice, names
from plant_sim.scene import Scene
from plant_sim.sensors.sampled import SAMPLED
from plant_sim.tables.quantities import Number
from plant_sim.validation_messages import nearest

FRAME_IDS = {record.__name__: codec.can_id for record, codec in CODECS.items()}
"""Identifiers by the names that vibro.dbc gives the frames."""


def is_node(name: str) -> str:
    """Raise ValueError if no node has this name."""
    if name not in names():
        raise ValueError(f"node = {name!r} is no node of the bench; give {as_choice(names())}")
    return name


Node: TypeAlias = Annotated[str, AfterValidator(is_node)]
Share = Annotated[
    Number, Field(gt=0.0, le=1.0, description="the share of frames or readings hit, chosen at random, 0…1")
]


class Step(NamedTuple):
    """The time of a node's step, and of its previous step."""

    t_s: float
    since_s: float


def periods_begun(at_s: float, period_s: float, step: Step) -> int:
    """Number of periods, counted from `at_s`, that begin after the previous step and not after this one."""
    begun = int((step.t_s - at_s) / period_s + TIME_RESOLUTION_S) + 1
    before = int((step.since_s - at_s) / period_s + TIME_RESOLUTION_S) + 1 if step.since_s >= at_s else 0
    return begun - before


class LineFault(Fault):
    """A fault at the connections of nodes. Its methods are called while it acts."""

    place: ClassVar[str] = "On the bus"

    def begin(self, noise: np.random.Generator) -> None:
        """Begin anew, as in a process that starts: no frame is held back."""
        super().begin(noise)
        self.memory.held = deque()

    def outgoing(self, frames: list[Frame], step: Step) -> list[Frame]:
        """The frames that leave a node, of those that it sends in a step; counts those acted on."""
        return frames

    def released(self) -> list[Frame]:
        """Remove and return the frames that are held back."""
        memory = self.memory
        held, memory.held = memory.held, deque()
        return [late.frame for late in held]

    @property
    def held_frames(self) -> int:
        """The number of frames that are held back."""
        return len(self.memory.held)

    def foreign_frames(self, step: Step) -> list[Frame]:
        """The frames that a foreign node sends in this step."""
        return []

    def unplugs(self, node: str) -> bool:
        """Whether the node is disconnected."""
        return False


class ModelledFault(Fault):
    """A fault in the bus model, which a scenario has with the table [bus]."""

    place: ClassVar[str] = "On the bus"

    @property
    def node_off(self) -> str | None:
        """The node whose CAN controller is held bus-off."""
        return None

    @property
    def destroyed_ids(self) -> frozenset[int]:
        """The identifiers whose transmissions are destroyed."""
        return frozenset()

    def acted(self, destroyed: int) -> int:
        """How often it has acted in an interval in which this many transmissions were destroyed."""
        return 1


class NamedFrames(Fault):
    """A fault of named frames."""

    frames: list[str] = Field(min_length=1, description="the frames' names in vibro.dbc")

    @field_validator("frames")
    @classmethod
    def _are_known(cls, frames: list[str]) -> list[str]:
        for name in frames:
            if name not in FRAME_IDS:
                raise ValueError(f"{name!r} is no frame of vibro.dbc; {nearest(name, list(FRAME_IDS))}")
        return frames

    @cached_property
    def can_ids(self) -> frozenset[int]:
        """The frames' identifiers."""
        return frozenset(FRAME_IDS[name] for name in self.frames)

    def without_object(self, scene: Scene, faults: Sequence[Fault]) -> str | None:
        """The frames that no sensor of the scene sends."""
        sensors = scene.sensors
        sampled = () if sensors is None else sensors.sampled()
        sent = {one.__name__: any(isinstance(own, one) for own in sampled) for one in SAMPLED}
        sent["GaitSensors"] = scene.gait is not None
        missing = [name for name in self.frames if not sent.get(name, True)]
        if not missing:
            return None
        names = ", ".join(missing)
        return f"the scene's sensors do not send {names}; leave it out, or give the scene the sensor"


class FramesFault(NamedFrames, LineFault):
    """A fault only of named frames, where they leave their sender."""

    @property
    def most_copies(self) -> int:
        """The largest number of frames that leave for one."""
        return 1

    def named(self, frames: Sequence[Frame]) -> list[Frame]:
        """Those of the frames that the fault names."""
        return [frame for frame in frames if frame.can_id in self.can_ids]

    def others(self, frames: Sequence[Frame]) -> list[Frame]:
        """Those of the frames that the fault does not name."""
        return [frame for frame in frames if frame.can_id not in self.can_ids]
