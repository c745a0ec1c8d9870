"""Sensor faults: the published reading as a function of the true one."""

from collections.abc import Sequence

import numpy as np

from hil.faults.fault import Fault
from hil.faults.on_sensor import ReadingFault
from plant_sim.sensors.readings import SensorReading


class SensorFaults:
    """All sensor faults of a scenario; call `published` once per reading."""

    def __init__(self, faults: Sequence[Fault], seed: int) -> None:
        self._faults = [fault for fault in faults if isinstance(fault, ReadingFault)]
        for number, fault in enumerate(self._faults):
            fault.begin(np.random.default_rng([seed, 1000 + number]))
        self._last: SensorReading | None = None
        self._last_s = 0.0

    def published(self, t_s: float, reading: SensorReading) -> SensorReading:
        """The published reading at `t_s`, from the true reading."""
        for fault in self._faults:
            if fault.acts(t_s):
                reading = fault.published(reading, self._last or reading, t_s - self._last_s)
        self._last, self._last_s = reading, t_s
        return reading
