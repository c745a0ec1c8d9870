"""The plant's runner: its node with bus and traces."""

from collections.abc import Callable, Sequence
from functools import partial

from firmware_py.interface import codec
from firmware_py.interface.enums import AxisState
from firmware_py.interface.generated.records import SetAxisState, SetInputTorque
from firmware_py.shell.parameters import addresses_from
from hil.faults.fault import Fault
from hil.faults.line import FaultyBus
from hil.nodes.plant.alone import CompiledTicks
from hil.nodes.plant.node import ACCEPTED_IDS, PlantNode
from hil.nodes.runner import WARM_TICKS, Making, NodeRunner, Pace
from hil.record.traces.plant_trace import PlantRecord
from hil.record.traces.trace import OpenTrace, no_trace
from hil.scenario.scenario import Scenario
from hil.timing.loop import LoopTiming
from plant_sim.result import Impact
from plant_sim.scene import Scene
from plant_sim.sensors.gait import GaitTruth


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
        self.bus = bus
        gait = [("gait", GaitTruth)] if scene.gait is not None else []
        self._trace = traces("plant", [("", PlantRecord), *gait, ("", LoopTiming)], is_ticked=True)
        self._impacts = traces("impacts", [("", Impact)])
        self._is_alone = pace.is_timed and self._trace is None and not faults
        self._power_up(pace.first_tick)

    def _power_up(self, tick: int) -> None:
        self.node = self._make_node(tick)
        self._compiled = CompiledTicks(self.node) if self._is_alone else None

    def restart(self, tick: int) -> None:
        """Replace the node by a new one whose first tick is `tick`."""
        self._power_up(tick)
        self.bus.restart()

    def step(self, tick: int) -> None:
        """Run one tick; the plant first advances by the time that the loop has skipped."""
        node, bus = self.node, self.bus
        if tick > node.tick:
            node.sleep_through(tick - node.tick, bus.receive())
        if self._compiled is not None and not node.note_requests(()):
            bus.send_all(self._compiled.step(bus.receive()))
            return
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
