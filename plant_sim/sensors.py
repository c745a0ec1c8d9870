"""Readings: what the low-passes hold, then noise and bias, then clipped, then quantised."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from plant_sim.sensing import Sensing
from plant_sim.sensor_models import AccelerometerModel, SensorModels

TURN_RAD = 2.0 * math.pi
DRAWN_AT_ONCE = 256
"""Samples whose noise is drawn together; the stream is that of single draws."""


class SensorReading(NamedTuple):
    """One sample of everything. A housing that is level and at rest reads its bias and noise."""

    striker_low_m_s2: float
    striker_high_m_s2: float
    housing_m_s2: float
    encoder_position_rev: float
    encoder_velocity_rev_s: float


class Accelerometer:
    """The part of an accelerometer behind its low-pass."""

    def __init__(self, model: AccelerometerModel) -> None:
        # A Butterworth of second order passes the noise of π/(2√2) f_c.
        bandwidth_hz = math.pi / (2.0 * math.sqrt(2.0)) * model.bandwidth_hz
        self._count_m_s2 = model.count_m_s2
        self._bias = model.bias_m_s2 / model.count_m_s2
        self._noise = model.noise_m_s2_rthz * math.sqrt(bandwidth_hz) / model.count_m_s2
        # The positive full scale of two's complement is one count short of the range.
        self._most = math.ceil(model.range_m_s2 / model.count_m_s2) - 1

    def read(self, filtered_m_s2: float, noise: float) -> float:
        """One reading, m/s², of the low-passed truth and a standard normal; it saturates in counts."""
        count = round(filtered_m_s2 / self._count_m_s2 + self._bias + self._noise * noise)
        return min(max(count, -self._most), self._most) * self._count_m_s2


class Sensors:
    """All sensors of a module, read together."""

    def __init__(self, models: SensorModels, sensing: Sensing, noise: np.random.Generator) -> None:
        self._low = Accelerometer(models.striker_low)
        self._high = Accelerometer(models.striker_high)
        self._housing = Accelerometer(models.housing)
        self._encoder = models.encoder
        self._readings = sensing.readings
        self._noise = _four_by_four(noise)

    def read(self, crank_rad: float) -> SensorReading:
        """Read every sensor once, with new noise. The encoder is circular, [0, 1) revolutions."""
        low, high, speed_rad_s, housing = self._readings.tolist()
        low_noise, high_noise, housing_noise, speed_noise = next(self._noise)
        counts = self._encoder.counts
        return SensorReading(
            self._low.read(low, low_noise),
            self._high.read(high, high_noise),
            self._housing.read(housing, housing_noise),
            math.floor(crank_rad / TURN_RAD * counts) % counts / counts,
            (speed_rad_s + self._encoder.noise_rad_s * speed_noise) / TURN_RAD,
        )


def _four_by_four(noise: np.random.Generator) -> Iterator[list[float]]:
    """Four standard normals a sample, for ever."""
    while True:
        yield from noise.standard_normal((DRAWN_AT_ONCE, 4)).tolist()
