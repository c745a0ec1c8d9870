"""A sensor that lags."""

import math
from typing import Literal

from pydantic import Field

from hil.faults.on_sensor import Past, SensorFault
from plant_sim.sensors.readings import SensorReading
from plant_sim.tables.quantities import Duration

POSITION = "encoder_position_rev"


class SensorSlow(SensorFault):
    """Readings that lag, as behind a filter of first order."""

    kind: Literal["sensor-slow"]
    lag_s: Duration = Field(gt=0.0, le=1.0, description="the filter's time constant, in s")

    def disturbed(self, reading: SensorReading, past: Past) -> SensorReading:
        """The previous output moved towards the new reading; the encoder's angle takes the shorter way."""
        share = -math.expm1(-past.elapsed_s / self.lag_s)

        def moved(name: str) -> float:
            last, by = getattr(past.given, name), getattr(reading, name) - getattr(past.given, name)
            if name == POSITION:
                return float((last + share * ((by + 0.5) % 1.0 - 0.5)) % 1.0)
            return float(last + share * by)

        return reading._replace(**{name: moved(name) for name in self.fields})
