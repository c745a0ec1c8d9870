"""One tick of the control blocks:

    sense(config, state, inputs) -> sensed                                    the observers
    decide(config, state, sensed, inputs, found) -> decided                   the mode, the target, the torque
    guard(config, decided, gate, found, inputs) -> (gate, decided)            the gate permits the torque

and `step`, which calls them. Sensors are sampled at t_k, the tick runs before t_{k+1}, and its torque acts
from t_{k+1} for one tick. A tick that catches up (`is_current` is False) belongs to a period that was missed:
its torque is not sent, and the last one that was sent goes on acting.
"""

import math
from typing import NamedTuple

from firmware_py.core.config import Config
from firmware_py.core.control import hold, speed, spin_down, start
from firmware_py.core.elementary import sin
from firmware_py.core.estimation import crank, detector, estimator, estimator_state, regime
from firmware_py.core.estimation.estimator_state import Contact
from firmware_py.core.gait import follow
from firmware_py.core.gait.follow import WalkState
from firmware_py.core.gait.gait_lock import Moment
from firmware_py.core.inputs import Inputs
from firmware_py.core.request import Request
from firmware_py.core.safety import drive_link, gate, monitors, supervisor, watchdog_proof
from firmware_py.core.safety.monitors import Watched
from firmware_py.core.safety.supervisor import Observed
from firmware_py.core.state import Outputs, State
from firmware_py.interface.enums import (
    ASKS_CLEAR,
    ASKS_RUN,
    CLOSED_LOOP,
    MOVING,
    NO_FAULT,
    NO_LIMIT,
    NO_REFUSAL,
    READY,
    RUN,
    STOPPING,
    ActingLimit,
    Mode,
    Refusal,
)


class Sensed(NamedTuple):
    """The observers after this tick's sample; `contact` is the detector's result."""

    crank: crank.CrankState
    estimator: estimator_state.EstimatorState
    detector: detector.DetectorState
    regime: regime.RegimeState
    contact: Contact


class Supervised(NamedTuple):
    """The mode and its reasons. `valid_ratio`: the ratio may be run. `proven`: a start may begin."""

    monitors: monitors.MonitorState
    findings: monitors.Findings
    supervisor: supervisor.SupervisorState
    valid_ratio: bool
    proven: bool


class Command(NamedTuple):
    """The proposed motion: target speed and, in `speed`, the torque."""

    start: start.StartState
    hold: hold.HoldState
    spin_down: spin_down.SpinDownState
    speed: speed.SpeedState
    target_rad_s: float


class Linked(NamedTuple):
    """The drive's axis: the test of its watchdog, its state, and the frame to be sent."""

    proof: watchdog_proof.ProofState
    drive_link: drive_link.DriveLinkState
    frame: drive_link.DriveFrame


class Decided(NamedTuple):
    """The result of `decide`; the torque is only proposed."""

    supervised: Supervised
    walk: WalkState
    command: Command
    linked: Linked
    acting_limit: ActingLimit
    refusal: Refusal


def sense(config: Config, state: State, inputs: Inputs) -> Sensed:
    """Update crank, estimate, impacts and regime by this tick's sample."""
    known_rad_s2 = speed.known_acceleration(config, state.speed.acting_n_m, state.crank, state.estimator)
    crank_now = crank.step(config, state.crank, inputs.encoder, known_rad_s2)
    predicted = estimator.propagate(
        config, state.estimator, inputs.accelerometer, state.detector.phase, crank_now
    )
    detector_now, contact = detector.step(config, state.detector, predicted)
    estimate = estimator.correct(config, state.estimator, predicted, contact, inputs.measurements, crank_now)
    regime_now = regime.step(state.regime, crank_now, contact, predicted.sensor.acceleration_m_s2)
    return Sensed(crank_now, estimate, detector_now, regime_now, contact)


def supervise(
    config: Config, state: State, sensed: Sensed, inputs: Inputs, found: gate.GateFindings
) -> Supervised:
    """Findings of the monitors and the mode; `found`: the gate's findings."""
    mode, estimate = state.supervisor.mode, sensed.estimator
    spins_down = mode == STOPPING and config.d.spin_down_s > 0.0
    target_rad_s = state.spin_down.target_omega_rad_s if spins_down else state.start.target_omega_rad_s
    stretch_m = speed.stretch_m(config, sin(sensed.crank.angle_rad), estimate.x_m)
    watched = Watched(
        mode=mode,
        axis_state=inputs.drive.axis_state,
        crank=sensed.crank,
        estimate=estimate,
        impulse_n_s=sensed.detector.impulse_n_s if sensed.contact.separation else 0.0,
        target_omega_rad_s=target_rad_s,
        disturbed=monitors.is_disturbed(config, sensed.crank, not math.isnan(stretch_m)),
    )
    monitors_now, findings = monitors.step(config, state.monitors, found, watched)
    if watchdog_proof.tolerates(state.proof, inputs.drive):
        findings = findings._replace(drive=NO_FAULT)
    proven = watchdog_proof.may_start(config, state.proof)
    valid_ratio = start.valid_ratio(config, inputs.operator.target_ratio)
    walk = WalkState(state.gait, state.gait_lock, state.stride_harmonic)
    observed = Observed(
        estop=inputs.estop,
        request=inputs.operator.request,
        disarm_reason=inputs.drive.disarm_reason,
        target_valid=valid_ratio and follow.accepts(config, walk),
        axis_idle=drive_link.is_idle(state.drive_link),
        captured=state.start.captured,
        start_failed=state.start.failed,
        proof_passed=state.proof.passed,
        proof_failed=state.proof.failed,
        proven=proven,
    )
    supervisor_now = supervisor.step(state.supervisor, findings, observed)
    return Supervised(monitors_now, findings, supervisor_now, valid_ratio, proven)


