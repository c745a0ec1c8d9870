"""The tables [[script.faults]] of a scenario: what breaks, when, for how long, and how badly.

The scenario's checks say what must follow, on the truth: the motor's torque, the stop's force, impacts.
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

Share = Annotated[float, Field(gt=0.0, le=1.0, description="the share of what is hit, chosen at random, 0…1")]


class FaultTable(Table):
    """What every fault is given. It acts on t with at_s ≤ t < at_s + duration_s."""

    at_s: float = Field(ge=0.0, description="when it begins, in s from the start")
    duration_s: float | None = Field(
        default=None, gt=0.0, description="how long it lasts, in s; left out: to the end of the run"
    )

    @property
    def end_s(self) -> float:
        """When it is over."""
        return math.inf if self.duration_s is None else self.at_s + self.duration_s

    def acts(self, t_s: float) -> bool:
        """Whether it acts at `t_s`; rounding of times aside."""
        return self.at_s - 1e-9 <= t_s < self.end_s - 1e-9


# --- on the bus ---------------------------------------------------------------------------------------


class FramesFault(FaultTable):
    """A fault of the frames that are named."""

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
    """Frames that come again at once."""

    kind: Literal["duplicated"]
    copies: int = Field(default=2, ge=2, le=100, description="how often each frame comes")


class Delayed(FramesFault):
    """Frames that come late, each by as much."""

    kind: Literal["delayed"]
    delay_s: float = Field(gt=0.0, description="how late frames come, in s")


class Bundled(FramesFault):
    """Frames that wait and come together, as through a USB adapter with a latency timer or a gateway."""

    kind: Literal["bundled"]
    period_s: float = Field(gt=0.0, le=1.0, description="the time from one bundle to the next, in s")


class Thinned(FramesFault):
    """Frames at a lower rate: those in between never leave their sender."""

    kind: Literal["thinned"]
    period_s: float = Field(
        gt=0.0, le=10.0, description="the time from one frame that leaves to the next, in s"
    )


class Reordered(FramesFault):
    """Of each two frames of an identifier the later one comes first."""

    kind: Literal["reordered"]


class Corrupted(FramesFault):
    """Frames with some bits of one byte turned over, behind the CAN controller's own checksum."""

    kind: Literal["corrupted"]
    share: Share = 1.0


class Babbling(FaultTable):
    """A stranger on the bus that sends one frame again and again."""

    kind: Literal["babbling"]
    can_id: int = Field(ge=0, le=0x7FF, description="the identifier it sends")
    data_hex: str = Field(default="", pattern="^([0-9a-fA-F]{2}){0,8}$", description="its data in hex")
    period_s: float = Field(ge=2e-5, description="the time between its frames, in s")


class Flood(FaultTable):
    """A stranger on the bus that sends random data of random length on random identifiers."""

    kind: Literal["flood"]
    frames_a_tick: int = Field(ge=1, le=1000, description="frames in each of the bench's ticks")


class Unplugged(FaultTable):
    """A node whose connector is off: it neither sends nor receives."""

    kind: Literal["unplugged"]
    node: Node = Field(description="the node: plant, firmware or operator")


class BusOff(FaultTable):
    """A node whose CAN controller has gone bus-off, held there; afterwards it recovers by CAN's rules."""

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
    """The last reading, again and again."""

    kind: Literal["sensor-stuck"]


class SensorNoisy(SensorFault):
    """Normal noise on top, of accelerations in m/s², of the encoder's angle in rad."""

    kind: Literal["sensor-noisy"]
    std: float = Field(gt=0.0, description="the noise's standard deviation, in m/s² or rad")


class SensorBiased(SensorFault):
    """A constant on top, of accelerations in m/s², of the encoder's angle in rad."""

    kind: Literal["sensor-biased"]
    bias: float = Field(description="what is added, in m/s² or rad")


class SensorClipped(SensorFault):
    """Accelerations that end at a limit."""

    kind: Literal["sensor-clipped"]
    limit_m_s2: float = Field(gt=0.0, description="the largest reading, in m/s²")


class SensorSlow(SensorFault):
    """Readings that lag behind, as of a filter of first order."""

    kind: Literal["sensor-slow"]
    lag_s: float = Field(gt=0.0, le=1.0, description="the filter's time constant, in s")


