"""The tables [[script.faults]] of a scenario: the faults, their times and sizes.

The scenario's checks state the required reaction, on the truth: motor torque, stop force, impacts.
"""

import math
from typing import Annotated, Literal, TypeAlias

from pydantic import Field, field_validator

from firmware_py.interface.codec import CODECS
from plant_sim.tables.table import Table
from plant_sim.validation_messages import nearest

FRAME_IDS = {record.__name__: codec.can_id for record, codec in CODECS.items()}
"""Identifiers by the names that vibro.dbc gives the frames."""

Node: TypeAlias = Literal["plant", "firmware", "operator"]
Process: TypeAlias = Literal["plant", "firmware"]
Sensor: TypeAlias = Literal["striker", "striker-low", "striker-high", "housing", "encoder"]

Share = Annotated[
    float, Field(gt=0.0, le=1.0, description="the share of frames or readings hit, chosen at random, 0…1")
]


class FaultTable(Table):
    """The keys of every fault. It acts at times t with at_s ≤ t < at_s + duration_s."""

    at_s: float = Field(ge=0.0, description="the fault's beginning, in s from the start")
    duration_s: float | None = Field(
        default=None, gt=0.0, description="the fault's duration, in s; by default to the end of the run"
    )

    @property
    def end_s(self) -> float:
        """The end of the fault."""
        return math.inf if self.duration_s is None else self.at_s + self.duration_s

    def acts(self, t_s: float) -> bool:
        """Whether the fault acts at `t_s`, with a tolerance for rounded times."""
        return self.at_s - 1e-9 <= t_s < self.end_s - 1e-9


# --- on the bus ---------------------------------------------------------------------------------------


class FramesFault(FaultTable):
    """A fault of named frames."""

    frames: list[str] = Field(min_length=1, description="the frames' names in vibro.dbc")

    @field_validator("frames")
    @classmethod
    def _are_known(cls, frames: list[str]) -> list[str]:
        for name in frames:
            if name not in FRAME_IDS:
                raise ValueError(f"{name!r} is no frame of vibro.dbc; {nearest(name, list(FRAME_IDS))}")
        return frames

    @property
    def can_ids(self) -> frozenset[int]:
        """The frames' identifiers."""
        return frozenset(FRAME_IDS[name] for name in self.frames)


class Dropped(FramesFault):
    """Frames that never leave their sender."""

    kind: Literal["dropped"]
    share: Share = 1.0


class Duplicated(FramesFault):
    """Frames that are sent several times at once."""

    kind: Literal["duplicated"]
    copies: int = Field(default=2, ge=2, le=100, description="how many times each frame is sent")


class Delayed(FramesFault):
    """Frames that are delayed by a constant time."""

    kind: Literal["delayed"]
    delay_s: float = Field(gt=0.0, description="the delay, in s")


class Bundled(FramesFault):
    """Frames that wait and arrive in bundles, as from a USB adapter with a latency timer or a gateway."""

    kind: Literal["bundled"]
    period_s: float = Field(gt=0.0, le=1.0, description="the time from one bundle to the next, in s")


class Thinned(FramesFault):
    """Frames at a lower rate: the frames in between never leave their sender."""

    kind: Literal["thinned"]
    period_s: float = Field(gt=0.0, le=10.0, description="the time between two frames that leave, in s")


class Reordered(FramesFault):
    """Frames of an identifier that change their order in pairs."""

    kind: Literal["reordered"]


class Corrupted(FramesFault):
    """Frames with some inverted bits in one byte, not detected by the CAN controller's own checksum."""

    kind: Literal["corrupted"]
    share: Share = 1.0


class Babbling(FaultTable):
    """A foreign node that sends one frame again and again."""

    kind: Literal["babbling"]
    can_id: int = Field(ge=0, le=0x7FF, description="the frame's identifier")
    data_hex: str = Field(
        default="", pattern="^([0-9a-fA-F]{2}){0,8}$", description="the frame's data in hex"
    )
    period_s: float = Field(ge=2e-5, description="the time between two frames, in s")


