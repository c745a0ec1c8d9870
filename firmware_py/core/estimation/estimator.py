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

from firmware_py.core.elementary import sin, sine_cosine
from firmware_py.core.estimation import kalman
from firmware_py.core.estimation.accelerometer import SensorState, sense
from firmware_py.core.estimation.estimator_state import (
    INITIAL,
    NO_FLIGHT,
    AdaptiveNoise,
    Contact,
    EstimatorConfig,
    EstimatorState,
    Flight,
    Prediction,
    estimate_of,
)
from firmware_py.core.estimation.kalman import Covariance, ProcessNoise, Push, Row, StateEstimate, Transition
from firmware_py.core.estimation.newton import newton, thrown_back
from firmware_py.core.estimation.striker_model import is_of_the_stop, model_acceleration
from firmware_py.core.inputs import AccelerometerInput
from firmware_py.core.measurements import Measurements
from firmware_py.core.numbers import at_least
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import CONTACT, FREE, ContactPhase

LONGEST_GAP_TICKS = 100
"""Most ticks without a reading that the model predicts in one step, one after the other.

The written-out algebra is used for them: this many calls of filterpy would take longer than a tick.
"""

LONGEST_TRAPEZOID_TICKS = 5
"""A longer gap can hide half of a soft impact from the readings before and after it."""

STILL_M_S = 0.05
"""Speed below which the striker may be stuck; 2 σ of the velocity replace it if they are larger."""
LONGEST_SLIDE = 5
"""Factor on the waiting time in that case: with a slow crank, a sliding striker reads almost 0 as well."""

STILL_VARIANCE = 1e-4
"""Variance of the zero-velocity update: (10 mm/s)², because successive readings are correlated."""

LONGEST_FLIGHT_TICKS = 5000
"""A longer flight without an impact begins anew."""

DOUBT_VARIANCE = 1e-4
"""(10 mm)²: after a touch-down the variance of x is far smaller, unless the estimate excluded it."""
DOUBT_SIGMAS = 10.0
"""An estimate further from the stop than this many deviations and 20 mm excludes a touch-down."""

LARGEST = 1e3
"""Largest magnitude of a state, in SI units; an estimate beyond it has diverged and starts anew."""


def strapdown(dt_s: float) -> Transition:
    """F of a tick that integrates the accelerometer; the bias is subtracted from the reading."""
    return Transition(1.0, dt_s, -0.5 * dt_s * dt_s, 0.0, 1.0, -dt_s)


def _strapdown_noise(
    config: EstimatorConfig, sensor: SensorState, phase: ContactPhase, dt_s: float
) -> ProcessNoise:
    """Q of a tick; in contact with the trapezoid's error, estimated from the second difference of z."""
    if phase == FREE:
        return config.strapdown_noise
    bend_m_s2 = sensor.acceleration_m_s2 - 2.0 * sensor.before_m_s2 + sensor.second_m_s2
    error_m_s = config.bend_share * bend_m_s2 * dt_s
    return config.contact_noise._replace(vv=config.contact_noise.vv + error_m_s * error_m_s)


def _by_model(
    config: EstimatorConfig, estimate: StateEstimate, angle_rad: float, omega_rad_s: float, ticks: int
) -> tuple[StateEstimate, float]:
    """Predict the estimate over `ticks` without a reading, up to the crank angle `angle_rad`, by the model.

    Also returns the approach speed of the last impact that the model predicts in a long gap, 0 without one.
    """
    bounded = min(ticks, LONGEST_GAP_TICKS)
    approach_m_s = 0.0
    for tick in range(bounded):
        middle_rad = angle_rad - omega_rad_s * config.tick_s * (bounded - tick - 0.5)
        # The spring's rest position x0 + x_A moves the fixed point of the damped oscillator.
        fixed_m = config.striker.rest_length_m + config.striker.amplitude_m * sin(middle_rad)
        estimate = kalman.predict_written_out(
            estimate,
            config.model,
            Push(x_m=(1.0 - config.model.x_x) * fixed_m, v_m_s=-config.model.v_x * fixed_m),
            config.model_noise,
        )
        unseen = bounded > LONGEST_TRAPEZOID_TICKS  # an impact does not end within a shorter gap
        if unseen and estimate.x_m > config.striker.stop_m and estimate.v_m_s > 0.0:
            approach_m_s = estimate.v_m_s
            estimate = thrown_back(config, estimate)
    return estimate, approach_m_s