def choose_request(
    config: Config, state: State, sensed: Sensed, inputs: Inputs, mode: Mode
) -> tuple[WalkState, Request]:
    """The request to start and hold: the operator's, or the gait's."""
    walk = WalkState(state.gait, state.gait_lock, state.stride_harmonic)
    moment = Moment(
        moving=mode in MOVING,
        holding=mode == RUN and state.start.stage == start.HOLD,
        angle_rad=sensed.crank.angle_rad,
        regime=sensed.regime,
        touch_down=sensed.contact.touch_down,
        since_touch_down_s=sensed.detector.since_touch_down_s,
        impact_n_s=sensed.detector.impulse_n_s,
    )
    return follow.ask(config, walk, inputs.gait, inputs.operator, moment)


def command(
    config: Config,
    state: State,
    sensed: Sensed,
    mode: Mode,
    request: Request,
    is_closed: bool,
    is_current: bool,
) -> Command:
    """The target speed of a start, hold or stop, and the torque of the speed loop."""
    hold_acts = mode == RUN and state.start.stage == start.HOLD and not request.sets_hold_ratio
    if hold_acts and request.ratio >= config.p.start.capture_ratio:
        base_ratio = state.start.to_rad_s / config.d.natural_rad_s
        impact_n_s = sensed.detector.impulse_n_s
        hold_now = hold.step(config, state.hold, request, base_ratio, sensed.regime, impact_n_s)
    else:
        hold_now = hold.rest(config, request)
    goal = start.Goal(
        ratio=request.ratio,
        trim=request.trim if request.sets_hold_ratio else hold_now.trim,
        trim_rate_1_s=request.trim_rate_1_s if request.sets_hold_ratio else hold_now.trim_rate_1_s,
        may_retreat=not request.sets_hold_ratio,
    )
    omega_rad_s = sensed.crank.omega_rad_s
    start_now = start.step(
        config, state.start, mode, goal, drive_ready=is_closed, omega_rad_s=omega_rad_s, regime=sensed.regime
    )
    spin_down_now = spin_down.INITIAL
    target_rad_s, target_rad_s2 = start_now.target_omega_rad_s, start_now.target_acceleration_rad_s2
    if mode == STOPPING and config.d.spin_down_s > 0.0:
        spin_down_now = spin_down.step(config, state.spin_down, sensed.crank, sensed.estimator)
        target_rad_s, target_rad_s2 = spin_down_now.target_omega_rad_s, 0.0
    if not is_current:
        speed_now = speed.keep(state.speed)
    elif mode in MOVING and is_closed:
        speed_now = speed.step(
            config, state.speed, sensed.crank, sensed.estimator, target_rad_s, target_rad_s2
        )
    else:
        speed_now = speed.safe(state.speed)
    return Command(start_now, hold_now, spin_down_now, speed_now, target_rad_s)


def link(config: Config, state: State, sensed: Sensed, inputs: Inputs, supervised: Supervised) -> Linked:
    """The requested state of the drive's axis, and the frame that requests it."""
    mode, before = supervised.supervisor.mode, state.drive_link
    proof_now = watchdog_proof.step(
        config,
        state.proof,
        mode,
        inputs.drive,
        axis_is_closed=drive_link.is_closed(before),
        axis_is_idle=drive_link.is_idle(before),
        omega_rad_s=sensed.crank.omega_rad_s,
    )
    asks_clear = inputs.operator.request == ASKS_CLEAR and not supervised.findings.operator_lost
    drive_link_now, frame = drive_link.step(
        config,
        before,
        mode,
        proof_now.stage,
        drive=inputs.drive,
        encoder=inputs.encoder,
        asks_clear=asks_clear,
    )
    return Linked(proof_now, drive_link_now, frame)


