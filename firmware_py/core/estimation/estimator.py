"""The striker's state: a Kalman filter over position, velocity and accelerometer bias.

    m x'' + c (x − l0 − A sin θ) + b x' + μ m g sign x' = F_stop

Prediction: the measured acceleration z is integrated (strapdown), so that the forces of the stop and of the
wearer need not be known. Correction, in free flight: the same reading is compared with the acceleration due
to spring, crank and friction. Both steps use one reading, so an unmodelled force enters z and x'' alike: the
case of correlated noise (Simon, Optimal State Estimation, 7.1) in the limit of a noiseless sensor. The error
of the model changes over a period, not from tick to tick. Its variance σ² is learnt from the innovations
(covariance matching, Mehra 1970) and normalises them; because the error lasts for N readings, the correction
counts N readings as one: R = N σ².

If dry friction holds the striker, the model only gives |x − l0 − x_A| ≤ μ m g/c. The correction then stops
once the deviation of x is smaller than this bound, and v = 0 is used as a measurement (zero-velocity update).

In contact the model does not give the stop's force, so the state is only predicted, and the stop itself is
the measurement: x = x_stop at touch-down and at separation. If a reading is missing or clipped in a contact,
Newton's law x'⁺ = −k x'⁻ maps the mean across the impact, and its saltation matrix (Kong, Payne, Council &
Johnson, The Salted Kalman Filter, Automatica 131:109752) the covariance, to which the uncertainty of k is
added.

The acceleration of a moving housing is subtracted from the striker's reading before the integration,
x'' = z − a_b; the correction needs no subtraction, as the accelerometer reads the spring and friction forces
alone. The housing's own offset is its mean: since power-up at first, then over `housing_rate`.

A low-pass with the group delay τ delays the readings: its input is a = z + τ z', and ∫a over a tick is the
trapezoid of z plus τ times its change.
"""

import math
from typing import NamedTuple

from firmware_py.core.elementary import sin
from firmware_py.core.estimation import accelerometer as sensing
from firmware_py.core.estimation import kalman
from firmware_py.core.estimation.accelerometer import SensorState, sense
from firmware_py.core.estimation.crank import CrankState
from firmware_py.core.estimation.estimator_state import (
    INITIAL,
    Contact,
    EstimatorState,
    Prediction,
    estimate_of,
)
from firmware_py.core.estimation.kalman import Covariance, ProcessNoise, Push, Row, StateEstimate
from firmware_py.core.estimation.newton import (
    apply_newton,
    restitution_variance,
    separation_variance,
    stop_variance,
)
from firmware_py.core.estimation.striker_model import Nominal, known_part
from firmware_py.core.inputs import AccelerometerInput
from firmware_py.core.measurements import Measurements, model_sensors
from firmware_py.core.numbers import at_least, in_ticks
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import ContactPhase
from firmware_py.interface.generated.parameters import Estimator, Parameters
from firmware_py.interface.zeroed import zeroed

POSITION_FLOOR_M = 5e-05
"""The position of the stop itself is not known better."""
VELOCITY_FLOOR_M_S = 0.0005
"""One count of the high range, integrated over a tick."""
BIAS_FLOOR_M_S2 = 0.001
"""Floor that lets the estimate follow a drifting bias."""
NOISE_S = 0.001
"""Time in which noise has its deviation; its variance is proportional to the time, whatever the period."""
BIAS_NOISE_M_S2 = 0.0001
"""It allows a drift of 0.2 g per hour and more."""
CONTACT_NOISE_M_S = 0.001
"""Noise of the velocity in contact: counts of 49 mg, aliasing."""
GAP_NOISE_M_S = 0.003
"""Noise of the velocity without a reading: an impact may be missed."""
BEND_SHARE = 0.05
"""The trapezoid's error, as a share of the second difference of the readings."""
STILL_M_S2 = 0.25
"""Largest reading of a striker that a dry guide holds: noise, and a bias not yet known."""
STILL_M_S = 0.05
"""Speed below which the striker may be stuck; 2 σ of the velocity replace it if they are larger."""
LONGEST_SLIDE = 5
"""Factor on the waiting time in that case: with a slow crank, a sliding striker reads almost 0 as well."""

STILL_VARIANCE = 1e-4
"""Variance of the zero-velocity update: (10 mm/s)², because successive readings are correlated."""

