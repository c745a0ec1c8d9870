"""One tick of the firmware: crank, estimate, impacts, regime, limits, mode, target speed, torque.

    step(config, state, inputs) -> (state, outputs)

Sensors are sampled at t_k, the step runs before t_{k+1}, and its torque acts from t_{k+1} for one tick. After
an overrun `sense` runs once for each waiting sample, at the time of that sample; then `act` runs once, on the
newest sample.
"""

import math
from typing import NamedTuple

from firmware_py.core.control import gait, gait_lock, hold, speed, spin_down, start, stride_harmonic
from firmware_py.core.elementary import sin
from firmware_py.core.estimation import crank, detector, estimator, estimator_state, identify, regime
from firmware_py.core.estimation.estimator_state import Contact
from firmware_py.core.inputs import Inputs
from firmware_py.core.numbers import clamp
from firmware_py.core.safety import drive_link, monitors, supervisor
from firmware_py.core.state import Config, Outputs, State
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import (
    ASKS_CLEAR,
    ASKS_RUN,
    CLOSED_LOOP,
    MOVING,
    NO_LIMIT,
    NO_REFUSAL,
    READY,
    RUN,
    STOPPING,
    ActingLimit,
    Refusal,
)


class Sensed(NamedTuple):
    """The result of all samples since the last command: one sample, or more after an overrun.

    `ticks` counts from the last command to the newest sample; `contact` is the detector's result for the
    newest sample. `separation_ticks` counts from the separation to the newest sample. If several impacts
    ended, `impulse_n_s` and `peak_m_s2` are the largest values.
    """

    ticks: int
    crank: crank.CrankState
    estimator: estimator_state.EstimatorState
    detector: detector.DetectorState
    regime: regime.RegimeState
    gait: gait.CycleState
    contact: Contact
    touch_down: bool
    separation: bool
    separation_ticks: int
    impulse_n_s: float
    peak_m_s2: float


def refused(
    valid_ratio: bool, waits_for_crank: bool, by_gait: Refusal, by_hold: Refusal, by_stride_harmonic: Refusal
) -> Refusal:
    """The first reason why a RUN request is not followed; NO_REFUSAL if it is."""
    if not valid_ratio:
        return Refusal.RATIO_OUT_OF_RANGE
    if waits_for_crank:
        return Refusal.CRANK_TOO_FAST
    if by_gait != NO_REFUSAL:
        return by_gait
    return by_hold if by_hold != NO_REFUSAL else by_stride_harmonic


def unsensed(state: State) -> Sensed:
    """The `Sensed` of a tick before its first sample."""
    return Sensed(
        0,
        state.crank,
        state.estimator,
        state.detector,
        state.regime,
        state.gait,
        detector.FLYING,
        False,
        False,
        0,
        0.0,
        0.0,
    )


def sense(config: Config, commanded: speed.SpeedState, sensed: Sensed, inputs: Inputs) -> Sensed:
    """Process one sample: update crank, estimate, impacts, regime and gait from `sensed`."""
    n = inputs.elapsed_ticks - sensed.ticks
    waited = sensed.ticks > 0
    acting_n_m = commanded.torque_n_m if waited else commanded.acting_n_m
    crank_now = crank.step(
        config.crank,
        sensed.crank,
        inputs.encoder,
        n,
        speed.known_acceleration(config.speed, acting_n_m, sensed.crank, sensed.estimator),
    )
    predicted = estimator.propagate(
        config.estimator,
        sensed.estimator,
        inputs.accelerometer,
        sensed.detector.phase,
        crank_now.angle_rad,
        crank_now.omega_rad_s,
        n,
    )
    detector_now, contact = detector.step(config.detector, sensed.detector, predicted, n)
    estimate = estimator.correct(
        config.estimator,
        sensed.estimator,
        predicted,
        contact,
        inputs.measurements,
        crank_now.angle_rad,
        crank_now.omega_rad_s,
        n,
    )
    regime_now = regime.step(
        sensed.regime,
        crank_now.angle_rad,
        crank_now.omega_rad_s,
        contact.touch_down,
        contact.age_s,
        contact.approach_speed_m_s,
        predicted.sensor.acceleration_m_s2,
        waited and sensed.regime.ended,
    )
    gait_now = sensed.gait
    if inputs.gait.age_ticks < NEVER_TICKS:
        gait_now = gait.step(config.gait, sensed.gait, inputs.gait, n)
    separation_ticks = sensed.separation_ticks + n if sensed.separation else 0
    impulse_n_s, peak_m_s2 = sensed.impulse_n_s, sensed.peak_m_s2
    if contact.separation:  # NaN counts as the largest
        separation_ticks = 0
        impulse_n_s = impulse_n_s if detector_now.impulse_n_s <= impulse_n_s else detector_now.impulse_n_s
        peak_m_s2 = peak_m_s2 if detector_now.peak_m_s2 <= peak_m_s2 else detector_now.peak_m_s2
    return Sensed(
        inputs.elapsed_ticks,
        crank_now,
        estimate,
        detector_now,
        regime_now,
        gait_now,
        contact,
        sensed.touch_down or contact.touch_down,
        sensed.separation or contact.separation,
        separation_ticks,
        impulse_n_s,
        peak_m_s2,
    )