def find_refusal(
    config: Config, inputs: Inputs, supervised: Supervised, request: Request, by_control: Refusal
) -> Refusal:
    """The first reason why a RUN request is not followed; NO_REFUSAL if it is, or if there is none."""
    if inputs.operator.request != ASKS_RUN or supervised.findings.operator_lost:
        return NO_REFUSAL
    if not supervised.valid_ratio:
        return Refusal.RATIO_OUT_OF_RANGE
    is_ready = supervised.supervisor.mode == READY
    if is_ready and supervised.findings.freewheel_overspeed:
        return Refusal.CRANK_TOO_FAST
    if is_ready and not supervised.proven:
        return Refusal.WATCHDOG_UNPROVEN
    if request.refusal != NO_REFUSAL:
        return request.refusal
    return by_control if by_control != NO_REFUSAL else request.unmet


def decide(
    config: Config, state: State, sensed: Sensed, inputs: Inputs, found: gate.GateFindings, is_current: bool
) -> Decided:
    """The mode, whose request counts, the proposed torque, and the drive's axis."""
    supervised = supervise(config, state, sensed, inputs, found)
    mode = supervised.supervisor.mode
    walk, request = choose_request(config, state, sensed, inputs, mode)
    is_closed = inputs.drive.axis_state == CLOSED_LOOP
    proposed = command(config, state, sensed, mode, request, is_closed=is_closed, is_current=is_current)
    linked = link(config, state, sensed, inputs, supervised)
    retreated = (
        mode in MOVING
        and not request.sets_hold_ratio
        and start.has_retreated(config, proposed.start, request.ratio)
    )
    acting_limit = proposed.speed.acting_limit
    if acting_limit == NO_LIMIT and proposed.hold.guarded:
        acting_limit = ActingLimit.IMPACT_PHASE
    if acting_limit == NO_LIMIT and retreated:
        acting_limit = ActingLimit.RETREAT
    # After a retreat, or if there is no impact in the dip, the ratio is too high.
    is_lost_again = retreated and proposed.start.attempts > 1
    by_control = Refusal.RATIO_TOO_HIGH if is_lost_again else proposed.hold.refusal
    refusal = find_refusal(config, inputs, supervised, request, by_control)
    return Decided(supervised, walk, proposed, linked, acting_limit, refusal)


def guard(
    config: Config,
    decided: Decided,
    gate_now: gate.GateState,
    found: gate.GateFindings,
    inputs: Inputs,
    is_current: bool,
) -> tuple[gate.GateState, Decided]:
    """The gate's last word on the torque; a tick that catches up keeps the torque that was sent."""
    proposed = decided.command.speed
    gate_now, torque_n_m, gate_limit = gate.permit(
        config.d.gate, gate_now, found, inputs, proposed.torque_n_m
    )
    if gate_limit == NO_LIMIT:
        return gate_now, decided
    permitted = proposed._replace(torque_n_m=torque_n_m) if is_current else proposed
    command_now = decided.command._replace(speed=permitted)
    return gate_now, decided._replace(command=command_now, acting_limit=gate_limit)


def step(
    config: Config, state: State, inputs: Inputs, gate_now: gate.GateState, is_current: bool
) -> tuple[State, Outputs]:
    """One period. `gate_now`: the gate's state after the readings of this tick."""
    sensed = sense(config, state, inputs)
    gate_now, found = gate.judge(config.d.gate, gate_now, inputs)
    decided = decide(config, state, sensed, inputs, found, is_current)
    gate_now, decided = guard(config, decided, gate_now, found, inputs, is_current)
    supervised, walk, proposed, linked = decided.supervised, decided.walk, decided.command, decided.linked
    state = State(
        crank=sensed.crank,
        estimator=sensed.estimator,
        detector=sensed.detector,
        regime=sensed.regime,
        start=proposed.start,
        hold=proposed.hold,
        speed=proposed.speed,
        gate=gate_now,
        monitors=supervised.monitors,
        supervisor=supervised.supervisor,
        drive_link=linked.drive_link,
        proof=linked.proof,
        gait=walk.gait,
        gait_lock=walk.gait_lock,
        stride_harmonic=walk.stride_harmonic,
        spin_down=proposed.spin_down,
    )
    return state, outputs_of(state, sensed.contact, decided)


def outputs_of(state: State, contact: Contact, decided: Decided) -> Outputs:
    """What the tick sends and reports."""
    last = state.regime.last
    return Outputs(
        mode=state.supervisor.mode,
        fault=state.supervisor.fault,
        disarm_reason=state.supervisor.disarm_reason,
        refusal=decided.refusal,
        regime=state.regime.regime,
        acting_limit=decided.acting_limit,
        torque_n_m=state.speed.torque_n_m,
        target_omega_rad_s=decided.command.target_rad_s,
        drive_frame=decided.linked.frame,
        withholds=state.proof.stage == watchdog_proof.WITHHOLD,
        impact=contact.touch_down,
        separation=contact.separation,
        impact_age_s=state.detector.since_touch_down_s,
        impact_speed_m_s=state.detector.approach_speed_m_s,
        impact_impulse_n_s=state.detector.impulse_n_s,
        period_ended=state.regime.ended,
        period_impacts=last.impacts,
        impact_phase_rad=last.phase_rad,
        peak_acceleration_m_s2=last.peak_m_s2,
    )
