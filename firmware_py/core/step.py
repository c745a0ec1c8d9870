"""One tick of the control blocks, each of which replaces its part of the state:

    sense(config, state, inputs, touching) -> (state, contact)                the observers
    supervise(config, state, contact, inputs, found) -> state                 the monitors and the mode
    choose_request(config, state, contact, inputs) -> (state, request)        of the operator or the gait
    command(config, state, request, is_closed, is_current) -> (state, …)      the target and the torque
    link(config, state, inputs) -> (state, frame)                             the drive's axis

and `step`, which calls them. Sensors are sampled at t_k, the tick runs before t_{k+1}, and its torque acts
from t_{k+1} for one tick. A tick that catches up (`is_current` is False) belongs to a period that was missed:
its torque is not sent, and the last one that was sent goes on acting.

The gate stands outside: `node.tick` has it judge the readings before a step, and permit the torque after it.
"""

from firmware_py.core.config import Config
from firmware_py.core.control import hold, speed, spin_down, start
from firmware_py.core.estimation import crank, detector, estimator, regime
from firmware_py.core.estimation.estimator_state import Contact, striker_of
from firmware_py.core.gait import follow
from firmware_py.core.gait.gait_lock import Moment
from firmware_py.core.inputs import Inputs
from firmware_py.core.request import Request
from firmware_py.core.safety import consent, drive_link, monitors, own_crank, supervisor, watchdog_proof
from firmware_py.core.safety.drive_link import DriveFrame
from firmware_py.core.safety.gate import Findings
from firmware_py.core.safety.monitors import Watched
from firmware_py.core.safety.supervisor import Observed
from firmware_py.core.state import Outputs, State
from firmware_py.interface.enums import ActingLimit, AxisState, Fault, Mode, OperatorRequest, Refusal
from firmware_py.interface.modes import MODES, Target


def sense(config: Config, state: State, inputs: Inputs, touching: bool) -> tuple[State, Contact]:
    """Update crank, estimate, impacts and regime by this tick's sample; also the detector's result.

    `touching`: the gate sees a contact.
    """
    nominal, turned = config.nominal, crank.read(config.crank, inputs.encoder)
    acting_n_m = state.speed.acting_n_m
    load_n_m = config.p.speed.load_share * speed.crank_load(
        config.p, state.crank, striker_of(state.estimator), 0.5 * config.tick_s
    )
    known_rad_s2 = crank.known_acceleration(config.crank, acting_n_m, state.crank, load_n_m)
    crank_now = crank.step(config.crank, state.crank, turned, known_rad_s2)
    own = own_crank.step(
        config.own_crank, state.own_crank, inputs.accelerometer, turned, acting_n_m, touching
    )
    predicted = estimator.propagate(
        config.estimator, nominal, state.estimator, inputs.accelerometer, state.detector.phase, crank_now
    )
    detector_now, contact = detector.step(config.detector, nominal, state.detector, predicted)
    estimate = estimator.correct(
        config.estimator, nominal, state.estimator, predicted, contact, inputs.measurements, crank=crank_now
    )
    regime_now = regime.step(state.regime, crank_now, contact, predicted.sensor.acceleration_m_s2)
    return state._replace(
        crank=crank_now, own_crank=own, estimator=estimate, detector=detector_now, regime=regime_now
    ), contact


def has_spin_down(config: Config, mode: Mode) -> bool:
    """Whether `spin_down` gives the target in this mode."""
    return MODES[mode.value].target == Target.STOP and spin_down.longest_s(config.p) > 0.0


