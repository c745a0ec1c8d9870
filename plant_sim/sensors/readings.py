"""Readings: the outputs of the low-pass filters with noise and bias, clipped and quantised.

The readers are pure and run interpreted and compiled; the noise is passed in.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from plant_sim.arrays import FloatArray
from plant_sim.kernels import subroutine
from plant_sim.sensors.sensing import HIGH, HOUSING, LOW, SPEED_ESTIMATE
from plant_sim.solvers.double_double import TURN_RAD
from plant_sim.tables.sensor_tables import AccelerometerTable, SensorsTable

Numbers: TypeAlias = Sequence[float] | FloatArray

NOISE_AT_ONCE = 256
"""Number of samples whose noise is generated together; the sequence is the same as sample by sample."""


class SensorReading(NamedTuple):
    """One sample of all sensors. A level housing at rest reads its bias and noise."""

    striker_low_m_s2: float
    striker_high_m_s2: float
    housing_m_s2: float
    encoder_position_rev: float
    encoder_velocity_rev_s: float


class AccelerometerReader(NamedTuple):
    """An accelerometer after its low-pass filter, in counts. `most`: the largest count of either sign."""

    count_m_s2: float
    bias: float
    noise: float
    most: int


class Readers(NamedTuple):
    """All sensors after their low-pass filters. The encoder has `encoder_counts` per turn."""

    striker_low: AccelerometerReader
    striker_high: AccelerometerReader
    housing: AccelerometerReader
    encoder_counts: int
    encoder_noise_rad_s: float


@subroutine
def accelerometer_reader(table: AccelerometerTable) -> AccelerometerReader:
    """The reader of an accelerometer with these parameters."""
    # A Butterworth of second order passes the noise of π/(2√2) f_c.
    bandwidth_hz = math.pi / (2.0 * math.sqrt(2.0)) * table.bandwidth_hz
    return AccelerometerReader(
        count_m_s2=table.count_m_s2,
        bias=table.bias_m_s2 / table.count_m_s2,
        noise=table.noise_m_s2_rthz * math.sqrt(bandwidth_hz) / table.count_m_s2,
        # The positive full scale of two's complement is one count short of the range.
        most=math.ceil(table.range_m_s2 / table.count_m_s2) - 1,
    )


@subroutine
def readers(sensors: SensorsTable) -> Readers:
    """The readers of a scene's sensors."""
    return Readers(
        striker_low=accelerometer_reader(sensors.striker_low),
        striker_high=accelerometer_reader(sensors.striker_high),
        housing=accelerometer_reader(sensors.housing),
        encoder_counts=sensors.encoder.counts,
        encoder_noise_rad_s=sensors.encoder.noise_rad_s,
    )


@subroutine
def read_accelerometer(reader: AccelerometerReader, filtered_m_s2: float, noise: float) -> float:
    """One reading, m/s², from the filtered truth and a standard normal; it saturates in counts."""
    count = round(filtered_m_s2 / reader.count_m_s2 + reader.bias + reader.noise * noise)
    return min(max(count, -reader.most), reader.most) * reader.count_m_s2


@subroutine
def read_position_rev(readers: Readers, crank_rad: float) -> float:
    """The encoder's position, circular in [0, 1) revolutions."""
    counts = readers.encoder_counts
    return math.floor(crank_rad / TURN_RAD * counts) % counts / counts


@subroutine
def read_velocity_rev_s(readers: Readers, filtered_rad_s: float, noise: float) -> float:
    """The encoder's speed estimate, rev/s, from the filtered truth and a standard normal."""
    return (filtered_rad_s + readers.encoder_noise_rad_s * noise) / TURN_RAD


@subroutine
def read_sensors(readers: Readers, filtered: Numbers, crank_rad: float, noise: Numbers) -> SensorReading:
    """Read every sensor once: `filtered` as `Sensing.readings`, `noise` four standard normals."""
    return SensorReading(
        read_accelerometer(readers.striker_low, filtered[LOW], noise[0]),
        read_accelerometer(readers.striker_high, filtered[HIGH], noise[1]),
        read_accelerometer(readers.housing, filtered[HOUSING], noise[2]),
        read_position_rev(readers, crank_rad),
        read_velocity_rev_s(readers, filtered[SPEED_ESTIMATE], noise[3]),
    )


class Noise:
    """An endless sequence of four standard normals per sample."""

    def __init__(self, noise: np.random.Generator) -> None:
        self._noise = noise
        self._waiting: list[list[float]] = []

    def next(self) -> list[float]:
        """The standard normals of one sample."""
        if not self._waiting:
            self._waiting = self._noise.standard_normal((NOISE_AT_ONCE, 4)).tolist()[::-1]
        return self._waiting.pop()

    def take(self, samples: int) -> FloatArray:
        """The standard normals of the next samples, shape (samples, 4)."""
        first = [self._waiting.pop() for _ in range(min(samples, len(self._waiting)))]
        rest = self._noise.standard_normal((samples - len(first), 4))
        return np.concatenate([np.array(first).reshape(-1, 4), rest])
