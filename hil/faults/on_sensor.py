"""Faults at the sensors: the published reading as a function of the true one."""

import math
from typing import ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field, PrivateAttr

from hil.faults.fault import Fault
from plant_sim.sensors.readings import SensorReading

TURN_RAD = 2.0 * math.pi
Sensor: TypeAlias = Literal["striker", "striker-low", "striker-high", "housing", "encoder"]
FIELDS = {
    "striker": ("striker_low_m_s2", "striker_high_m_s2"),
    "striker-low": ("striker_low_m_s2",),
    "striker-high": ("striker_high_m_s2",),
    "housing": ("housing_m_s2",),
    "encoder": ("encoder_position_rev", "encoder_velocity_rev_s"),
}


class Past(NamedTuple):
    """The last reading before the fault began, and the fault's last output, `elapsed_s` ago."""

    before: SensorReading
    given: SensorReading
    elapsed_s: float


class ReadingFault(Fault):
    """A fault of the sensors' readings."""

    place: ClassVar[str] = "At the sensors"

    _past: Past | None = PrivateAttr()

    @property
    def acts_in(self) -> str | None:
        """The plant's node."""
        return "plant"

    def begin(self, noise: np.random.Generator) -> None:
        """Begin anew, as in a process that starts: no reading has been given."""
        super().begin(noise)
        self._past = None

    def published(self, reading: SensorReading, last: SensorReading, elapsed_s: float) -> SensorReading:
        """The reading under this fault, `elapsed_s` after the `last` published one; counts a changed one."""
        past = self._past or Past(last, last, elapsed_s)
        given = self.disturbed(reading, past._replace(elapsed_s=elapsed_s))
        self.count(given != reading)
        self._past = past._replace(given=given)
        return given

    def disturbed(self, reading: SensorReading, past: Past) -> SensorReading:
        """The reading under this fault."""
        raise NotImplementedError


class SensorFault(ReadingFault):
    """A fault of one sensor's readings."""

    sensor: Sensor = Field(
        description="the sensor: striker (both ranges), striker-low, striker-high, housing or encoder"
    )

    @property
    def fields(self) -> tuple[str, ...]:
        """The sensor's values in a reading."""
        return FIELDS[self.sensor]


def shifted(reading: SensorReading, sensor: str, by: float) -> SensorReading:
    """The reading with `by` added: m/s² to accelerations, rad to the encoder's angle."""
    if sensor == "encoder":
        return reading._replace(encoder_position_rev=(reading.encoder_position_rev + by / TURN_RAD) % 1.0)
    return reading._replace(**{name: getattr(reading, name) + by for name in FIELDS[sensor]})