class Flood(FaultTable):
    """A foreign node that sends random data of random length on random identifiers."""

    kind: Literal["flood"]
    frames_a_tick: int = Field(ge=1, le=1000, description="the number of frames in each tick of the bench")


class Unplugged(FaultTable):
    """A node with its connector off: it neither sends nor receives."""

    kind: Literal["unplugged"]
    node: Node = Field(description="the node: plant, firmware or operator")


class BusOff(FaultTable):
    """A node whose CAN controller is held bus-off; afterwards it recovers by the rules of CAN."""

    kind: Literal["bus-off"]
    node: Node = Field(description="the node: plant, firmware or operator")


class Disturbed(FramesFault):
    """Transmissions destroyed on the wire: error frames, repetition, error counters."""

    kind: Literal["disturbed"]


# --- at the sensors ------------------------------------------------------------------------------------


class SensorFault(FaultTable):
    """A fault of one sensor's readings."""

    sensor: Sensor = Field(
        description="the sensor: striker (both ranges), striker-low, striker-high, housing or encoder"
    )


class SensorStuck(SensorFault):
    """A sensor that repeats its last reading."""

    kind: Literal["sensor-stuck"]


class SensorNoisy(SensorFault):
    """Additional normal noise: of accelerations in m/s², of the encoder's angle in rad."""

    kind: Literal["sensor-noisy"]
    std: float = Field(gt=0.0, description="the noise's standard deviation, in m/s² or rad")


class SensorBiased(SensorFault):
    """An additional constant: of accelerations in m/s², of the encoder's angle in rad."""

    kind: Literal["sensor-biased"]
    bias: float = Field(description="the constant, in m/s² or rad")


class SensorClipped(SensorFault):
    """Accelerations that are clipped at a limit."""

    kind: Literal["sensor-clipped"]
    limit_m_s2: float = Field(gt=0.0, description="the largest reading, in m/s²")


class SensorSlow(SensorFault):
    """Readings that lag, as behind a filter of first order."""

    kind: Literal["sensor-slow"]
    lag_s: float = Field(gt=0.0, le=1.0, description="the filter's time constant, in s")


class SensorWrongSign(SensorFault):
    """A sensor mounted the wrong way round."""

    kind: Literal["sensor-wrong-sign"]


class SensorIntermittent(SensorFault):
    """Readings that are 0 now and then, as with a loose contact."""

    kind: Literal["sensor-intermittent"]
    share: Share = 0.5


# --- in the drive and the module -----------------------------------------------------------------------


class EncoderSlip(FaultTable):
    """The encoder's magnet slips on the shaft, once."""

    kind: Literal["encoder-slip"]
    slip_rev: float = Field(ge=-0.5, le=0.5, description="the angle of the slip, in revolutions")


class EncoderWrap(FaultTable):
    """The drive's position is a count of revolutions, as a float32, not circular, and wraps at a limit."""

    kind: Literal["encoder-wrap"]
    count_rev: int = Field(ge=0, lt=2**24, description="the count at the fault's beginning, in revolutions")
    wraps_at_rev: int = Field(
        default=2**24, ge=1, le=2**24, description="the count that wraps to its negative, in revolutions"
    )


class MotorStall(FaultTable):
    """The crank jams."""

    kind: Literal["motor-stall"]


class PhaseLoss(FaultTable):
    """One winding is disconnected: the torque pulsates, with half of its mean."""

    kind: Literal["phase-loss"]


class TorqueStuck(FaultTable):
    """The drive ignores its torque command and gives a constant torque while its axis is closed."""

    kind: Literal["torque-stuck"]
    torque_n_m: float = Field(ge=-10.0, le=10.0, description="the drive's torque, in N m")