DOUBT_VARIANCE = 1e-4
"""(10 mm)²: after a touch-down the variance of x is far smaller, unless the estimate excluded it."""
DOUBT_SIGMAS = 10.0
"""An estimate further from the stop than this many deviations and 20 mm excludes a touch-down."""

INITIAL_COVARIANCE = zeroed(Covariance, xx=0.03 * 0.03, vv=0.3 * 0.3, bb=0.3 * 0.3)
"""The striker may rest anywhere in its travel, in m, and still swing at power-up, in m/s; the largest bias,
50 mg, is taken as 1.6 sigma.
"""
LARGEST = 1e3
"""Largest magnitude of a state, in SI units; an estimate beyond it has diverged and starts anew."""


class Constants(NamedTuple):
    """`learning_rate`: share of a difference that a reading adds to σ². `readings_as_one`: N.

    `…_noise`: Q of a tick in flight, in contact and without a reading.
    """

    tick_s: float
    estimator: Estimator
    sensing: sensing.Constants
    learning_rate: float
    readings_as_one: float
    flight_noise: ProcessNoise
    contact_noise: ProcessNoise
    gap_noise: ProcessNoise
    still_ticks: int
    gated_ticks: int


def noise_of(velocity_m_s: float, tick_s: float) -> ProcessNoise:
    """Q of a tick with this noise of the velocity in `NOISE_S`."""
    share = tick_s / NOISE_S
    return ProcessNoise(
        0.0, share * (velocity_m_s * velocity_m_s), share * (BIAS_NOISE_M_S2 * BIAS_NOISE_M_S2)
    )


def derive(p: Parameters) -> Constants:
    """The constants of these parameters."""
    tick_s = p.control.tick_s
    return Constants(
        tick_s=tick_s,
        estimator=p.estimator,
        sensing=sensing.derive(p),
        learning_rate=min(tick_s / p.estimator.model_learning_s, 1.0),
        readings_as_one=max(p.estimator.model_memory_s / tick_s, 1.0),
        flight_noise=noise_of(p.estimator.velocity_noise_m_s, tick_s),
        contact_noise=noise_of(CONTACT_NOISE_M_S, tick_s),
        gap_noise=noise_of(GAP_NOISE_M_S, tick_s),
        still_ticks=in_ticks(p.estimator.still_s, tick_s),
        gated_ticks=in_ticks(p.estimator.gate_s, tick_s),
    )


def strapdown_noise(own: Constants, sensor: SensorState, phase: ContactPhase, dt_s: float) -> ProcessNoise:
    """Q of a tick; in contact with the trapezoid's error, estimated from the second difference of z."""
    if phase == ContactPhase.FREE:
        return own.flight_noise
    bend_m_s2 = sensor.acceleration_m_s2 - 2.0 * sensor.before_m_s2 + sensor.second_m_s2
    error_m_s = BEND_SHARE * bend_m_s2 * dt_s
    return own.contact_noise._replace(vv=own.contact_noise.vv + error_m_s * error_m_s)


def predict_by_model(
    own: Constants, nominal: Nominal, estimate: StateEstimate, angle_rad: float, omega_rad_s: float
) -> StateEstimate:
    """Predict the estimate over a tick without a reading, up to the crank angle `angle_rad`, by the model."""
    middle_rad = angle_rad - 0.5 * omega_rad_s * own.tick_s
    # The spring's rest position x0 + x_A moves the fixed point of the damped oscillator.
    fixed_m = nominal.striker.rest_length_m + nominal.drive.amplitude_m * sin(middle_rad)
    flight = nominal.flight
    push = Push(x_m=(1.0 - flight.x_x) * fixed_m, v_m_s=-flight.v_x * fixed_m)
    return kalman.predict(estimate, flight, push, own.gap_noise)


def integrate_reading(
    own: Constants, nominal: Nominal, state: EstimatorState, sensor: SensorState, phase: ContactPhase
) -> StateEstimate:
    """Predict the estimate over a tick with a reading at both ends."""
    dt_s, before = own.tick_s, state.sensor
    # ∫a dt = (z₀ + z₁) dt/2 + τ (z₁ − z₀)
    mean_m_s2 = (
        0.5 * (sensor.acceleration_m_s2 + before.acceleration_m_s2)
        + (sensor.acceleration_m_s2 - before.acceleration_m_s2) * nominal.sensor_delay_s / dt_s
        - 0.5 * own.sensing.housing_weight * (sensor.housing_m_s2 + before.housing_m_s2)
    )
    return kalman.predict(
        estimate_of(state),
        nominal.strapdown,
        Push(0.5 * mean_m_s2 * dt_s * dt_s, mean_m_s2 * dt_s),
        strapdown_noise(own, sensor, phase, dt_s),
    )