def propagate(
    config: EstimatorConfig,
    state: EstimatorState,
    accelerometer: AccelerometerInput,
    phase: ContactPhase,
    angle_rad: float,
    omega_rad_s: float,
    elapsed_ticks: int,
) -> Prediction:
    """Predict the estimate to the time of the newest reading, and compute the innovation; no correction yet.

    `angle_rad` and `omega_rad_s` describe the crank at the same time.
    """
    sensor = sense(config.sensor, state.sensor, accelerometer, elapsed_ticks)
    fresh = sensor.missed_ticks == 0
    carried = False
    mean_m_s2 = 0.0
    spread = config.spread
    if not state.started:
        estimate = StateEstimate(
            x_m=config.striker.rest_length_m + config.striker.amplitude_m * sin(angle_rad),
            v_m_s=0.0,
            bias_m_s2=0.0,
            p=Covariance(spread.initial_xx, 0.0, 0.0, spread.initial_vv, 0.0, spread.initial_bb),
        )
    elif fresh and state.sensor.missed_ticks == 0 and elapsed_ticks <= LONGEST_TRAPEZOID_TICKS:
        dt_s = elapsed_ticks * config.tick_s
        carried = True
        # ∫a dt = (z₀ + z₁) dt/2 + τ (z₁ − z₀)
        mean_m_s2 = (
            0.5 * (sensor.acceleration_m_s2 + state.sensor.acceleration_m_s2)
            + (sensor.acceleration_m_s2 - state.sensor.acceleration_m_s2) * config.sensor.delay_s / dt_s
            - 0.5 * config.sensor.housing_weight * (sensor.housing_m_s2 + state.sensor.housing_m_s2)
        )
        estimate = kalman.predict(
            estimate_of(state),
            config.strapdown if elapsed_ticks == 1 else strapdown(dt_s),
            Push(0.5 * mean_m_s2 * dt_s * dt_s, mean_m_s2 * dt_s),
            _strapdown_noise(config, sensor, phase, dt_s),
        )
    else:
        estimate = estimate_of(state)
        if phase == CONTACT and elapsed_ticks > LONGEST_TRAPEZOID_TICKS:
            # The impact during which the gap began has ended; the separation was not measured.
            since_rad = omega_rad_s * elapsed_ticks * config.tick_s
            estimate = newton(config, estimate.bias_m_s2, state.touch_down, angle_rad - since_rad, 0.0)
        estimate, approach_m_s = _by_model(config, estimate, angle_rad, omega_rad_s, elapsed_ticks)
        if fresh and approach_m_s > 0.0 and is_of_the_stop(config.striker, sensor.acceleration_m_s2):
            # The impact that began in the gap has not ended yet.
            estimate = StateEstimate(config.striker.stop_m, approach_m_s, estimate.bias_m_s2, estimate.p)

    innovation = of_state_m_s2 = 0.0
    model_variance = state.model_variance if state.started else config.noise.start
    variance = model_variance
    own_variance = 0.0
    if fresh:
        of_state_m_s2 = sensor.acceleration_m_s2 - _known(config, state, estimate, angle_rad, omega_rad_s)
        innovation = kalman.innovation(estimate, of_state_m_s2, config.row)
        own_variance = at_least(kalman.innovation_variance(estimate.p, config.row, 0.0), 0.0)
        variance = own_variance + model_variance + _dry_variance(config, estimate)
    return Prediction(
        estimate,
        sensor,
        innovation,
        math.sqrt(variance),
        math.sqrt(own_variance),
        innovation * innovation / variance,
        model_variance,
        state.started or fresh,
        carried,
        mean_m_s2,
        of_state_m_s2,
    )


def _measured(config: EstimatorConfig, estimate: StateEstimate, measurements: Measurements) -> StateEstimate:
    """The estimate, corrected by the measurements that have come in this tick."""
    for index in range(len(measurements)):
        z, age_ticks = measurements[index]
        if age_ticks == 0 and math.isfinite(z):
            x, v, bias, variance = config.measured[index]
            estimate = kalman.update(estimate, z, Row(x, v, bias), variance)
    return estimate