class OverTemperature(FaultTable):
    """The winding is held at a temperature."""

    kind: Literal["over-temperature"]
    motor_degc: float = Field(description="the winding's temperature, in °C")


class SupplySag(FaultTable):
    """The supply has a different voltage."""

    kind: Literal["supply-sag"]
    supply_v: float = Field(gt=0.0, le=60.0, description="the supply's voltage, in V")


class BrownOut(FaultTable):
    """The drive's electronics lose their supply, and restart at the fault's end."""

    kind: Literal["brown-out"]


class StiffnessChanged(FaultTable):
    """The coupling spring has a different stiffness."""

    kind: Literal["stiffness-changed"]
    factor: float = Field(gt=0.0, le=10.0, description="the new stiffness divided by the old one")


class FrictionChanged(FaultTable):
    """The guide has different friction."""

    kind: Literal["friction-changed"]
    factor: float = Field(ge=0.0, le=1000.0, description="the new coefficients divided by the old ones")


class StopMoved(FaultTable):
    """The stop is shifted."""

    kind: Literal["stop-moved"]
    by_m: float = Field(ge=-0.2, le=0.2, description="the shift in m, positive away from the drive")


class Kick(FaultTable):
    """An impulse from outside changes the striker's velocity, once."""

    kind: Literal["kick"]
    change_m_s: float = Field(description="the change of velocity in m/s, positive towards the stop")


# --- in the processes ----------------------------------------------------------------------------------


class Killed(FaultTable):
    """A process is killed and not restarted."""

    kind: Literal["killed"]
    process: Process = Field(description="the process: plant or firmware")


class Paused(FaultTable):
    """A process is stopped, and then continues."""

    kind: Literal["paused"]
    process: Process = Field(description="the process: plant or firmware")
    duration_s: float = Field(gt=0.0, description="the duration of the stall, in s")


class Restarted(FaultTable):
    """A process is killed, and a new one starts from its initial state."""

    kind: Literal["restarted"]
    process: Process = Field(description="the process: plant or firmware")
    duration_s: float = Field(ge=0.1, description="the time until the new process starts, in s")


class ClockJumped(FaultTable):
    """The controller's clock jumps once while the controller runs."""

    kind: Literal["clock-jumped"]
    by_s: float = Field(ge=-10.0, le=10.0, description="the change in s, positive forwards")


class ClockJitter(FaultTable):
    """A clock that wakes its process late, by a random time."""

    kind: Literal["clock-jitter"]
    process: Process = Field(description="the process: plant or firmware")
    largest_s: float = Field(
        gt=0.0, le=0.1, description="the largest delay, in s; each is sampled from 0 to this"
    )


class ParametersDamaged(FaultTable):
    """A digit of the firmware's parameter file is changed, for a firmware that starts during the fault."""

    kind: Literal["parameters-damaged"]


LineFault: TypeAlias = (
    Dropped | Duplicated | Delayed | Bundled | Thinned | Reordered | Corrupted | Babbling | Flood | Unplugged
)
ModelledFault: TypeAlias = BusOff | Disturbed
ReadingFault: TypeAlias = (
    SensorStuck
    | SensorNoisy
    | SensorBiased
    | SensorClipped
    | SensorSlow
    | SensorWrongSign
    | SensorIntermittent
    | EncoderSlip
)
PhysicalFault: TypeAlias = (
    MotorStall
    | PhaseLoss
    | TorqueStuck
    | OverTemperature
    | SupplySag
    | BrownOut
    | EncoderWrap
    | StiffnessChanged
    | FrictionChanged
    | StopMoved
    | Kick
)
ProcessFault: TypeAlias = Killed | Paused | Restarted
ClockFault: TypeAlias = ClockJumped | ClockJitter
Fault: TypeAlias = (
    LineFault | ModelledFault | ReadingFault | PhysicalFault | ProcessFault | ClockFault | ParametersDamaged
)
AnyFault = Annotated[Fault, Field(discriminator="kind")]
