"""What a frame leaves of a value: counts of a scale within the codec's limits, or a float32."""

from typing import NamedTuple

import numpy as np

from firmware_py.interface import codec
from plant_sim.sensor_models import AccelerometerModel
from tools.campaign.kernels import subroutine

BUTTERWORTH_NOISE = 1.1107207345395915
"""π/(2√2): a Butterworth of second order passes the noise of so many corner frequencies."""


class Counts(NamedTuple):
    """A signal's scale and its limits in counts."""

    scale: float
    low: float
    high: float


class Range(NamedTuple):
    """One accelerometer behind its low-pass, in its own counts, and what its signal in the frame holds."""

    count_m_s2: float
    bias: float
    noise: float
    most: float
    frame: Counts


def signal_counts(record: str, signal: str) -> Counts:
    """Scale and limits of a signal of the bus."""
    its_codec = next(one for kind, one in codec.CODECS.items() if kind.__name__ == record)
    described = its_codec.signals[signal]
    return Counts(float(described.scale), float(described.low_counts), float(described.high_counts))


def accelerometer(model: AccelerometerModel, signal: str) -> Range:
    """An accelerometer and its place in the frame."""
    count = model.count_m_s2
    return Range(
        count_m_s2=count,
        bias=model.bias_m_s2 / count,
        noise=model.noise_m_s2_rthz * float(np.sqrt(BUTTERWORTH_NOISE * model.bandwidth_hz)) / count,
        most=float(np.ceil(model.range_m_s2 / count) - 1.0),
        frame=signal_counts("Accelerometer", signal),
    )


@subroutine
def framed(counts: Counts, value: float) -> float:
    """The value that arrives: rounded to a count, saturated in counts."""
    count = float(np.rint(value / counts.scale))
    return min(max(count, counts.low), counts.high) * counts.scale


@subroutine
def reading(sensor: Range, filtered_m_s2: float, noise: float) -> float:
    """One reading as it arrives: noise and bias, then clipped and quantised, then framed."""
    count = np.rint(filtered_m_s2 / sensor.count_m_s2 + sensor.bias + sensor.noise * noise)
    return framed(sensor.frame, min(max(count, -sensor.most), sensor.most) * sensor.count_m_s2)


@subroutine
def single(value: float) -> float:
    """What a float32 of CANSimple keeps."""
    kept: float = np.float64(np.float32(value))
    return kept
