"""Runners connect the bench's nodes to bus and trace; a loop calls them in each tick, on every clock."""

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self, cast

import numpy as np

from firmware_py.core.config import Config
from firmware_py.interface import codec
from firmware_py.interface.enums import AxisState, OperatorRequest
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.received import RECEIVED_IDS
from firmware_py.interface.generated.records import OperatorCommand, SetAxisState, SetInputTorque
from firmware_py.shell.builds import Build, node_of
from firmware_py.shell.node import FirmwareNode, MakeNode, power_up
from firmware_py.shell.parameters import (
    addresses_from,
    config_from,
    format_file,
    select_build,
    with_overrides,
)
from hil.faults.fault import Fault
from hil.faults.line import FaultyBus
from hil.faults.on_process import MemoryFault
from hil.nodes.own_controller import OwnController, load_own
from hil.nodes.plant import ACCEPTED_IDS, PlantNode
from hil.record.traces.firmware_trace import open_firmware_trace
from hil.record.traces.own_trace import is_build, open_own_trace
from hil.record.traces.plant_trace import PlantRecord
from hil.record.traces.trace import Fields, OpenTrace, TraceWriter, no_trace
from hil.run_files import trace_file
from hil.scenario import operator
from hil.scenario.operator import Command, OperatorNode, OperatorRecord
from hil.scenario.scenario import Scenario
from hil.timing.loop import LoopTiming
from plant_sim.result import Impact
from plant_sim.scene import Scene
from plant_sim.sensors.gait import GaitTruth

SEED_OF_MEMORY = 3000
"""Independent of the seeds of all other faults."""
WARM_TICKS = 300
"""Ticks in which a node runs all its code before its clock starts: compiled kernels, imports, caches."""


class Pace(NamedTuple):
    """Period and duration of the nodes' ticks; a duration of None: until they are stopped."""

    period_s: float
    duration_s: float | None
    is_timed: bool = True
    """Whether ticks have deadlines; a trace's pages must then be in memory before the loop begins."""
    first_tick: int = 0
    """Above 0 for a process that replaces another and continues its traces."""

    @property
    def ticks(self) -> int | None:
        """Ticks of the whole run."""
        return None if self.duration_s is None else round(self.duration_s / self.period_s)

    @property
    def expected_records(self) -> int:
        """Records for which a trace needs room at once; 0 if it continues another, or has no end."""
        return 0 if self.first_tick > 0 else self.ticks or 0


class Making(NamedTuple):
    """What a node's runner is made from."""

    scenario: Scenario
    seed: int
    pace: Pace
    bus: FaultyBus
    faults: Sequence[Fault]
    """The script's faults for this node."""
    traces: OpenTrace = no_trace
    firmware: str | MakeNode = "compiled"
    """The build of the firmware, or a user's controller as `FILE.py:FUNCTION`, or what makes its node."""
    say: Callable[[str], object] = lambda _: None
    """Receives what the node reports to a person."""


def traces_in(folder: Path | None, pace: Pace) -> OpenTrace:
    """What opens the traces of a process in `folder`; a process that replaces another continues them."""
    if folder is None:
        return no_trace

    def opened(name: str, fields: Fields, is_ticked: bool = False) -> TraceWriter:
        expected = pace.expected_records if is_ticked else 0
        path = folder / trace_file(name)
        return TraceWriter(path, fields, expected, pace.first_tick > 0, pace.is_timed)

    return opened


class NodeRunner:
    """What the runner of a node that has a process of its own does in addition to a `Runner`."""

    accepted_ids: ClassVar[Collection[int]] = ()
    """The identifiers that it receives where the bus can filter."""

    @classmethod
    def make(cls, making: Making) -> Self:
        """The runner of a run."""
        raise NotImplementedError

    @staticmethod
    def warm(scenario: Scenario, firmware: str) -> None:
        """Run all code of the node once, before its process joins the bus."""

    def last_frames(self) -> list[Frame]:
        """The frames that the node sends last, when it ends."""
        return []

    @property
    def lost_records(self) -> int:
        """Records for which the disk had no room."""
        return 0


