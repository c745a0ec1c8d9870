"""Sensor faults: what is published of a true reading."""

import math
from collections.abc import Sequence
from typing import TypeGuard, get_args

import numpy as np

from hil.faults.tables import (
    EncoderSlip,
    Fault,
    ReadingFault,
    SensorBiased,
    SensorClipped,
    SensorIntermittent,
    SensorNoisy,
    SensorStuck,
    SensorWrongSign,
)
from plant_sim.sensors import SensorReading

TURN_RAD = 2.0 * math.pi
FIELDS = {
    "striker": ("striker_low_m_s2", "striker_high_m_s2"),
    "striker-low": ("striker_low_m_s2",),
    "striker-high": ("striker_high_m_s2",),
    "housing": ("housing_m_s2",),
    "encoder": ("encoder_position_rev", "encoder_velocity_rev_s"),
}
POSITION = "encoder_position_rev"


def is_of_a_sensor(fault: Fault) -> TypeGuard[ReadingFault]:
    """Whether a fault acts here."""
    return isinstance(fault, get_args(ReadingFault))


def shifted(reading: SensorReading, sensor: str, by: float) -> SensorReading:
    """The reading with `by` added: m/s² to accelerations, rad to the encoder's angle."""
    if sensor == "encoder":
        return reading._replace(encoder_position_rev=(reading.encoder_position_rev + by / TURN_RAD) % 1.0)
    return reading._replace(**{name: getattr(reading, name) + by for name in FIELDS[sensor]})


def disturbed(  # noqa: PLR0911 - one case a fault
    fault: ReadingFault, reading: SensorReading, before: SensorReading, noise: np.random.Generator
) -> SensorReading:
    """The reading under one fault; `before` is the last one before it began."""
    match fault:
        case EncoderSlip(slip_rev=slip_rev):
            return shifted(reading, "encoder", slip_rev * TURN_RAD)
        case SensorStuck(sensor=sensor):
            return reading._replace(**{name: getattr(before, name) for name in FIELDS[sensor]})
        case SensorNoisy(sensor=sensor, std=std):
            return shifted(reading, sensor, std * float(noise.standard_normal()))
        case SensorBiased(sensor=sensor, bias=bias):
            return shifted(reading, sensor, bias)
        case SensorClipped(sensor=sensor, limit_m_s2=limit_m_s2):
            return reading._replace(
                **{
                    name: min(max(getattr(reading, name), -limit_m_s2), limit_m_s2)
                    for name in FIELDS[sensor]
                    if not name.startswith("encoder")
                }
            )
        case SensorWrongSign(sensor=sensor):
            turned = reading._replace(**{name: -getattr(reading, name) for name in FIELDS[sensor]})
            return turned._replace(encoder_position_rev=turned.encoder_position_rev % 1.0)
        case SensorIntermittent(sensor=sensor, share=share):
            if noise.random() >= share:
                return reading
            return reading._replace(**dict.fromkeys(FIELDS[sensor], 0.0))


class SensorFaults:
    """All sensor faults of a scenario; `published` once a reading."""

    def __init__(self, faults: Sequence[Fault], seed: int) -> None:
        self._faults = [fault for fault in faults if is_of_a_sensor(fault)]
        self._noise = [np.random.default_rng([seed, 1000 + number]) for number in range(len(self._faults))]
        self._before: dict[int, SensorReading] = {}
        self._last: SensorReading | None = None

    def published(self, t_s: float, reading: SensorReading) -> SensorReading:
        """What is published at `t_s` of a true reading."""
        for number, (fault, noise) in enumerate(zip(self._faults, self._noise, strict=True)):
            if fault.acts(t_s):
                before = self._before.setdefault(number, self._last or reading)
                reading = disturbed(fault, reading, before, noise)
        self._last = reading
        return reading
