"""The frames of sensors with sampling periods of their own, interpreted and compiled.

A sensor's record in `plant_sim.sensors.sampled` has the name of its frame in `vibro.dbc`, which defines the
frame's period and the packing of its signals.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from firmware_py.interface.codec import CODECS
from firmware_py.interface.frame import WordFrame
from firmware_py.interface.generated import records
from hil.drive.reports import ticks_of
from plant_sim.kernels import by_part
from plant_sim.plant import Plant
from plant_sim.sensors.sampled import SAMPLED, SampledSensor, signals

Vector = NDArray[np.float64]

CODEC_OF = {kind: CODECS[getattr(records, kind.__name__)] for kind in SAMPLED}
MOST_SIGNALS = max(len(its_codec.record._fields) for its_codec in CODEC_OF.values())
TICK, WHICH, COUNTER, NOISE = range(4)
"""Columns of `SampledFrames.rows`; from NOISE on, a standard normal number for each signal."""


@by_part
def frame_of(sensor: SampledSensor, observed: Vector, noise: Vector, counter: int) -> WordFrame:
    """The frame of a sample."""
    raise NotImplementedError


def packed(kind: type[SampledSensor]) -> Callable[[SampledSensor, Vector, Vector, int], WordFrame]:
    """`frame_of` for sensors of one kind."""
    pack: Callable[[Any, int], tuple[WordFrame, bool]] = CODEC_OF[kind].pack

    def frame(sensor: SampledSensor, observed: Vector, noise: Vector, counter: int) -> WordFrame:
        return pack(signals(sensor, observed, noise), counter)[0]

    return frame


for _kind in SAMPLED:
    frame_of.register(_kind)(packed(_kind))


def sampled_frame(
    sensors: tuple[SampledSensor, ...], which: int, observed: Vector, noise: Vector, counter: int
) -> WordFrame:
    """The frame of a sample of sensor number `which`."""
    return frame_of(sensors[which], observed, noise, counter)


@overload(sampled_frame, strict=False, jit_options={"error_model": "numpy"})
def _sampled_frame_of_types(sensors: Any, which: Any, observed: Any, noise: Any, counter: Any) -> Any:
    """Compiled version: numba cannot index a tuple of records of several types by a variable."""
    if len(sensors) == 1:
        return lambda sensors, which, observed, noise, counter: frame_of(sensors[0], observed, noise, counter)

    def of_several(sensors: Any, which: int, observed: Vector, noise: Vector, counter: int) -> WordFrame:
        if which == 0:
            return frame_of(sensors[0], observed, noise, counter)
        return sampled_frame(sensors[1:], which - 1, observed, noise, counter)

    return of_several


class SampledFrames:
    """The sampling schedule of a plant's sensors, and the frames of their samples."""

    def __init__(self, plant: Plant, period_s: float) -> None:
        self._plant = plant
        self._codecs = [CODEC_OF[type(sensor)] for sensor in plant.sampled]
        self._ticks = [ticks_of(its_codec, period_s) for its_codec in self._codecs]
        self._last = [-1] * len(self._codecs)
        fitted = {type(sensor): sensor for sensor in plant.sampled}
        self.all_sensors = tuple(fitted.get(kind) or kind(*[0.0] * len(kind._fields)) for kind in SAMPLED)
        """A sensor of every kind for `sampled_frame`, so that all scenes have one kernel; rows name only the
        fitted ones."""

    def rows(self, tick: int, ticks: int) -> Vector:
        """The samples in `ticks` from `tick` on for `sampled_frame`, one row each."""
        rows = []
        for number in range(tick, tick + ticks) if self._codecs else ():
            for which, its_codec in enumerate(self._codecs):
                counter = number // self._ticks[which]
                if counter != self._last[which]:
                    self._last[which] = counter
                    signals = len(its_codec.record._fields)
                    noise = self._plant.sample_noise(which, signals)
                    kind = SAMPLED.index(type(self._plant.sampled[which]))
                    rows.append([number, kind, counter, *noise, *[0.0] * (MOST_SIGNALS - signals)])
        return np.array(rows, dtype=np.float64).reshape(-1, NOISE + MOST_SIGNALS)