def propagate(
    own: Constants,
    nominal: Nominal,
    state: EstimatorState,
    accelerometer: AccelerometerInput,
    phase: ContactPhase,
    crank: CrankState,
) -> Prediction:
    """Predict the estimate to the time of the newest reading, and compute the innovation; no correction yet.

    `crank` describes the crank at the same time.
    """
    angle_rad, omega_rad_s = crank.angle_rad, crank.omega_rad_s
    sensor = sense(own.sensing, state.sensor, accelerometer)
    fresh = sensor.missed_ticks == 0
    carried = state.started and fresh and state.sensor.missed_ticks == 0
    if carried:
        estimate = integrate_reading(own, nominal, state, sensor, phase)
    elif state.started:
        estimate = predict_by_model(own, nominal, estimate_of(state), angle_rad, omega_rad_s)
    else:
        estimate = StateEstimate(
            x_m=nominal.striker.rest_length_m + nominal.drive.amplitude_m * sin(angle_rad),
            v_m_s=0.0,
            bias_m_s2=0.0,
            p=INITIAL_COVARIANCE,
        )

    innovation = linear_part_m_s2 = 0.0
    start_m_s2 = own.estimator.initial_model_std_m_s2
    model_variance = state.model_variance if state.started else start_m_s2 * start_m_s2
    variance = model_variance
    own_variance = 0.0
    if fresh:
        linear_part_m_s2 = sensor.acceleration_m_s2 - known_part(nominal, estimate, angle_rad, omega_rad_s)
        innovation = kalman.innovation(estimate, linear_part_m_s2, nominal.row)
        own_variance = at_least(kalman.innovation_variance(estimate.p, nominal.row, 0.0), 0.0)
        variance = own_variance + model_variance + dry_variance(nominal, estimate)
    return Prediction(
        estimate=estimate,
        sensor=sensor,
        innovation_m_s2=innovation,
        innovation_std_m_s2=math.sqrt(variance),
        spread_m_s2=math.sqrt(own_variance),
        nis=innovation * innovation / variance,
        model_variance=model_variance,
        started=state.started or fresh,
        carried=carried,
        linear_part_m_s2=linear_part_m_s2,
    )


def correct_by_sensors(own: Constants, estimate: StateEstimate, measurements: Measurements) -> StateEstimate:
    """The estimate, corrected by the measurements that have come in this tick."""
    models = model_sensors(own.estimator)
    for index in range(len(measurements)):
        z, age_ticks = measurements[index]
        if age_ticks == 0 and math.isfinite(z):
            x, v, bias, variance = models[index]
            estimate = kalman.update(estimate, z, Row(x, v, bias), variance)
    return estimate


def correct_at_stop(
    own: Constants,
    nominal: Nominal,
    estimate: StateEstimate,
    contact: Contact,
    velocity_m_s: float,
    moved_variance: float,
) -> StateEstimate:
    """x = x_stop: the estimate after a touch-down or separation, since which the striker moved v · age.

    `moved_variance`: of this motion, m².
    """
    z = nominal.stop.position_m + velocity_m_s * contact.age_s
    doubt = doubt_variance(z - estimate.x_m, estimate.p.xx) if contact.touch_down else 0.0
    variance = stop_variance(own.estimator) + moved_variance + doubt
    return kalman.update(add_doubt(estimate, doubt), z, Row(1.0, 0.0, 0.0), variance)


def correct_by_law(
    own: Constants, nominal: Nominal, estimate: StateEstimate, before_m_s: float
) -> StateEstimate:
    """Newton's law in addition to the measured change of speed, for impacts too short to sample."""
    return kalman.update(
        estimate,
        -nominal.stop.restitution * before_m_s,
        Row(0.0, 1.0, 0.0),
        before_m_s * before_m_s * restitution_variance(own.estimator),
    )