def correct(
    config: EstimatorConfig,
    state: EstimatorState,
    predicted: Prediction,
    contact: Contact,
    measurements: Measurements,
    angle_rad: float,
    omega_rad_s: float,
    elapsed_ticks: int,
) -> EstimatorState:
    """Correct the prediction: by the model in free flight, by the stop at touch-down and separation.

    `measurements` correct it in the tick in which they are received.
    """
    estimate = predicted.estimate
    touch_down = state.touch_down
    striker = config.striker
    by_model = contact.settled and predicted.started and predicted.sensor.missed_ticks == 0
    model_variance = predicted.model_variance
    still_ticks = _still_ticks(config, state.still_ticks, predicted, elapsed_ticks) if by_model else 0
    gated_ticks = _gated_ticks(config, state.gated_ticks, predicted, elapsed_ticks)
    sure = estimate.p.xx < DOUBT_VARIANCE
    if contact.touch_down or (contact.separation and contact.measured and sure):
        # Since the touch-down or separation the striker has moved by about v · age.
        v_m_s, jitter_s = estimate.v_m_s, config.separation_jitter_s
        if contact.touch_down:
            v_m_s, jitter_s = contact.approach_speed_m_s, config.touch_down_jitter_s
        z = striker.stop_m + v_m_s * contact.age_s
        jitter_m = v_m_s * jitter_s
        doubt = _doubt(z - estimate.x_m, estimate.p.xx) if contact.touch_down else 0.0
        variance = config.stop_variance + jitter_m * jitter_m + doubt
        estimate = kalman.update(_doubted(config, estimate, doubt), z, Row(1.0, 0.0, 0.0), variance)
        if contact.touch_down:
            touch_down = StateEstimate(striker.stop_m, v_m_s, estimate.bias_m_s2, estimate.p)
        else:
            # Newton's law in addition to the measured change of speed, for impacts too short to sample.
            before_m_s = contact.approach_speed_m_s
            estimate = kalman.update(
                estimate,
                -striker.restitution * before_m_s,
                Row(0.0, 1.0, 0.0),
                before_m_s * before_m_s * config.restitution_variance,
            )
    elif contact.separation:
        # After a longer gap `propagate` has applied Newton's law already.
        if sure and not contact.measured and elapsed_ticks <= LONGEST_TRAPEZOID_TICKS:
            estimate = newton(config, estimate.bias_m_s2, touch_down, angle_rad, contact.age_s)
    elif by_model and not 0 < gated_ticks <= config.noise.gate_ticks:
        of_state_m_s2 = predicted.of_state_m_s2
        waits = 1 if two_sigma_m_s(estimate) < STILL_M_S else LONGEST_SLIDE
        stuck = still_ticks > waits * config.noise.still_ticks
        if stuck:
            estimate = kalman.update(estimate, 0.0, Row(0.0, 1.0, 0.0), STILL_VARIANCE)
            known = _known(config, state, estimate, angle_rad, omega_rad_s)
            of_state_m_s2 = predicted.sensor.acceleration_m_s2 - known
        hold_m = striker.dry_m_s2 / striker.stiffness_1_s2
        if not stuck or estimate.p.xx > hold_m * hold_m:
            learnt = config.noise.readings_as_one * (model_variance + _dry_variance(config, estimate))
            estimate = kalman.update(estimate, of_state_m_s2, config.row, learnt)
        own = predicted.spread_m_s2 * predicted.spread_m_s2
        model_variance = _learnt(config.noise, model_variance, predicted.innovation_m_s2, own, elapsed_ticks)
    estimate = _measured(config, estimate, measurements)
    flight = NO_FLIGHT
    if config.has_flights and contact.settled:
        flight = _flight(config, state, predicted, elapsed_ticks)
    spread = config.spread
    p = estimate.p
    if not (
        abs(estimate.x_m) < LARGEST
        and abs(estimate.v_m_s) < LARGEST
        and abs(estimate.bias_m_s2) < LARGEST
        and math.isfinite(p.xx + p.vv + p.bb + p.xv + p.xb + p.vb)
    ):
        return INITIAL
    return EstimatorState(
        estimate.x_m,
        estimate.v_m_s,
        estimate.bias_m_s2,
        at_least(p.xx, spread.floor_xx),
        p.xv,
        p.xb,
        at_least(p.vv, spread.floor_vv),
        p.vb,
        at_least(p.bb, spread.floor_bb),
        predicted.innovation_m_s2,
        predicted.innovation_std_m_s2,
        predicted.spread_m_s2,
        predicted.nis if by_model else 0.0,
        model_variance,
        still_ticks,
        gated_ticks,
        predicted.sensor,
        touch_down,
        predicted.started,
        flight,
        state.spring_share,
        state.friction_share,
    )


def _doubt(away_m: float, variance: float) -> float:
    """The variance to be added at a touch-down that the estimate excludes, m²; 0 if it does not exclude it.

    Either the estimate is wrong or another force has acted: both positions are equally likely.
    """
    if away_m * away_m <= 4.0 * DOUBT_VARIANCE + DOUBT_SIGMAS * DOUBT_SIGMAS * variance:
        return 0.0
    return away_m * away_m


def _doubted(config: EstimatorConfig, estimate: StateEstimate, doubt: float) -> StateEstimate:
    """The estimate with the variance `doubt` added to x and, if it is not 0, that of power-up added to v."""
    p = estimate.p
    faster = config.spread.initial_vv if doubt > 0.0 else 0.0
    return estimate._replace(p=p._replace(xx=p.xx + doubt, vv=p.vv + faster))


