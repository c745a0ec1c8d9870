"""The estimator's configuration, its state, and what it hands on within a tick."""

from typing import NamedTuple

from firmware_py.core.estimation.accelerometer import NominalSensors, SensorState
from firmware_py.core.estimation.kalman import Covariance, ProcessNoise, Row, StateEstimate, Transition
from firmware_py.core.estimation.striker_model import NominalStriker
from firmware_py.core.measurements import AllMeasured
from firmware_py.core.records import zeroed
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import ContactPhase

INITIAL_POSITION_STD_M = 0.03
"""A striker left anywhere in its travel."""
INITIAL_VELOCITY_STD_M_S = 0.3
"""May still swing at power-up."""
INITIAL_BIAS_STD_M_S2 = 0.3
"""50 mg at most, taken as 1.6 sigma."""
POSITION_FLOOR_M = 5e-05
"""The stop itself is not known better."""
VELOCITY_FLOOR_M_S = 0.0005
"""One count of the high range over a tick."""
BIAS_FLOOR_M_S2 = 0.001
"""Keeps the bias alive as it drifts."""
BIAS_NOISE_M_S2 = 0.0001
"""By tick: 0.2 g of drift an hour and more."""
CONTACT_NOISE_M_S = 0.001
"""By tick in contact: counts of 49 mg, aliasing."""
BEND_SHARE = 0.05
"""Of a reading's second difference: the trapezoid's error."""
GAP_NOISE_M_S = 0.003
"""By tick without a reading: an impact may be missed."""
SEPARATION_JITTER_S = 0.001
"""A contact ends more softly than it starts."""
STILL_M_S2 = 0.25
"""A dry guide holds: noise, bias not yet known."""


class Spread(NamedTuple):
    """Variances at power-up, and floors that no update may go below."""

    initial_xx: float
    initial_vv: float
    initial_bb: float
    floor_xx: float
    floor_vv: float
    floor_bb: float


class AdaptiveNoise(NamedTuple):
    """Variances of a single innovation by the model: floor, start and ceiling of what is learnt.

    `readings_as_one` is N; `learning_rate` is by tick.
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
    """F and Q by tick, the variance of the model, and how well the stop and Newton's law are known."""

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
    """What the readings alone make of the striker since it last flew free, from the estimate of then on.

    `ticks` is how long ago that was; −1: it does not fly.
    """

    x_m: float
    v_m_s: float
    ticks: int


class EstimatorState(NamedTuple):
    """Mean, upper triangle of P, the last innovation, and the estimate kept from touch-down.

    `innovation_std_m_s2` is what the innovation may be, `spread_m_s2` the estimate's own part of it. `nis` is
    the normalised innovation squared of a correction by the model, 0 without one. `model_variance` is the σ²
    of the model's acceleration as learnt, `still_ticks` for how long nothing has pulled at the striker,
    `gated_ticks` for how long the innovation has been none that the model can have. `spring_share` and
    `friction_share` are by how much the model's exceed their nominal values (`identify`).
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
    """The estimate carried to the newest reading and compared with the model there; nothing is corrected.

    The numbers of the innovation are those of `EstimatorState`. `carried`: readings at both ends of the tick
    carried it, with `mean_m_s2` between them. `of_state_m_s2`: the reading less
    what does not depend on the state.
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
    """What the detector found in this tick. `settled`: the model may correct the estimate again."""

    phase: ContactPhase
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
    return StateEstimate(
        x_m=state.x_m,
        v_m_s=state.v_m_s,
        bias_m_s2=state.bias_m_s2,
        p=Covariance(
            xx=state.p_xx, xv=state.p_xv, xb=state.p_xb, vv=state.p_vv, vb=state.p_vb, bb=state.p_bb
        ),
    )