def correct_by_model(
    own: Constants, nominal: Nominal, predicted: Prediction, still_ticks: int, crank: CrankState
) -> StateEstimate:
    """The estimate in free flight after the reading; `still_ticks`: see `EstimatorState`."""
    estimate, linear_part_m_s2 = predicted.estimate, predicted.linear_part_m_s2
    waits = 1 if two_sigma_m_s(estimate) < STILL_M_S else LONGEST_SLIDE
    stuck = still_ticks > waits * own.still_ticks
    if stuck:
        estimate = kalman.update(estimate, 0.0, Row(0.0, 1.0, 0.0), STILL_VARIANCE)
        known = known_part(nominal, estimate, crank.angle_rad, crank.omega_rad_s)
        linear_part_m_s2 = predicted.sensor.acceleration_m_s2 - known
    hold_m = nominal.dry_m_s2 / nominal.stiffness_1_s2
    if not stuck or estimate.p.xx > hold_m * hold_m:
        variance = predicted.model_variance + dry_variance(nominal, estimate)
        estimate = kalman.update(estimate, linear_part_m_s2, nominal.row, own.readings_as_one * variance)
    return estimate


def is_finite(estimate: StateEstimate) -> bool:
    """Whether the estimate has not diverged."""
    p = estimate.p
    return (
        abs(estimate.x_m) < LARGEST
        and abs(estimate.v_m_s) < LARGEST
        and abs(estimate.bias_m_s2) < LARGEST
        and math.isfinite(p.xx + p.vv + p.bb + p.xv + p.xb + p.vb)
    )


def correct_by_contact(
    own: Constants,
    nominal: Nominal,
    state: EstimatorState,
    predicted: Prediction,
    contact: Contact,
    crank: CrankState,
) -> tuple[StateEstimate, StateEstimate]:
    """`(estimate, touch_down)`: the estimate corrected at touch-down and separation, and that at touch-down.

    A separation while the position is in doubt corrects nothing.
    """
    estimate, approach_m_s = predicted.estimate, contact.approach_speed_m_s
    if contact.touch_down:
        jitter_m = approach_m_s * own.estimator.touch_down_jitter_s
        estimate = correct_at_stop(own, nominal, estimate, contact, approach_m_s, jitter_m * jitter_m)
        position_m = nominal.stop.position_m
        return estimate, StateEstimate(position_m, approach_m_s, estimate.bias_m_s2, estimate.p)
    if contact.separation and estimate.p.xx < DOUBT_VARIANCE:
        if contact.measured:
            variance = separation_variance(nominal, estimate.v_m_s)
            estimate = correct_at_stop(own, nominal, estimate, contact, estimate.v_m_s, variance)
            estimate = correct_by_law(own, nominal, estimate, approach_m_s)
        else:
            before = state.touch_down
            estimate = apply_newton(
                nominal, own.estimator, estimate.bias_m_s2, before, crank.angle_rad, contact.age_s
            )
    return estimate, state.touch_down


def correct(
    own: Constants,
    nominal: Nominal,
    state: EstimatorState,
    predicted: Prediction,
    contact: Contact,
    measurements: Measurements,
    crank: CrankState,
) -> EstimatorState:
    """Correct the prediction: by the model in free flight, by the stop at touch-down and separation.

    `measurements` correct it in the tick in which they are received.
    """
    estimate, touch_down = correct_by_contact(own, nominal, state, predicted, contact, crank)
    by_model = contact.settled and predicted.started and predicted.sensor.missed_ticks == 0
    model_variance = predicted.model_variance
    still_ticks = count_still_ticks(nominal, state.still_ticks, predicted) if by_model else 0
    gated_ticks = count_gated_ticks(own, state.gated_ticks, predicted)
    if by_model and not 0 < gated_ticks <= own.gated_ticks:
        estimate = correct_by_model(own, nominal, predicted, still_ticks, crank)
        own_variance = predicted.spread_m_s2 * predicted.spread_m_s2
        model_variance = learn_variance(own, model_variance, predicted.innovation_m_s2, own_variance)
    estimate = correct_by_sensors(own, estimate, measurements)
    if not is_finite(estimate):
        return INITIAL._replace(sensor=predicted.sensor)
    p, nis = estimate.p, predicted.nis if by_model else 0.0
    return EstimatorState(
        x_m=estimate.x_m,
        v_m_s=estimate.v_m_s,
        bias_m_s2=estimate.bias_m_s2,
        p_xx=at_least(p.xx, POSITION_FLOOR_M * POSITION_FLOOR_M),
        p_xv=p.xv,
        p_xb=p.xb,
        p_vv=at_least(p.vv, VELOCITY_FLOOR_M_S * VELOCITY_FLOOR_M_S),
        p_vb=p.vb,
        p_bb=at_least(p.bb, BIAS_FLOOR_M_S2 * BIAS_FLOOR_M_S2),
        innovation_m_s2=predicted.innovation_m_s2,
        innovation_std_m_s2=predicted.innovation_std_m_s2,
        spread_m_s2=predicted.spread_m_s2,
        nis=nis,
        model_variance=model_variance,
        still_ticks=still_ticks,
        gated_ticks=gated_ticks,
        sensor=predicted.sensor,
        touch_down=touch_down,
        started=predicted.started,
    )