def supervise(config: Config, state: State, contact: Contact, inputs: Inputs, found: Findings) -> State:
    """Update monitors and mode; the monitors add to `found`, the gate's findings."""
    mode = state.supervisor.mode
    target_rad_s = state.start.target_omega_rad_s
    watched = Watched(
        mode=mode,
        axis_state=inputs.drive.axis_state,
        crank=state.own_crank.tracked,
        striker=striker_of(state.estimator),
        impulse_n_s=state.detector.impulse_n_s if contact.separation else 0.0,
        target_omega_rad_s=state.spin_down.target_omega_rad_s
        if has_spin_down(config, mode)
        else target_rad_s,
    )
    monitors_now, findings = monitors.step(config.monitors, config.p.limit, state.monitors, found, watched)
    if watchdog_proof.tolerates(state.proof, inputs.drive):
        findings = findings._replace(drive=Fault.NONE)
    valid_ratio = start.is_valid_ratio(config.p, inputs.operator.target_ratio)
    observed = Observed(
        parameters_damaged=config.parameters_damaged,
        standstill=monitors.stands_still(config.monitors, monitors_now),
        too_fast=monitors_now.freewheel_ticks > 0,
        estop=inputs.estop,
        request=inputs.operator.request,
        disarm_reason=inputs.drive.disarm_reason,
        target_valid=valid_ratio and follow.accepts(config.gait, state.gait_lock),
        axis_idle=drive_link.is_idle(state.drive_link),
        captured=state.start.captured,
        start_failed=state.start.failed,
        proof_passed=state.proof.passed,
        proof_failed=state.proof.failed,
        proven=watchdog_proof.may_start(config.proof, state.proof),
    )
    supervisor_now = supervisor.step(state.supervisor, findings, observed)
    now = supervisor_now.mode
    ends_consent = now != mode and MODES[now.value].ends_consent
    consent_now = consent.end(state.consent) if ends_consent else state.consent
    return state._replace(monitors=monitors_now, supervisor=supervisor_now, consent=consent_now)


def choose_request(config: Config, state: State, contact: Contact, inputs: Inputs) -> tuple[State, Request]:
    """The request to start and hold: the operator's, or the gait's, whose blocks it updates."""
    mode = state.supervisor.mode
    now = Moment(
        moving=MODES[mode.value].moving,
        holding=mode == Mode.RUN and state.start.stage == start.HOLD,
        angle_rad=state.crank.angle_rad,
        regime=state.regime,
        touch_down=contact.touch_down,
        since_touch_down_s=state.detector.since_touch_down_s,
        impact_n_s=state.detector.impulse_n_s,
    )
    cycle, lock, harmonic, request = follow.ask(
        config.p, config.gait, state.gait, state.gait_lock, state.stride_harmonic, inputs, now=now
    )
    return state._replace(gait=cycle, gait_lock=lock, stride_harmonic=harmonic), request


def command(
    config: Config, state: State, request: Request, is_closed: bool, is_current: bool
) -> tuple[State, float]:
    """Update start, hold, stop and speed loop, which proposes the torque; also the target speed."""
    p, mode, crank_now, striker = config.p, state.supervisor.mode, state.crank, striker_of(state.estimator)
    hold_acts = mode == Mode.RUN and state.start.stage == start.HOLD and not request.sets_hold_ratio
    if hold_acts and request.ratio >= p.start.capture_ratio:
        base_ratio = state.start.to_rad_s / config.nominal.natural_rad_s
        hold_now = hold.step(p, state.hold, request, base_ratio, state.regime, state.detector.impulse_n_s)
    else:
        hold_now = hold.rest(p, request)
    if not request.sets_hold_ratio:
        request = request._replace(trim=hold_now.trim, trim_rate_1_s=hold_now.trim_rate_1_s)
    start_now = start.step(
        p,
        config.nominal,
        state.start,
        mode,
        request,
        drive_ready=is_closed,
        omega_rad_s=crank_now.omega_rad_s,
        regime=state.regime,
    )
    spin_down_now = spin_down.INITIAL
    target_rad_s, target_rad_s2 = start_now.target_omega_rad_s, start_now.target_acceleration_rad_s2
    if has_spin_down(config, mode):
        spin_down_now = spin_down.step(p, config.nominal, state.spin_down, crank_now, striker)
        target_rad_s, target_rad_s2 = spin_down_now.target_omega_rad_s, 0.0
    if not is_current:
        speed_now = speed.keep(state.speed)
    elif MODES[mode.value].moving and is_closed:
        speed_now = speed.step(p, state.speed, crank_now, striker, target_rad_s, target_rad_s2)
    else:
        speed_now = speed.rest(state.speed)
    state = state._replace(start=start_now, hold=hold_now, spin_down=spin_down_now, speed=speed_now)
    return state, target_rad_s


