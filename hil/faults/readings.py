"""Sensor faults: the published reading as a function of the true one."""

import math
from collections.abc import Sequence

import numpy as np

from hil.scenario import fault_tables as tables
from plant_sim.sensors.readings import SensorReading

TURN_RAD = 2.0 * math.pi
FIELDS = {
    "striker": ("striker_low_m_s2", "striker_high_m_s2"),
    "striker-low": ("striker_low_m_s2",),
    "striker-high": ("striker_high_m_s2",),
    "housing": ("housing_m_s2",),
    "encoder": ("encoder_position_rev", "encoder_velocity_rev_s"),
}
POSITION = "encoder_position_rev"


def shifted(reading: SensorReading, sensor: str, by: float) -> SensorReading:
    """The reading with `by` added: m/s² to accelerations, rad to the encoder's angle."""
    if sensor == "encoder":
        return reading._replace(encoder_position_rev=(reading.encoder_position_rev + by / TURN_RAD) % 1.0)
    return reading._replace(**{name: getattr(reading, name) + by for name in FIELDS[sensor]})


def lagging(reading: SensorReading, given: SensorReading, sensor: str, share: float) -> SensorReading:
    """The previous output moved towards the new reading by `share`; the angle takes the shorter way."""

    def moved(name: str) -> float:
        before, by = getattr(given, name), getattr(reading, name) - getattr(given, name)
        if name == POSITION:
            return float((before + share * ((by + 0.5) % 1.0 - 0.5)) % 1.0)
        return float(before + share * by)

    return reading._replace(**{name: moved(name) for name in FIELDS[sensor]})


def disturbed(  # noqa: PLR0911 - one case a fault
    fault: tables.ReadingFault,
    reading: SensorReading,
    before: SensorReading,
    given: SensorReading,
    elapsed_s: float,
    noise: np.random.Generator,
) -> SensorReading:
    """The reading under one fault.

    `before` is the last reading before the fault began; `given` is this fault's last output, `elapsed_s` ago.
    """
    match fault:
        case tables.EncoderSlip(slip_rev=slip_rev):
            return shifted(reading, "encoder", slip_rev * TURN_RAD)
        case tables.SensorStuck(sensor=sensor):
            return reading._replace(**{name: getattr(before, name) for name in FIELDS[sensor]})
        case tables.SensorNoisy(sensor=sensor, std=std):
            return shifted(reading, sensor, std * float(noise.standard_normal()))
        case tables.SensorBiased(sensor=sensor, bias=bias):
            return shifted(reading, sensor, bias)
        case tables.SensorClipped(sensor=sensor, limit_m_s2=limit_m_s2):
            return reading._replace(
                **{
                    name: min(max(getattr(reading, name), -limit_m_s2), limit_m_s2)
                    for name in FIELDS[sensor]
                    if not name.startswith("encoder")
                }
            )
        case tables.SensorSlow(sensor=sensor, lag_s=lag_s):
            return lagging(reading, given, sensor, -math.expm1(-elapsed_s / lag_s))
        case tables.SensorWrongSign(sensor=sensor):
            turned = reading._replace(**{name: -getattr(reading, name) for name in FIELDS[sensor]})
            return turned._replace(encoder_position_rev=turned.encoder_position_rev % 1.0)
        case tables.SensorIntermittent(sensor=sensor, share=share):
            if noise.random() >= share:
                return reading
            return reading._replace(**dict.fromkeys(FIELDS[sensor], 0.0))


class SensorFaults:
    """All sensor faults of a scenario; call `published` once per reading."""

    def __init__(self, faults: Sequence[tables.Fault], seed: int) -> None:
        self._faults = [fault for fault in faults if isinstance(fault, tables.ReadingFault)]
        self._noise = [np.random.default_rng([seed, 1000 + number]) for number in range(len(self._faults))]
        self._before: dict[int, SensorReading] = {}
        self._given: dict[int, SensorReading] = {}
        self._last: SensorReading | None = None
        self._last_s = 0.0

    def published(self, t_s: float, reading: SensorReading) -> SensorReading:
        """The published reading at `t_s`, from the true reading."""
        for number, (fault, noise) in enumerate(zip(self._faults, self._noise, strict=True)):
            if fault.acts(t_s):
                before = self._before.setdefault(number, self._last or reading)
                given = self._given.get(number, before)
                reading = disturbed(fault, reading, before, given, t_s - self._last_s, noise)
                self._given[number] = reading
        self._last, self._last_s = reading, t_s
        return reading
