"""The firmware's estimator on a log, compiled: crank tracker, estimator and detector of a tick.

The replay has no torque: the tracker estimates the motor's effect as a disturbance, which changes its angle
by less than a count of the encoder. The kernel calls only the firmware's core.
"""

import numpy as np

from firmware_py.builds.numba_subset import register
from firmware_py.core.config import Config
from firmware_py.core.estimation import crank, detector, estimator, estimator_state, newton
from firmware_py.core.inputs import AccelerometerInput, EncoderInput
from firmware_py.core.measurements import NOTHING_MEASURED
from hil.nodes.compiled import kernel
from plant_sim.arrays import FloatArray
from tools.tuning.recordings.readings import Ticks

register()


(
    X,
    INNOVATION,
    INNOVATION_STD,
    FLYING,
    AT_STOP,
    STOP_INNOVATION,
    STOP_VARIANCE,
    COLUMNS,
) = range(8)
"""Columns of a replay, one row per tick. FLYING: the model has corrected the state; AT_STOP: a touch-down,
with its innovation and variance in the next columns."""


@kernel
def _replay(config: Config, ticks: FloatArray, out: FloatArray) -> None:
    crank_now, estimate, touched = crank.INITIAL, estimator_state.INITIAL, detector.INITIAL
    for k in range(ticks.shape[0]):
        low, high, housing = ticks[k, 0], ticks[k, 1], ticks[k, 2]
        position, velocity = ticks[k, 3], ticks[k, 4]
        felt = AccelerometerInput(low, high, housing, 0 if np.isfinite(low) else 1)
        turned = crank.read(
            config.crank, EncoderInput(position, velocity, 0 if np.isfinite(position) else 1, 1)
        )
        crank_now = crank.step(config.crank, crank_now, turned, 0.0)
        before = estimate
        predicted = estimator.propagate(
            config.estimator, config.nominal, estimate, felt, touched.phase, crank_now
        )
        touched, contact = detector.step(config.detector, config.nominal, touched, predicted)
        estimate = estimator.correct(
            config.estimator, config.nominal, before, predicted, contact, NOTHING_MEASURED, crank_now
        )
        row = out[k]
        row[X] = estimate.x_m
        row[INNOVATION], row[INNOVATION_STD] = predicted.innovation_m_s2, predicted.innovation_std_m_s2
        row[FLYING] = 1.0 if estimate.nis > 0.0 else 0.0
        row[AT_STOP] = 1.0 if contact.touch_down else 0.0
        at_stop_m = config.p.stop.position_m + contact.approach_speed_m_s * contact.age_s
        row[STOP_INNOVATION] = at_stop_m - predicted.estimate.x_m
        jitter_m = contact.approach_speed_m_s * config.p.estimator.touch_down_jitter_s
        row[STOP_VARIANCE] = (
            predicted.estimate.p.xx + newton.stop_variance(config.p.estimator) + jitter_m * jitter_m
        )


def replay(config: Config, ticks: Ticks) -> FloatArray:
    """The estimator's history over a log with these parameters, shape (ticks, COLUMNS)."""
    table = np.ascontiguousarray(np.column_stack(ticks[1:]))
    out = np.zeros((len(table), COLUMNS))
    _replay(config, table, out)
    return out