class PlantRunner(NodeRunner):
    """The plant's node at t_k: publish, obey the frames that have arrived, advance."""

    accepted_ids = ACCEPTED_IDS

    @classmethod
    def make(cls, making: Making) -> "PlantRunner":
        """The runner of a run."""
        scenario, seed, pace, bus, faults, traces, *_ = making
        node_id = addresses_from(scenario.parameters).drive_node
        return cls(scenario.scene, seed, pace, bus, traces, faults, node_id)

    @staticmethod
    def warm(scenario: Scenario, firmware: str = "") -> None:
        """Compile and run the scene's kernels on a temporary plant."""
        node = PlantNode(scenario.scene, seed=0)
        arm = codec.SET_AXIS_STATE.encode(SetAxisState(AxisState.CLOSED_LOOP_CONTROL))
        push = codec.SET_INPUT_TORQUE.encode(SetInputTorque(0.1))
        for _ in range(WARM_TICKS):
            node.publish()
            node.advance([arm, push])
            node.take_impacts()

    def __init__(
        self,
        scene: Scene,
        seed: int,
        pace: Pace,
        bus: FaultyBus,
        traces: OpenTrace = no_trace,
        faults: Sequence[Fault] = (),
        node_id: int = 0,
    ) -> None:
        """`node_id`: as of `PlantNode`."""
        self._make_node: Callable[..., PlantNode] = partial(
            PlantNode, scene, seed, pace.period_s, faults, node_id=node_id
        )
        self.node = self._make_node(pace.first_tick)
        self.bus = bus
        gait = [("gait", GaitTruth)] if scene.gait is not None else []
        self._trace = traces("plant", [("", PlantRecord), *gait, ("", LoopTiming)], is_ticked=True)
        self._impacts = traces("impacts", [("", Impact)])

    def restart(self, tick: int) -> None:
        """Replace the node by a new one whose first tick is `tick`."""
        self.node = self._make_node(tick)
        self.bus.restart()

    def step(self, tick: int) -> None:
        """Run one tick; the plant first advances by the time that the loop has skipped."""
        node, bus = self.node, self.bus
        if tick > node.tick:
            node.sleep_through(tick - node.tick, bus.receive())
        bus.send_all(node.publish())
        node.advance(bus.receive())

    def record(self, _: int, timing: LoopTiming) -> None:
        """Append the tick's records."""
        impacts = self.node.take_impacts()
        if self._trace is not None:
            gait = () if self.node.gait is None else (self.node.gait,)
            self._trace.append(self.node.record, *gait, timing)
        if self._impacts is not None:
            for impact in impacts:
                self._impacts.append(impact)

    @property
    def lost_records(self) -> int:
        """Records for which the disk had no room."""
        return sum(trace.lost for trace in (self._trace, self._impacts) if trace is not None)

    def close(self) -> None:
        """Close the traces."""
        for trace in (self._trace, self._impacts):
            if trace is not None:
                trace.close()


class ParameterMemory:
    """The parameter file that the firmware reads when it starts.

    `of_the_build`: the parameters that are no part of the file, because they are settled in the build.
    """

    def __init__(self, parameters: Mapping[str, Any], faults: Sequence[Fault] = (), seed: int = 1) -> None:
        self.of_the_build = select_build(parameters)
        self._text = format_file(with_overrides(parameters))
        self._damages = [fault for fault in faults if isinstance(fault, MemoryFault)]
        self._noise = np.random.default_rng([seed, SEED_OF_MEMORY])

    def read(self, t_s: float) -> str:
        """The file's content for a firmware that starts at `t_s`."""
        text = self._text
        for damage in self._damages:
            if damage.acts(t_s):
                damage.count()
                text = damage.damaged(text, self._noise)
        return text


class Controller(NamedTuple):
    """What makes a controller's node, and opens its trace for a run that may walk."""

    make_node: Callable[[Config], Any]
    open_trace: Callable[[OpenTrace, bool], Any] = open_firmware_trace


def controller_of(firmware: str | MakeNode) -> Controller:
    """The controller of a build of the firmware, of `FILE.py:FUNCTION`, or of a function that makes its node.

    Raises TextInputError.
    """
    if callable(firmware):
        return Controller(firmware)
    if is_build(firmware):
        return Controller(node_of(cast(Build, firmware)))
    file = load_own(firmware)
    return Controller(partial(OwnController, file), partial(open_own_trace, type(file.initial)))


INTERPRETED = Controller(FirmwareNode)
"""The firmware as Python runs it."""