def step(config: Config, state: State, inputs: Inputs) -> tuple[State, Outputs]:
    """One tick of the whole controller, on one sample."""
    return act(config, state, sense(config, state.speed, unsensed(state), inputs), inputs)


def act(  # noqa: PLR0915 - one tick, read top to bottom
    config: Config, state: State, sensed: Sensed, inputs: Inputs
) -> tuple[State, Outputs]:
    """Limits, mode, target speed and torque, from the samples sensed so far."""
    n = inputs.elapsed_ticks
    crank_now, estimate, detector_now = sensed.crank, sensed.estimator, sensed.detector
    regime_now, gait_now = sensed.regime, sensed.gait
    since_touch_down_s = detector_now.since_touch_down_s + sensed.separation_ticks * config.tick_s

    # Supervise
    follow = config.gait_lock.follow
    valid_ratio = start.valid_ratio(config.start, inputs.operator.target_ratio)
    valid_target = valid_ratio and not (follow and state.gait_lock.refusal != NO_REFUSAL)
    spins_down = state.supervisor.mode == STOPPING and config.spin_down.longest_s > 0.0
    followed_rad_s = state.spin_down.target_omega_rad_s if spins_down else state.start.target_omega_rad_s
    implausible = monitors.is_disturbed(config.monitors.limits, crank_now) and not math.isnan(
        speed.stretch_m(config.speed.load, sin(crank_now.angle_rad), estimate.x_m)  # NaN: the load is unknown
    )
    monitors_now, findings = monitors.step(
        config.monitors,
        state.monitors,
        state.supervisor.mode,
        inputs,
        crank_now,
        estimate,
        sensed.impulse_n_s,
        sensed.peak_m_s2,
        followed_rad_s,
        implausible,
    )
    supervisor_now = supervisor.step(
        state.supervisor,
        findings,
        inputs.estop,
        inputs.operator.request,
        inputs.drive.disarm_reason,
        valid_target,
        drive_link.is_idle(state.drive_link),
        state.start.captured,
        state.start.failed,
        n,
    )
    mode = supervisor_now.mode
    moving = mode in MOVING

    # Command
    target_ratio = inputs.operator.target_ratio
    holding = mode == RUN and state.start.stage == start.HOLD
    identify_now = state.identify
    contact = sensed.contact
    if config.identify.enabled and (contact.touch_down or estimate.flight.ticks % identify.SAMPLE_TICKS == 0):
        identify_now = identify.step(
            config.identify,
            config.estimator.striker,
            state.identify,
            estimate,
            holding,
            contact,
            crank_now.angle_rad,
            crank_now.omega_rad_s,
        )
        if contact.touch_down:
            estimate = identify.towards(config.identify, identify_now, holding, estimate)
    lock_now, stride_harmonic_now = state.gait_lock, state.stride_harmonic
    if follow:
        lock_now = gait_lock.step(
            config.gait_lock,
            state.gait_lock,
            gait_now,
            moving,
            holding,
            crank_now.angle_rad,
            regime_now,
            sensed.touch_down,
            since_touch_down_s,
            n,
            state.stride_harmonic.aim_ratio,
        )
        asked_n_s = inputs.operator.target_impulse_n_s
        stride_harmonic_now = stride_harmonic.step(
            config.stride_harmonic,
            state.stride_harmonic,
            holding,
            lock_now.harmonic,
            lock_now.base_ratio + lock_now.trim,
            asked_n_s if hold.possible(config.hold, asked_n_s) else 0.0,
            regime_now,
            detector_now.impulse_n_s,
        )
        target_ratio = lock_now.base_ratio
    hold_now = hold.step(
        config.hold,
        state.hold,
        holding and not follow and target_ratio >= config.start.capture_ratio,
        state.start.to_rad_s / config.hold.natural_rad_s,
        target_ratio,
        inputs.operator.target_impulse_n_s,
        regime_now,
        detector_now.impulse_n_s,
        n,
    )
    start_now = start.step(
        config.start,
        state.start,
        mode,
        target_ratio,
        inputs.drive.axis_state == CLOSED_LOOP,
        crank_now.omega_rad_s,
        regime_now,
        lock_now.trim if follow else hold_now.trim,
        lock_now.trim_rate_1_s if follow else hold_now.trim_rate_1_s,
        not follow,
        n,
    )
    spin_down_now = spin_down.INITIAL
    target_rad_s, target_rad_s2 = start_now.target_omega_rad_s, start_now.target_acceleration_rad_s2
    if mode == STOPPING and config.spin_down.longest_s > 0.0:
        spin_down_now = spin_down.step(config.spin_down, state.spin_down, crank_now, estimate, n)
        target_rad_s, target_rad_s2 = spin_down_now.target_omega_rad_s, 0.0
    if moving and inputs.drive.axis_state == CLOSED_LOOP:
        speed_now = speed.step(config.speed, state.speed, crank_now, estimate, target_rad_s, target_rad_s2, n)
    else:
        speed_now = speed.safe(state.speed)

    asks_clear = inputs.operator.request == ASKS_CLEAR and not findings.operator_lost
    drive_link_now, drive_frame = drive_link.step(
        config.drive_link, state.drive_link, mode, inputs.drive, inputs.encoder, asks_clear, n
    )
    acting_limit = speed_now.acting_limit
    if acting_limit == NO_LIMIT and hold_now.guarded:
        acting_limit = ActingLimit.IMPACT_PHASE
    retreated = moving and not follow and start.retreated(config.start, start_now, target_ratio)
    if acting_limit == NO_LIMIT and retreated:
        acting_limit = ActingLimit.RETREAT
    refusal = NO_REFUSAL
    if inputs.operator.request == ASKS_RUN and not findings.operator_lost:
        lost_again = retreated and start_now.attempts > 1  # after a retreat, or no impact in the dip
        refusal = refused(
            valid_ratio,
            mode == READY and findings.freewheel_overspeed,
            lock_now.refusal if follow else NO_REFUSAL,
            Refusal.RATIO_TOO_HIGH if lost_again else hold_now.refusal,
            stride_harmonic_now.refusal,
        )
    outputs = Outputs(
        mode,
        supervisor_now.fault,
        supervisor_now.disarm_reason,
        refusal,
        regime_now.regime,
        acting_limit,
        clamp(speed_now.torque_n_m, config.speed.torque_limit_n_m),
        target_rad_s,
        drive_frame,
        sensed.touch_down,
        sensed.separation,
        since_touch_down_s,
        detector_now.approach_speed_m_s,
        detector_now.impulse_n_s,
        regime_now.ended,
        regime_now.last.impacts,
        regime_now.last.phase_rad,
        regime_now.last.peak_m_s2,
    )
    return (
        State(
            crank_now,
            estimate,
            detector_now,
            regime_now,
            start_now,
            hold_now,
            speed_now,
            monitors_now,
            supervisor_now,
            drive_link_now,
            gait_now,
            lock_now,
            stride_harmonic_now,
            identify_now,
            spin_down_now,
        ),
        outputs,
    )
