"""The estimator's configuration, its state, and its intermediate results within a tick."""

from typing import NamedTuple

from firmware_py.core.estimation.accelerometer import NominalSensors, SensorState
from firmware_py.core.estimation.kalman import Covariance, ProcessNoise, Row, StateEstimate, Transition
from firmware_py.core.estimation.striker_model import NominalStriker
from firmware_py.core.measurements import AllMeasured
from firmware_py.core.records import zeroed
from firmware_py.interface.arrivals import NEVER_TICKS

INITIAL_POSITION_STD_M = 0.03
"""The striker may rest anywhere in its travel."""
INITIAL_VELOCITY_STD_M_S = 0.3
"""The striker may still swing at power-up."""
INITIAL_BIAS_STD_M_S2 = 0.3
"""The largest bias, 50 mg, is taken as 1.6 sigma."""
POSITION_FLOOR_M = 5e-05
"""The position of the stop itself is not known better."""
VELOCITY_FLOOR_M_S = 0.0005
"""One count of the high range, integrated over a tick."""
BIAS_FLOOR_M_S2 = 0.001
"""Floor that lets the estimate follow a drifting bias."""
BIAS_NOISE_M_S2 = 0.0001
"""Per tick: allows a drift of 0.2 g per hour and more."""
CONTACT_NOISE_M_S = 0.001
"""Per tick in contact: counts of 49 mg, aliasing."""
BEND_SHARE = 0.05
"""The trapezoid's error, as a share of the second difference of the readings."""
GAP_NOISE_M_S = 0.003
"""Per tick without a reading: an impact may be missed."""
SEPARATION_JITTER_S = 0.001
"""Larger than at touch-down: a contact ends more softly than it starts."""
STILL_M_S2 = 0.25
"""Largest reading of a striker that a dry guide holds: noise, and a bias not yet known."""


class Spread(NamedTuple):
    """Variances at power-up, and floors that no update may go below."""

    initial_xx: float
    initial_vv: float
    initial_bb: float
    floor_xx: float
    floor_vv: float
    floor_bb: float


class AdaptiveNoise(NamedTuple):
    """Variance σ² of a single innovation by the model: floor, initial value and ceiling of the learnt value.

    `readings_as_one` is N; `learning_rate` is per tick.
    """

    floor: float
    start: float
    ceiling: float
    learning_rate: float
    readings_as_one: float
    still_m_s2: float
    still_ticks: int
    gate_sigmas: float
    gate_ticks: int


class EstimatorConfig(NamedTuple):
    """F and Q per tick, the variance of the model, and the variances of the stop and of Newton's law."""

    tick_s: float
    striker: NominalStriker
    sensor: NominalSensors
    spread: Spread
    row: Row
    model: Transition
    strapdown: Transition
    strapdown_noise: ProcessNoise
    model_noise: ProcessNoise
    contact_noise: ProcessNoise
    bend_share: float
    noise: AdaptiveNoise
    stop_variance: float
    measured: AllMeasured
    touch_down_jitter_s: float
    separation_jitter_s: float
    restitution_variance: float
    has_flights: bool


class Flight(NamedTuple):
    """The striker's motion in free flight, integrated from the readings alone since the flight began.

    It begins with the estimate at that time. `ticks` counts from then on; −1: no free flight.
    """

    x_m: float
    v_m_s: float
    ticks: int


class EstimatorState(NamedTuple):
    """Mean, upper triangle of P, the last innovation, and the estimate kept from touch-down.

    `innovation_std_m_s2` is the standard deviation of the innovation, `spread_m_s2` the part of it due to P.
    `nis` is the normalised innovation squared of a correction by the model, 0 without a correction.
    `model_variance` is the learnt σ² of the model's acceleration. `still_ticks` is the time for which the
    striker has been at rest, `gated_ticks` the time for which the innovation has been gated. `spring_share`
    and `friction_share` are the relative corrections of the model's spring and friction (`identify`).
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
    flight: Flight
    spring_share: float
    friction_share: float


class Prediction(NamedTuple):
    """The estimate predicted to the time of the newest reading, and its innovation, before any correction.

    The innovation's fields are those of `EstimatorState`. `carried`: the readings at both ends of the tick
    moved the estimate, with the mean acceleration `mean_m_s2`. `of_state_m_s2`: the reading minus the part of
    the model that does not depend on the state.
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
    mean_m_s2: float
    of_state_m_s2: float


class Contact(NamedTuple):
    """The detector's result in this tick. `settled`: the model may correct the estimate again."""

    touch_down: bool
    separation: bool
    age_s: float
    approach_speed_m_s: float
    measured: bool
    settled: bool


NO_FLIGHT = Flight(0.0, 0.0, -1)

INITIAL = zeroed(EstimatorState, sensor=zeroed(SensorState, missed_ticks=NEVER_TICKS), flight=NO_FLIGHT)


def estimate_of(state: EstimatorState) -> StateEstimate:
    """The mean and covariance that `state` holds."""
    p = Covariance(state.p_xx, state.p_xv, state.p_xb, state.p_vv, state.p_vb, state.p_bb)
    return StateEstimate(state.x_m, state.v_m_s, state.bias_m_s2, p)
