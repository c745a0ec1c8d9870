"""What the gait sensors of a walk say, made ahead of the run: nothing that the module does changes it."""

import numpy as np
from numpy.typing import NDArray

from plant_sim.gait_sensors import GaitSensors, gait_of
from plant_sim.parts.parts import Parts
from plant_sim.parts.walking import Leg, Walking, cycles_at, leg_at, row_at
from plant_sim.plant import GAIT_PERIOD_S
from plant_sim.scene import Scene
from tools.campaign.kernels import kernel
from tools.campaign.loop import GaitFrames
from tools.campaign.quantise import signal_counts

FloatArray = NDArray[np.float64]


@kernel
def legs(walking: Walking, times_s: FloatArray, out: FloatArray) -> None:
    """The leg at each of the times, a row of `out` each."""
    for place in range(times_s.size):
        leg = leg_at(walking, times_s[place])
        row = out[place]
        row[0], row[1] = leg.lean_rad, leg.lean_rad_s
        row[2], row[3], row[4] = leg.up_m_s2, leg.forward_m_s2, leg.outward_m_s2
        row[5], row[6], row[7] = leg.up_m_s3, leg.forward_m_s3, leg.outward_m_s3


def gait_frames(scene: Scene, parts: Parts, seed: int, duration_s: float, tick_s: float) -> GaitFrames:
    """The frames of the bench's sensors with this seed, rounded as on the bus."""
    walking, ticks = parts.housing, round(GAIT_PERIOD_S / tick_s)
    if not isinstance(walking, Walking):
        return GaitFrames(np.zeros((0, 4)), ticks)
    assert scene.sensors is not None
    times_s: FloatArray = np.arange(0, round(duration_s / tick_s), ticks).astype(np.float64) * tick_s
    motion = np.empty((len(times_s), len(Leg._fields)))
    legs(walking, times_s, motion)
    sensors = GaitSensors(scene.sensors.gait.model(), walking, seed, GAIT_PERIOD_S)
    rows = np.full((len(times_s), 4), np.nan)
    for row, t_s, leg in zip(rows, times_s.tolist(), motion.tolist(), strict=True):
        reading = sensors.read_of(t_s, gait_of(walking, Leg(*leg), t_s))
        if reading is not None:
            row[:] = reading
    for column, signal in enumerate(("shank_rate_rad_s", "along_m_s2")):
        counts = signal_counts("GaitSensors", signal)
        rows[:, column] = counts.scale * np.clip(
            np.rint(rows[:, column] / counts.scale), counts.low, counts.high
        )
    return GaitFrames(rows, ticks)


@kernel
def _cycles(walking: Walking, times_s: FloatArray, out: FloatArray) -> None:
    for place in range(times_s.size):
        row = walking.rows[row_at(walking.rows, times_s[place])]
        out[place] = cycles_at(row, times_s[place])


def phases_at(walking: Walking, times_s: FloatArray) -> FloatArray:
    """Where in the cycle a leg that walks is."""
    cycles = np.empty(len(times_s))
    _cycles(walking, np.ascontiguousarray(times_s, dtype=np.float64), cycles)
    return cycles % 1.0
