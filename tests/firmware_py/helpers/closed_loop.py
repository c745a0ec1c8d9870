"""The firmware's node on the simulated module, frame by frame, with a drive that obeys at once."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from firmware_py.builds.flat import from_flat, to_flat
from firmware_py.core.config import Config
from firmware_py.core.inputs import Inputs
from firmware_py.core.state import Outputs, State
from firmware_py.interface import codec
from firmware_py.interface.enums import AxisState, Mode, OperatorRequest
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import (
    Accelerometer,
    DriveCurrent,
    DriveErrors,
    DriveEstop,
    DriveHeartbeat,
    DriveSupply,
    DriveTemperature,
    EncoderEstimates,
    OperatorCommand,
    SetAxisState,
    SetInputTorque,
)
from firmware_py.shell.builds import Build, node_of
from firmware_py.shell.flat_node import FlatNode
from firmware_py.shell.parameters import config_from
from plant_sim.plant import Plant
from plant_sim.result import MotionState
from plant_sim.scene import load_scene

T = TypeVar("T")
Change = Callable[[int, list[Frame]], list[Frame]]
"""What happens to the frames of a tick on their way to the firmware."""
KT_N_M_A = 0.08
TICK_S = 0.001
CONSENT_S = 0.3
"""Time until a request counts that is repeated every 0.1 s."""

SCENE: dict[str, dict[str, Any]] = {
    "striker": {"mass_kg": 0.8, "spring_n_m": 70.0, "rest_length_m": 0.12},
    "drive": {"model": "motor", "amplitude_m": 0.02},
    "friction": {"law": "viscous", "b_n_s_m": 0.2},
    "stop": {"law": "hunt-crossley", "position_m": 0.18, "restitution": 0.5, "contact_s": 0.01},
    "motor": {},
    "sensors": {},
}
"""The firmware's nominal module as a plant."""


def scene_with(**tables: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """`SCENE` with tables replaced, or extended where the law stays the same."""
    changed = dict(SCENE)
    for name, table in tables.items():
        changed[name] = table if "law" in table else {**SCENE.get(name, {}), **table}
    return changed


def without(*codecs: codec.FrameCodec[Any]) -> Change:
    """Without the frames of some kinds."""
    ids = {its_codec.can_id for its_codec in codecs}
    return lambda _, frames: [frame for frame in frames if frame.can_id not in ids]


def instead(its_codec: codec.FrameCodec[Any], record: Any) -> Change:
    """Every frame of a kind says this."""
    return lambda tick, frames: [
        its_codec.encode(record, tick) if frame.can_id == its_codec.can_id else frame for frame in frames
    ]


def bundled(ticks: int) -> Change:
    """All frames wait, and come together once in `ticks`."""
    held: list[Frame] = []

    def change(tick: int, frames: list[Frame]) -> list[Frame]:
        held.extend(frames)
        if tick % ticks:
            return []
        bundle = list(held)
        held.clear()
        return bundle

    return change


@dataclass
class Kept(Sequence[T]):
    """A record of each kept tick: taken as it stands in the node's memory, read when it is looked at."""

    take: Callable[[], Any] = field(compare=False)
    read: Callable[[Any], T] = field(compare=False)
    rows: list[Any] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.rows)

    @overload
    def __getitem__(self, place: int) -> T: ...
    @overload
    def __getitem__(self, place: slice) -> list[T]: ...
    def __getitem__(self, place: int | slice) -> T | list[T]:
        if isinstance(place, slice):
            return [self.read(row) for row in self.rows[place]]
        return self.read(self.rows[place])