class SensorWrongSign(SensorFault):
    """A sensor mounted the wrong way round."""

    kind: Literal["sensor-wrong-sign"]


class SensorIntermittent(SensorFault):
    """Readings that are 0 now and then, as of a loose contact."""

    kind: Literal["sensor-intermittent"]
    share: Share = 0.5


# --- in the drive and the module -----------------------------------------------------------------------


class EncoderSlip(FaultTable):
    """The encoder's magnet turns on the shaft, once."""

    kind: Literal["encoder-slip"]
    slip_rev: float = Field(ge=-0.5, le=0.5, description="by how much, in revolutions")


class EncoderWrap(FaultTable):
    """The drive no longer counts in a circle but on and on, as a float32 of revolutions, and wraps round."""

    kind: Literal["encoder-wrap"]
    count_rev: int = Field(ge=0, lt=2**24, description="what it has counted when it begins, in revolutions")
    wraps_at_rev: int = Field(
        default=2**24, ge=1, le=2**24, description="where the count goes over to its negative, in revolutions"
    )


class MotorStall(FaultTable):
    """The crank jams."""

    kind: Literal["motor-stall"]


class PhaseLoss(FaultTable):
    """One winding's wire is off: torque pulsates, and is half on average."""

    kind: Literal["phase-loss"]


class TorqueStuck(FaultTable):
    """The drive ignores the torque it is commanded: while its axis is closed it gives another."""

    kind: Literal["torque-stuck"]
    torque_n_m: float = Field(ge=-10.0, le=10.0, description="the torque that it gives, in N m")


class OverTemperature(FaultTable):
    """The winding is held at a temperature."""

    kind: Literal["over-temperature"]
    motor_degc: float = Field(description="the winding's temperature, in °C")


class SupplySag(FaultTable):
    """The supply gives another voltage."""

    kind: Literal["supply-sag"]
    supply_v: float = Field(gt=0.0, le=60.0, description="the supply's voltage, in V")


class BrownOut(FaultTable):
    """The drive's electronics go off, and start anew when it is over."""

    kind: Literal["brown-out"]


class StiffnessChanged(FaultTable):
    """The coupling spring is another."""

    kind: Literal["stiffness-changed"]
    factor: float = Field(gt=0.0, le=10.0, description="the new stiffness over the old")


class FrictionChanged(FaultTable):
    """The guide's friction is another."""

    kind: Literal["friction-changed"]
    factor: float = Field(ge=0.0, le=1000.0, description="the new coefficients over the old")


class StopMoved(FaultTable):
    """The stop has shifted."""

    kind: Literal["stop-moved"]
    by_m: float = Field(ge=-0.2, le=0.2, description="by how much, in m, away from the drive positive")


class Kick(FaultTable):
    """An impulse from outside changes the striker's velocity, once."""

    kind: Literal["kick"]
    change_m_s: float = Field(description="by how much, in m/s, towards the stop positive")


# --- in the processes ----------------------------------------------------------------------------------


class Killed(FaultTable):
    """A process ends without a word, and stays away."""

    kind: Literal["killed"]
    process: Process = Field(description="the process: plant or firmware")


class Paused(FaultTable):
    """A process stands still, and then goes on."""

    kind: Literal["paused"]
    process: Process = Field(description="the process: plant or firmware")
    duration_s: float = Field(gt=0.0, description="how long it stands still, in s")


class Restarted(FaultTable):
    """A process ends without a word, and one like it starts from nothing."""

    kind: Literal["restarted"]
    process: Process = Field(description="the process: plant or firmware")
    duration_s: float = Field(ge=0.1, description="how long it is away, in s")


class ClockJumped(FaultTable):
    """The controller's clock is set, once, while it runs."""

    kind: Literal["clock-jumped"]
    by_s: float = Field(ge=-10.0, le=10.0, description="by how much, in s, forwards positive")


class ClockJitter(FaultTable):
    """A clock that wakes its process late, each time by another time."""

    kind: Literal["clock-jitter"]
    process: Process = Field(description="the process: plant or firmware")
    largest_s: float = Field(gt=0.0, le=0.1, description="each is sampled from 0 to this, in s")


class ParametersDamaged(FaultTable):
    """A digit of the firmware's parameter file is another, for a firmware that starts while it acts."""

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
