"""The firmware's estimator on a log, compiled: crank tracker, estimator and detector of a tick.

The replay has no torque: the tracker estimates the motor's effect as a disturbance, which changes its angle
by less than a count of the encoder. The kernel calls only the firmware's core.
"""

import numpy as np

from firmware_py.builds.numba_subset import register
from firmware_py.core.estimation import crank, detector, estimator, estimator_state
from firmware_py.core.inputs import AccelerometerInput, EncoderInput
from firmware_py.core.measurements import NOTHING_MEASURED
from firmware_py.core.state import Config
from hil.nodes.compiled import kernel
from plant_sim.arrays import FloatArray
from tools.tuning.recordings.readings import Ticks

register()


(
    X,
    V,
    BIAS,
    P_XX,
    P_XV,
    P_XB,
    P_VV,
    P_VB,
    P_BB,
    INNOVATION,
    INNOVATION_STD,
    FLYING,
    AT_STOP,
    STOP_INNOVATION,
    STOP_VARIANCE,
    MEAN_M_S2,
    Q_VV,
    COLUMNS,
) = range(18)
"""Columns of a replay, one row per tick. FLYING: the model has corrected the state; AT_STOP: a touch-down,
with its innovation and variance in the next columns. MEAN_M_S2 and Q_VV, for the smoother: the acceleration
that propagated the state to this tick (NaN where the model did), and the process noise that was added to the
variance of v."""


@kernel
def _replay(config: Config, ticks: FloatArray, out: FloatArray) -> None:
    crank_now, estimate, touched = crank.INITIAL, estimator_state.INITIAL, detector.INITIAL
    for k in range(ticks.shape[0]):
        low, high, housing = ticks[k, 0], ticks[k, 1], ticks[k, 2]
        position, velocity = ticks[k, 3], ticks[k, 4]
        felt = AccelerometerInput(low, high, housing, 0 if np.isfinite(low) else 1)
        turned = EncoderInput(position, velocity, 0 if np.isfinite(position) else 1)
        crank_now = crank.step(config.crank, crank_now, turned, 1, 0.0)
        angle, omega = crank_now.angle_rad, crank_now.omega_rad_s
        before = estimate
        predicted = estimator.propagate(config.estimator, estimate, felt, touched.phase, angle, omega, 1)
        touched, contact = detector.step(config.detector, touched, predicted, 1)
        estimate = estimator.correct(
            config.estimator, before, predicted, contact, NOTHING_MEASURED, angle, omega, 1
        )
        row = out[k]
        row[X], row[V], row[BIAS] = estimate.x_m, estimate.v_m_s, estimate.bias_m_s2
        row[P_XX], row[P_XV], row[P_XB] = estimate.p_xx, estimate.p_xv, estimate.p_xb
        row[P_VV], row[P_VB], row[P_BB] = estimate.p_vv, estimate.p_vb, estimate.p_bb
        row[INNOVATION], row[INNOVATION_STD] = predicted.innovation_m_s2, predicted.innovation_std_m_s2
        row[FLYING] = 1.0 if estimate.nis > 0.0 else 0.0
        row[AT_STOP] = 1.0 if contact.touch_down else 0.0
        row[STOP_INNOVATION] = (
            config.estimator.striker.stop_m
            + contact.approach_speed_m_s * contact.age_s
            - predicted.estimate.x_m
        )
        jitter_m = contact.approach_speed_m_s * config.estimator.touch_down_jitter_s
        row[STOP_VARIANCE] = predicted.estimate.p.xx + config.estimator.stop_variance + jitter_m * jitter_m
        row[MEAN_M_S2] = np.nan
        if before.started and before.sensor.missed_ticks == 0 and predicted.sensor.missed_ticks == 0:
            # The strapdown's own step: v ← v + (mean − b) T
            T = config.tick_s
            row[MEAN_M_S2] = (predicted.estimate.v_m_s - before.v_m_s) / T + before.bias_m_s2
            row[Q_VV] = predicted.estimate.p.vv - (before.p_vv - 2.0 * T * before.p_vb + T * T * before.p_bb)


def replay(config: Config, ticks: Ticks) -> FloatArray:
    """The estimator's history over a log with these parameters, shape (ticks, COLUMNS)."""
    table = np.ascontiguousarray(np.column_stack(ticks[1:]))
    out = np.zeros((len(table), COLUMNS))
    _replay(config, table, out)
    return out
