"""Additional sensors that correct the estimate: the row of H and the noise of each.

Each sensor measures z = H (x, v, bias) + noise and sends a frame of its own. To add one, add it to
`Measurements` and to the two functions below, its frame to `vibro.dbc`, and the deviation of its noise to the
parameters.
The accelerometer is no such sensor, because its reading also depends on the crank: see `accelerometer`.
"""

from typing import NamedTuple

from firmware_py.interface.arrivals import age
from firmware_py.interface.generated.parameters import Estimator
from firmware_py.interface.generated.received import INITIAL, Received


class Measurement(NamedTuple):
    """A sensor's newest value, in the sensor's unit, and its age; never received if it is not fitted."""

    value: float
    age_ticks: int


class Measurements(NamedTuple):
    """The newest reading of each sensor."""

    coarse_position_m: Measurement


class SensorModel(NamedTuple):
    """A sensor's row of H and the variance of its noise."""

    x: float
    v: float
    bias: float
    variance: float


def measurements_of(received: Received, tick: int) -> Measurements:
    """The newest readings, with their ages at tick number `tick`."""
    coarse = received.coarse_position
    return Measurements(
        Measurement(coarse.striker_position_m, age(tick, received.coarse_position_arrival)),
    )


NOTHING_MEASURED = measurements_of(INITIAL, 0)
"""The readings before the first frame is received."""


def model_sensors(estimator: Estimator) -> tuple[SensorModel, ...]:
    """The model of each sensor, in the order of `Measurements`."""
    coarse_m = estimator.coarse_std_m
    return (SensorModel(1.0, 0.0, 0.0, coarse_m * coarse_m),)