def link(config: Config, state: State, inputs: Inputs) -> tuple[State, DriveFrame]:
    """Update the test of the drive's watchdog and the requested state of its axis; also the frame for it."""
    mode, before = state.supervisor.mode, state.drive_link
    proof_now = watchdog_proof.step(
        config.proof,
        state.proof,
        mode,
        inputs.drive,
        axis_is_closed=drive_link.is_closed(before),
        axis_is_idle=drive_link.is_idle(before),
        omega_rad_s=state.crank.omega_rad_s,
    )
    drive_link_now, frame = drive_link.step(
        config.drive_link,
        before,
        mode,
        proof_now.stage,
        drive=inputs.drive,
        encoder=inputs.encoder,
        asks_clear=inputs.operator.request == OperatorRequest.CLEAR_FAULTS,
    )
    return state._replace(proof=proof_now, drive_link=drive_link_now), frame


def find_refusal(  # noqa: PLR0911 - a line a reason
    config: Config, state: State, inputs: Inputs, request: Request, by_control: Refusal
) -> Refusal:
    """The first reason why RUN is asked for and not followed; NONE if it is followed, or not asked for."""
    ready = state.supervisor.mode == Mode.READY
    if inputs.operator.stray_ticks <= config.gate.operator_ticks:
        return Refusal.OUT_OF_SEQUENCE
    if state.consent.asked != OperatorRequest.RUN:
        return Refusal.NONE
    if not start.is_valid_ratio(config.p, inputs.operator.target_ratio):
        return Refusal.RATIO_OUT_OF_RANGE
    if ready and state.monitors.freewheel_ticks > 0:
        return Refusal.CRANK_TOO_FAST
    if ready and not watchdog_proof.may_start(config.proof, state.proof):
        return Refusal.WATCHDOG_UNPROVEN
    if request.refusal != Refusal.NONE:
        return request.refusal
    return by_control if by_control != Refusal.NONE else request.unmet


def step(
    config: Config, state: State, inputs: Inputs, found: Findings, is_current: bool
) -> tuple[State, Outputs]:
    """One period. `found`: the gate's findings in it; the torque is only proposed."""
    consent_now = consent.step(config.consent, state.consent, inputs.operator)
    state = state._replace(consent=consent_now)
    inputs = inputs._replace(operator=inputs.operator._replace(request=consent_now.request))
    state, contact = sense(config, state, inputs, found.touching)
    state = supervise(config, state, contact, inputs, found)
    state, request = choose_request(config, state, contact, inputs)
    is_closed = inputs.drive.axis_state == AxisState.CLOSED_LOOP_CONTROL
    state, target_rad_s = command(config, state, request, is_closed=is_closed, is_current=is_current)
    state, frame = link(config, state, inputs)
    retreated = (
        MODES[state.supervisor.mode.value].moving
        and not request.sets_hold_ratio
        and start.has_retreated(config.p, config.nominal, state.start, request.ratio)
    )
    acting_limit = state.speed.acting_limit
    if acting_limit == ActingLimit.NONE and state.hold.guarded:
        acting_limit = ActingLimit.IMPACT_PHASE
    if acting_limit == ActingLimit.NONE and retreated:
        acting_limit = ActingLimit.RETREAT
    # After a retreat, or if there is no impact in the dip, the ratio is too high.
    is_lost_again = retreated and state.start.attempts > 1
    by_control = Refusal.RATIO_TOO_HIGH if is_lost_again else state.hold.refusal
    return state, Outputs(
        mode=state.supervisor.mode,
        fault=state.supervisor.fault,
        disarm_reason=state.supervisor.disarm_reason,
        refusal=find_refusal(config, state, inputs, request, by_control),
        regime=state.regime.regime,
        acting_limit=acting_limit,
        torque_n_m=state.speed.torque_n_m,
        target_omega_rad_s=target_rad_s,
        drive_frame=frame,
        withholds=state.proof.stage == watchdog_proof.WITHHOLD,
        impact=contact.touch_down,
        separation=contact.separation,
        impact_age_s=state.detector.since_touch_down_s,
        impact_speed_m_s=state.detector.approach_speed_m_s,
        impact_impulse_n_s=state.detector.impulse_n_s,
        period_ended=state.regime.ended,
        period_impacts=state.regime.last.impacts,
        impact_phase_rad=state.regime.last.phase_rad,
        peak_acceleration_m_s2=state.regime.last.peak_m_s2,
    )
