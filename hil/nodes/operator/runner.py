"""The operator's runner: its node with bus and trace."""

from collections.abc import Sequence

from firmware_py.interface.frame import Frame
from hil.faults.line import FaultyBus
from hil.nodes.operator.node import RECEIVED_IDS, OperatorNode, OperatorRecord
from hil.nodes.runner import Making, Pace
from hil.record.traces.trace import OpenTrace, no_trace
from hil.scenario.commands import Command


class OperatorRunner:
    """The operator's node; call `step` in tick `due_tick`."""

    accepted_ids = RECEIVED_IDS

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