@dataclass
class Bench:
    """Lockstep: sensors at t_k, the node's tick, its torque from t_{k+1}."""

    parameters: dict[str, Any] = field(default_factory=dict)
    scene: dict[str, Any] = field(default_factory=lambda: SCENE)
    seed: int = 1
    request: OperatorRequest = OperatorRequest.IDLE
    ratio: float = 1.3
    impulse_n_s: float = 0.0
    change: Change = lambda _, frames: frames
    overrun: Callable[[int], bool] = lambda _: False
    """Whether the firmware misses this tick; its frames wait for the next one."""
    build: Build = "compiled"

    def __post_init__(self) -> None:
        self.node = node_of(self.build)(config_from(self.parameters))
        self.plant = Plant(load_scene(self.scene), self.seed)
        self.tick = 0
        self.axis_state = AxisState.IDLE.value
        self.axis_error = 0
        self.torque_n_m = 0.0
        self.waiting: list[Frame] = []
        self.elapsed_ticks = 0
        self.sent: list[Frame] = []
        self.inputs: Kept[Inputs] = self._kept(Inputs, "inputs", "inputs")
        self.states: Kept[State] = self._kept(State, "state", "core")
        self.outputs: Kept[Outputs] = self._kept(Outputs, "outputs", "outputs")
        self.motions: list[MotionState] = []
        self.touch_downs: list[tuple[float, float]] = []

    def _kept(self, kind: Any, attribute: str, member: str) -> "Kept[Any]":
        node = self.node
        if not isinstance(node, FlatNode):
            return Kept(lambda: getattr(node, attribute), lambda record: record)
        memory = node.memory[member]
        return Kept(memory.tobytes, lambda row: from_flat(kind, np.frombuffer(row, memory.dtype)[0].item()))

    def configure(self, config: Config) -> None:
        """Another configuration from now on."""
        self.node.config = config
        if isinstance(self.node, FlatNode):
            self.node.flat_config[:] = to_flat(config)
            self.node.push_memory()

    @property
    def mode(self) -> Mode:
        """The firmware's mode, without the rest of the compiled build's outputs, which take long to read."""
        if isinstance(self.node, FlatNode):
            return Mode(int(self.node.memory["outputs"]["mode"][0]))
        return self.node.outputs.mode

    def frames(self) -> list[Frame]:
        """What the plant and the operator send at t_k."""
        k = self.tick
        s = self.plant.sense()
        frames = [
            codec.ENCODER_ESTIMATES.encode(
                EncoderEstimates(s.encoder_position_rev, s.encoder_velocity_rev_s)
            ),
            codec.ACCELEROMETER.encode(
                Accelerometer(s.striker_low_m_s2, s.striker_high_m_s2, s.housing_m_s2), k
            ),
        ]
        if k % 10 == 0:
            current_a = self.torque_n_m / KT_N_M_A
            frames.append(codec.DRIVE_CURRENT.encode(DriveCurrent(current_a, current_a)))
        if k % 100 == 0:
            frames += [
                codec.DRIVE_HEARTBEAT.encode(DriveHeartbeat(self.axis_error, self.axis_state, 0, 0)),
                codec.DRIVE_ERRORS.encode(DriveErrors(self.axis_error, self.axis_error)),
                codec.DRIVE_TEMPERATURE.encode(DriveTemperature(30.0, 30.0)),
                codec.DRIVE_SUPPLY.encode(DriveSupply(24.0, 0.5)),
                codec.OPERATOR_COMMAND.encode(
                    OperatorCommand(self.request.value, self.ratio, self.impulse_n_s), k // 100
                ),
            ]
        return frames

    def run(self, seconds: float, keep: bool = True) -> Outputs:
        """Go on for `seconds`; the last outputs."""
        for _ in range(round(seconds * 1000)):
            self.waiting += self.change(self.tick, self.frames())
            self.elapsed_ticks += 1
            self.sent = []
            if not self.overrun(self.tick):
                self.sent = self.node.tick(self.waiting, self.elapsed_ticks)
                self.waiting, self.elapsed_ticks = [], 0
            if keep:
                for records in (self.inputs, self.states, self.outputs):
                    records.rows.append(records.take())
                self.motions.append(self.plant.state)
            acting_n_m = self.torque_n_m if self.axis_state == AxisState.CLOSED_LOOP_CONTROL else 0.0
            self.plant.advance(acting_n_m, TICK_S)
            self.touch_downs += [(impact.t_s, impact.v_m_s) for impact in self.plant.take_impacts()]
            self._obey(self.sent)
            self.tick += 1
        return self.node.outputs

    def records(self) -> list[Any]:
        """What the node sent in the last tick."""
        return [codec.decode(frame) for frame in self.sent]

    def sent_in(self, seconds: float, keep: bool = False) -> list[Any]:
        """Run this time; every record that the node sent meanwhile."""
        sent: list[Any] = []
        for _ in range(round(seconds / TICK_S)):
            self.run(TICK_S, keep)
            sent += self.records()
        return sent

    def _obey(self, frames: list[Frame]) -> None:
        for frame in frames:
            record = codec.decode(frame)
            if isinstance(record, SetInputTorque):
                self.torque_n_m = record.torque_n_m
            elif isinstance(record, SetAxisState):
                if self.axis_error == 0 or record.requested_state == AxisState.IDLE:
                    self.axis_state = record.requested_state
            elif isinstance(record, DriveEstop):
                self.axis_state, self.axis_error = AxisState.IDLE.value, 0x02000000
            elif frame.can_id == codec.CLEAR_ERRORS.can_id:
                self.axis_error = 0

    def asked_again(self) -> Mode:
        """The mode after a request IDLE and then RUN, as READY needs it after a stop."""
        for request, duration_s in ((OperatorRequest.IDLE, 0.3), (OperatorRequest.RUN, 0.3 + CONSENT_S)):
            self.request = request
            self.run(duration_s, keep=False)
        return self.node.outputs.mode

    def started(self, rest_s: float = 0.4) -> "Bench":
        """Through INIT and READY, and ask for RUN until it counts in the next tick."""
        self.run(rest_s - CONSENT_S)
        self.request = OperatorRequest.RUN
        self.run(CONSENT_S)
        return self

    def column(self, value: Callable[[State, Outputs, MotionState], float]) -> NDArray[np.float64]:
        """One value a kept tick."""
        rows = zip(self.states, self.outputs, self.motions, strict=True)
        return np.array([value(*row) for row in rows])