class FirmwareRunner(NodeRunner):
    """The node of the firmware, or of a user's controller, at t_k + T/2: receive, tick, send."""

    accepted_ids = RECEIVED_IDS

    @classmethod
    def make(cls, making: Making) -> "FirmwareRunner":
        """The runner of a run. Raises TextInputError for a user's controller that cannot be loaded."""
        scenario, seed, pace, bus, faults, traces, firmware, say = making
        memory, walks = ParameterMemory(scenario.parameters, faults, seed), scenario.scene.gait is not None
        return cls(memory, pace, bus, traces, walks, controller_of(firmware), say)

    @staticmethod
    def warm(scenario: Scenario, firmware: str) -> None:
        """Run the build's code."""
        if is_build(firmware):
            warm_firmware(scenario.parameters, cast(Build, firmware))

    def __init__(
        self,
        memory: ParameterMemory,
        pace: Pace,
        bus: FaultyBus,
        traces: OpenTrace = no_trace,
        walks: bool = True,
        controller: Controller = INTERPRETED,
        say: Callable[[str], object] = lambda _: None,
    ) -> None:
        """`say` receives why a parameter file is refused."""
        self.bus = bus
        self.memory = memory
        self._make_node = controller.make_node
        self._say = say
        self._period_s = pace.period_s
        self._power_up(pace.first_tick)
        self.trace = controller.open_trace(traces, walks)

    def _power_up(self, tick: int) -> None:
        self.last_tick = tick - 1
        parameter_file = self.memory.read(tick * self._period_s)
        self.node = power_up(parameter_file, self.memory.of_the_build, self._make_node)
        if self.node.damage:
            self._say(self.node.damage)

    def restart(self, tick: int) -> None:
        """Replace the node by a new one whose first tick is `tick`."""
        self._power_up(tick)
        self.bus.restart()

    def step(self, tick: int) -> None:
        """Run one tick; the firmware first runs the periods that the loop has skipped."""
        self.bus.send_all(self.node.tick(self.bus.receive(), tick - self.last_tick))
        self.last_tick = tick

    def record(self, tick: int, timing: LoopTiming) -> None:
        """Append the tick's record."""
        if self.trace is not None:
            self.trace.append(self.node, tick, (tick + 0.5) * self._period_s, timing)

    def last_frames(self) -> list[Frame]:
        """The frames that the firmware sends last, when it ends: a torque of 0."""
        return [codec.SET_INPUT_TORQUE.encode(SetInputTorque(0.0))]

    @property
    def lost_records(self) -> int:
        """Records for which the disk had no room."""
        return 0 if self.trace is None else self.trace.writer.lost

    def close(self) -> None:
        """Close the trace."""
        if self.trace is not None:
            self.trace.writer.close()


def warm_firmware(parameters: Mapping[str, Any], build: Build = "python") -> None:
    """Run a temporary firmware on the frames of a drive at rest."""
    node = node_of(build)(config_from(parameters))
    for tick in range(WARM_TICKS):
        command = OperatorCommand(OperatorRequest.IDLE, 0.0, 0.0)
        node.tick([codec.OPERATOR_COMMAND.encode(command, tick)], 1)


class OperatorRunner:
    """The operator's node; call `step` in tick `due_tick`."""

    accepted_ids = operator.RECEIVED_IDS

    @classmethod
    def make(cls, making: Making) -> "OperatorRunner":
        """The runner of a run."""
        return cls(making.scenario.commands, making.pace, making.bus, making.traces)

    def __init__(
        self, commands: Sequence[Command], pace: Pace, bus: FaultyBus, traces: OpenTrace = no_trace
    ) -> None:
        self._trace = traces("operator", [("", OperatorRecord)])
        self.node = OperatorNode(commands, pace.period_s, is_recorded=self._trace is not None)
        self.bus = bus

    @property
    def due_tick(self) -> int:
        """Tick of the next step."""
        return self.node.due_tick

    def step(self, tick: int) -> None:
        """Act in `tick`."""
        self.bus.send_all(self.frames(tick))

    def frames(self, tick: int) -> list[Frame]:
        """The operator's frames of `tick`; appends its record to the trace."""
        frames = self.node.publish(tick, self.bus.receive())
        if self._trace is not None:
            self._trace.append(self.node.record())
        return frames

    def close(self) -> None:
        """Close the trace."""
        if self._trace is not None:
            self._trace.close()