def _flight(
    config: EstimatorConfig, state: EstimatorState, predicted: Prediction, elapsed_ticks: int
) -> Flight:
    """The flight one tick later; after a gap in the readings a new flight begins."""
    flight = state.flight
    if not (0 <= flight.ticks < LONGEST_FLIGHT_TICKS and predicted.carried):
        return Flight(predicted.estimate.x_m, predicted.estimate.v_m_s, 0)
    dt_s = elapsed_ticks * config.tick_s
    change_m_s = predicted.mean_m_s2 * dt_s
    return Flight(
        flight.x_m + (flight.v_m_s + 0.5 * change_m_s) * dt_s,
        flight.v_m_s + change_m_s,
        flight.ticks + elapsed_ticks,
    )


def _known(
    config: EstimatorConfig,
    state: EstimatorState,
    estimate: StateEstimate,
    angle_rad: float,
    omega_rad_s: float,
) -> float:
    """The part of the model's delayed acceleration that does not depend linearly on the state, m/s².

    a_d = a − τ a' with a' = −(c/m) (x' − x_A') − (b/m) a
    """
    striker = config.striker
    delay_s = config.sensor.delay_s
    sine, cosine = sine_cosine(angle_rad)
    crank_m = striker.amplitude_m * sine
    crank_m_s = striker.amplitude_m * cosine * omega_rad_s
    known = striker.stiffness_1_s2 * (
        (1.0 + delay_s * striker.damping_1_s) * (striker.rest_length_m + crank_m) - delay_s * crank_m_s
    )
    if estimate.v_m_s > 0.0:
        known -= striker.dry_m_s2
    elif estimate.v_m_s < 0.0:
        known += striker.dry_m_s2
    if state.spring_share != 0.0 or state.friction_share != 0.0:
        # The identified corrections are evaluated at the estimate; H stays nominal.
        pull = striker.stiffness_1_s2 * (estimate.x_m - striker.rest_length_m - crank_m)
        friction = -model_acceleration(striker, angle_rad, estimate.x_m, estimate.v_m_s) - pull
        known -= state.spring_share * pull + state.friction_share * friction
    return known


def two_sigma_m_s(estimate: StateEstimate) -> float:
    """Two standard deviations of the velocity."""
    return 2.0 * math.sqrt(at_least(estimate.p.vv, 0.0))


def _dry_variance(config: EstimatorConfig, estimate: StateEstimate) -> float:
    """Variance of the model's acceleration where dry friction may hold or reverse, (m/s²)²; else 0."""
    dry = config.striker.dry_m_s2
    if dry <= 0.0 or abs(estimate.v_m_s) >= 0.02 + two_sigma_m_s(estimate):
        return 0.0
    return dry * dry


def _learnt(
    noise: AdaptiveNoise, variance: float, innovation_m_s2: float, own_variance: float, elapsed_ticks: int
) -> float:
    """σ² += rate (y² − H P Hᵀ − σ²), within its bounds; y² counts up to 9 σ²: more is due to an impact."""
    seen = min(innovation_m_s2 * innovation_m_s2 - own_variance, 9.0 * variance)
    rate = min(elapsed_ticks * noise.learning_rate, 1.0)
    return min(at_least(variance + rate * (seen - variance), noise.floor), noise.ceiling)


def _still_ticks(config: EstimatorConfig, still_ticks: int, predicted: Prediction, elapsed_ticks: int) -> int:
    """Ticks for which a striker on a dry guide has been at rest, with an acceleration near 0."""
    if config.striker.dry_m_s2 <= 0.0:
        return 0
    estimate, sensor = predicted.estimate, predicted.sensor
    pulled = abs(sensor.acceleration_m_s2 - estimate.bias_m_s2 - sensor.housing_m_s2)
    slow_m_s = at_least(two_sigma_m_s(estimate), STILL_M_S)
    still = pulled < config.noise.still_m_s2 and abs(estimate.v_m_s) < slow_m_s
    return min(still_ticks + elapsed_ticks, NEVER_TICKS) if still else 0


def _gated_ticks(config: EstimatorConfig, gated_ticks: int, predicted: Prediction, elapsed_ticks: int) -> int:
    """Ticks for which the innovation has been beyond the gate.

    An unmodelled force acts on the striker, so the accelerometer alone moves the estimate. If the innovation
    stays beyond the gate for too long, the estimate is lost, and the model corrects it again.
    """
    if abs(predicted.innovation_m_s2) <= config.noise.gate_sigmas * predicted.innovation_std_m_s2:
        return 0
    if elapsed_ticks > 1:  # skipped ticks may hide an impact: the estimate is lost, unless the impact lasts
        return 1 if is_of_the_stop(config.striker, predicted.sensor.acceleration_m_s2) else NEVER_TICKS
    return min(gated_ticks + 1, NEVER_TICKS)
