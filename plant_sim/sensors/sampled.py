"""Sensors that are sampled on the period of a CAN frame of their own: record, reading and table of each.

A sensor has the name of its frame and reads the frame's signals in the order of their bits. The caller that
samples it knows the frame, its period and its counter; no other code names a sensor.
"""

from typing import NamedTuple, TypeAlias

from pydantic import Field

from plant_sim.arrays import FloatArray
from plant_sim.kernels import by_part
from plant_sim.solvers.adaptive.state_layout import OBSERVED
from plant_sim.tables.quantities import Length
from plant_sim.tables.table import Table


class CoarsePosition(NamedTuple):
    """The striker's position by a slow absolute sensor."""

    noise_m: float


SampledSensor: TypeAlias = CoarsePosition
SAMPLED: tuple[type[SampledSensor], ...] = (CoarsePosition,)
"""Each sensor has its own noise. A new one is appended, so that the noise of the others stays."""


@by_part
def signals(sensor: SampledSensor, observed: FloatArray, noise: FloatArray) -> tuple[float, ...]:
    """A sample: the frame's signals from the present observation (places as in `state_layout.OBSERVED`).

    `noise`: a standard normal for each signal.
    """
    raise NotImplementedError


@signals.register(CoarsePosition)
def _coarse_position_signals(
    sensor: CoarsePosition, observed: FloatArray, noise: FloatArray
) -> tuple[float, ...]:
    return (observed[OBSERVED.x_m] + sensor.noise_m * noise[0],)


class CoarseTable(Table):
    """[sensors.coarse]: an absolute position of the striker, on the period of its frame."""

    # A Hall or a string sensor's.
    noise_m: Length = Field(default=2e-3, ge=0.0, description="the position's noise in m rms")

    def sensor(self) -> CoarsePosition:
        """The sensor's record."""
        return CoarsePosition(self.noise_m)


class SampledTables(Table):
    """The tables of the fitted sensors."""

    coarse: CoarseTable | None = Field(
        default=None, description="the table [sensors.coarse], if one is fitted"
    )

    def sampled(self) -> tuple[SampledSensor, ...]:
        """The fitted sensors."""
        tables = (getattr(self, name) for name in SampledTables.model_fields)
        return tuple(table.sensor() for table in tables if table is not None)
