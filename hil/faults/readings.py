"""Sensor faults: the published reading as a function of the true one."""

from collections.abc import Sequence

import numpy as np

from hil.faults.counted import counted
from hil.faults.fault import Fault
from hil.faults.on_sensor import Past, ReadingFault
from plant_sim.sensors.readings import SensorReading


class SensorFaults:
    """All sensor faults of a scenario; call `published` once per reading."""

    def __init__(self, faults: Sequence[Fault], seed: int) -> None:
        self._counts = counted(faults)
        self._faults = [fault for fault in faults if isinstance(fault, ReadingFault)]
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
                true = reading
                reading = fault.disturbed(reading, Past(before, given, t_s - self._last_s), noise)
                if reading != true:
                    self._counts.acted(fault)
                self._given[number] = reading
        self._last, self._last_s = reading, t_s
        return reading
