"""The runner of the firmware or of a user's controller: its node with parameter memory, bus and trace."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np

from firmware_py.core.config import Config
from firmware_py.interface import codec
from firmware_py.interface.enums import OperatorRequest
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.received import RECEIVED_IDS
from firmware_py.interface.generated.records import OperatorCommand, SetInputTorque
from firmware_py.shell.builds import Build, is_build, node_of
from firmware_py.shell.node import FirmwareNode, MakeNode, power_up
from firmware_py.shell.parameters import config_from, format_file, select_build, with_overrides
from hil.faults.fault import Fault
from hil.faults.line import FaultyBus
from hil.faults.on_process import MemoryFault
from hil.nodes.firmware.own_controller import OwnController, load_own
from hil.nodes.runner import WARM_TICKS, Making, NodeRunner, Pace
from hil.record.traces.firmware_trace import open_firmware_trace
from hil.record.traces.own_trace import open_own_trace
from hil.record.traces.trace import OpenTrace, no_trace
from hil.scenario.scenario import Scenario
from hil.timing.loop import LoopTiming

SEED_OF_MEMORY = 3000
"""Independent of the seeds of all other faults."""


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
