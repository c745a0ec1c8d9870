"""The reference: filterpy's Rauch–Tung–Striebel smoother on the firmware's estimate.

The smoother also uses the later readings, so it is the best reference for a log without truth. It has no
input; so the motion that the readings alone cause is subtracted from the states first, and added again to the
result.
"""

from typing import NamedTuple

import filterpy.kalman
import numpy as np

from firmware_py.core.state import Config
from plant_sim.arrays import FloatArray
from tools.tuning.recordings import replay

SMALLEST = 1e-16
"""Added to the diagonals of P and Q, so that the predicted P can be inverted."""


class Smoothed(NamedTuple):
    """Position and velocity, shape (n,)."""

    x_m: FloatArray
    v_m_s: FloatArray


def smoothed(config: Config, course: FloatArray) -> Smoothed:
    """Smooth the table of `replay.replay`, or consecutive rows of it."""
    T = config.tick_s
    n = len(course)
    mean = course[:, replay.MEAN_M_S2].copy()
    own = np.gradient(course[:, replay.V], T) + course[:, replay.BIAS]
    mean = np.where(np.isfinite(mean), mean, own)
    carried_v = np.concatenate([[0.0], np.cumsum(mean[1:] * T)])
    steps = carried_v[:-1] * T + 0.5 * mean[1:] * T * T
    carried = np.zeros((n, 3))
    carried[:, 0], carried[:, 1] = np.concatenate([[0.0], np.cumsum(steps)]), carried_v
    states = course[:, [replay.X, replay.V, replay.BIAS]] - carried
    places = [
        [replay.P_XX, replay.P_XV, replay.P_XB],
        [replay.P_XV, replay.P_VV, replay.P_VB],
        [replay.P_XB, replay.P_VB, replay.P_BB],
    ]
    covariances = course[:, places] + SMALLEST * np.eye(3)
    transition = np.array([[1.0, T, -0.5 * T * T], [0.0, 1.0, -T], [0.0, 0.0, 1.0]])
    noise = np.zeros((n, 3, 3))
    # Q of the step to the next tick.
    noise[:-1, 1, 1] = np.maximum(course[1:, replay.Q_VV], 0.0)
    noise[:, 2, 2] = config.estimator.strapdown_noise.bb
    noise += SMALLEST * np.eye(3)
    found = filterpy.kalman.rts_smoother(states, covariances, [transition] * n, noise)[0] + carried
    return Smoothed(found[:, 0], found[:, 1])
