"""Sensors of the striker that the estimator corrects itself by: what each measures, and how well.

Such a sensor measures z = H (x, v, bias) + noise, in a frame of its own. Another one is named here, three
times, and has its frame in `vibro.dbc` and the standard deviation of its noise among the parameters.
"""

from typing import NamedTuple

from firmware_py.core.parameter_values import Parameters
from firmware_py.interface.arrivals import Arrival, age
from firmware_py.interface.generated.received import INITIAL, Received


class Measurement(NamedTuple):
    """What a sensor reads, in its own unit, and how long ago; never received where it is not fitted."""

    value: float
    age_ticks: int


class Measurements(NamedTuple):
    """The newest reading of each sensor."""

    coarse_position_m: Measurement


class Measured(NamedTuple):
    """A row of H and the variance of the noise."""

    x: float
    v: float
    bias: float
    variance: float


class AllMeasured(NamedTuple):
    """The same of each sensor."""

    coarse_position_m: Measured


def measurement(value: float, arrival: Arrival, tick: int) -> Measurement:
    """One reading, as of tick number `tick`."""
    return Measurement(value, age(tick, arrival))


def measurements(received: Received, tick: int) -> Measurements:
    """The newest readings, as of tick number `tick`."""
    coarse = received.coarse_position
    return Measurements(
        measurement(coarse.striker_position_m, received.coarse_position_arrival, tick),
    )


NOTHING_MEASURED = measurements(INITIAL, 0)
"""Before any of their frames has come."""


def measured(parameters: Parameters) -> AllMeasured:
    """What the sensors measure."""
    coarse_m = parameters.estimator_coarse_std_m
    return AllMeasured(
        Measured(1.0, 0.0, 0.0, coarse_m * coarse_m),
    )
