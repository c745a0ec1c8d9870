"""The estimator's state, and its intermediate results within a tick."""

from typing import NamedTuple

from firmware_py.core.estimation.accelerometer import SensorState
from firmware_py.core.estimation.kalman import Covariance, StateEstimate
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.zeroed import zeroed


class EstimatorState(NamedTuple):
    """Mean, upper triangle of P, the last innovation, and the estimate kept from touch-down.

    `innovation_std_m_s2` is the standard deviation of the innovation, `spread_m_s2` the part of it due to P.
    `nis` is the normalised innovation squared of a correction by the model, 0 without a correction.
    `model_variance` is the learnt σ² of the model's acceleration. `still_ticks` is the time for which the
    striker has been at rest, `gated_ticks` the time for which the innovation has been gated.
    """

    x_m: float
    v_m_s: float
    bias_m_s2: float
    p_xx: float
    p_xv: float
    p_xb: float
    p_vv: float
    p_vb: float
    p_bb: float
    innovation_m_s2: float
    innovation_std_m_s2: float
    spread_m_s2: float
    nis: float
    model_variance: float
    still_ticks: int
    gated_ticks: int
    sensor: SensorState
    touch_down: StateEstimate
    started: bool


class StrikerMotion(NamedTuple):
    """What the other blocks know of the striker, whatever estimates it.

    `variance_m2`: the position's. `silent_ticks`: time without a usable reading; `started`: there was one.
    """

    x_m: float
    v_m_s: float
    variance_m2: float
    silent_ticks: int
    started: bool


class Prediction(NamedTuple):
    """The estimate predicted to the time of the newest reading, and its innovation, before any correction.

    The innovation's fields are those of `EstimatorState`. `carried`: the readings at both ends of the tick
    moved the estimate. `linear_part_m_s2`: the reading minus the part of the model that does not depend
    linearly on the state.
    """

    estimate: StateEstimate
    sensor: SensorState
    innovation_m_s2: float
    innovation_std_m_s2: float
    spread_m_s2: float
    nis: float
    model_variance: float
    started: bool
    carried: bool
    linear_part_m_s2: float


class Contact(NamedTuple):
    """The detector's result in this tick. `settled`: the model may correct the estimate again."""

    touch_down: bool
    separation: bool
    age_s: float
    approach_speed_m_s: float
    measured: bool
    settled: bool


INITIAL = zeroed(EstimatorState, sensor=zeroed(SensorState, missed_ticks=NEVER_TICKS))


def striker_of(state: EstimatorState) -> StrikerMotion:
    """The estimated striker."""
    return StrikerMotion(state.x_m, state.v_m_s, state.p_xx, state.sensor.missed_ticks, state.started)


def estimate_of(state: EstimatorState) -> StateEstimate:
    """The mean and covariance that `state` holds."""
    p = Covariance(state.p_xx, state.p_xv, state.p_xb, state.p_vv, state.p_vb, state.p_bb)
    return StateEstimate(state.x_m, state.v_m_s, state.bias_m_s2, p)