def doubt_variance(away_m: float, variance: float) -> float:
    """The variance to be added at a touch-down that the estimate excludes, m²; 0 if it does not exclude it.

    Either the estimate is wrong or another force has acted: both positions are equally likely.
    """
    if away_m * away_m <= 4.0 * DOUBT_VARIANCE + DOUBT_SIGMAS * DOUBT_SIGMAS * variance:
        return 0.0
    return away_m * away_m


def add_doubt(estimate: StateEstimate, doubt: float) -> StateEstimate:
    """The estimate with the variance `doubt` added to x and, if it is not 0, that of power-up added to v."""
    p = estimate.p
    faster = INITIAL_COVARIANCE.vv if doubt > 0.0 else 0.0
    return estimate._replace(p=p._replace(xx=p.xx + doubt, vv=p.vv + faster))


def two_sigma_m_s(estimate: StateEstimate) -> float:
    """Two standard deviations of the velocity."""
    return 2.0 * math.sqrt(at_least(estimate.p.vv, 0.0))


def dry_variance(nominal: Nominal, estimate: StateEstimate) -> float:
    """Variance of the model's acceleration where dry friction may hold or reverse, (m/s²)²; else 0."""
    dry = nominal.dry_m_s2
    if dry <= 0.0 or abs(estimate.v_m_s) >= 0.02 + two_sigma_m_s(estimate):
        return 0.0
    return dry * dry


def learn_variance(own: Constants, variance: float, innovation_m_s2: float, own_variance: float) -> float:
    """σ² += rate (y² − H P Hᵀ − σ²), within its bounds; y² counts up to 9 σ²: more is due to an impact."""
    seen = min(innovation_m_s2 * innovation_m_s2 - own_variance, 9.0 * variance)
    floor_m_s2 = own.estimator.model_std_m_s2
    ceiling_m_s2 = own.estimator.largest_model_std_m_s2
    learnt = at_least(variance + own.learning_rate * (seen - variance), floor_m_s2 * floor_m_s2)
    return min(learnt, ceiling_m_s2 * ceiling_m_s2)


def count_still_ticks(nominal: Nominal, still_ticks: int, predicted: Prediction) -> int:
    """Ticks for which a striker on a dry guide has been at rest, with an acceleration near 0."""
    if nominal.dry_m_s2 <= 0.0:
        return 0
    estimate, sensor = predicted.estimate, predicted.sensor
    pulled = abs(sensor.acceleration_m_s2 - estimate.bias_m_s2 - sensor.housing_m_s2)
    slow_m_s = at_least(two_sigma_m_s(estimate), STILL_M_S)
    still = pulled < STILL_M_S2 and abs(estimate.v_m_s) < slow_m_s
    return min(still_ticks + 1, NEVER_TICKS) if still else 0


def count_gated_ticks(own: Constants, gated_ticks: int, predicted: Prediction) -> int:
    """Ticks for which the innovation has been beyond the gate.

    An unmodelled force acts on the striker, so the accelerometer alone moves the estimate. If the innovation
    stays beyond the gate for too long, the estimate is lost, and the model corrects it again. A lost reading
    neither ends nor begins this time.
    """
    if predicted.sensor.missed_ticks > 0:
        return min(gated_ticks + 1, NEVER_TICKS) if gated_ticks > 0 else 0
    if abs(predicted.innovation_m_s2) <= own.estimator.gate_sigmas * predicted.innovation_std_m_s2:
        return 0
    return min(gated_ticks + 1, NEVER_TICKS)
