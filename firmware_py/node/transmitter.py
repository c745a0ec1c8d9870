"""Transmitting: the torque in every tick, and at most one other frame.

`interface.pacing` gives the reason. The drive link's frame comes first, then faults, then impacts; all others
are sent in the order in which they fell due.
"""

from typing import NamedTuple

from firmware_py.core.numbers import TAU, fraction
from firmware_py.core.safety.drive_link import DriveFrame, DriveLinkConfig
from firmware_py.core.state import Outputs, State
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import AXIS_IDLE, CLOSED_LOOP, NO_FAULT, NO_REFUSAL, Fault
from firmware_py.interface.frame import WordFrame
from firmware_py.interface.generated import kinds, packing
from firmware_py.interface.generated.records import (
    ClearErrors,
    DriveEstop,
    FaultEvent,
    FirmwareHeartbeat,
    GaitReport,
    ImpactEvent,
    ParameterValue,
    RegimeReport,
    SetAbsolutePosition,
    SetAxisState,
    SetControllerMode,
    SetLimits,
    StrikerEstimate,
)
from firmware_py.node.receiver import with_one

TORQUE_CONTROL = 1
PASSTHROUGH = 1
REGIME_S = 0.05
"""The shortest time between two regime reports."""

NOT_WAITING = 1 << 62
"""Place in the queue of a frame that does not wait."""


class Impact(NamedTuple):
    """An impact to report; its age increases while its frame waits."""

    tick: int
    """Tick in which the separation was detected."""
    age_s: float
    """Age of the touch-down at the samples of that tick."""
    approach_speed_m_s: float
    impulse_n_s: float


class Cyclic(NamedTuple):
    """A cyclic frame: the tick in which it last fell due, and its place in the queue."""

    due_tick: int
    place: int


class Sent(NamedTuple):
    """Number of frames sent since power-up, for each identifier with a rolling counter."""

    heartbeat: int
    estimate: int
    regime: int
    impact: int
    fault: int
    value: int
    gait: int


class Transmitter(NamedTuple):
    """All waiting frames. `next_place` counts the frames that have fallen due.

    The first `fault_count` faults, `impact_count` impacts and `answer_count` answers wait, at most four of
    each; each is sent within a few ticks. `period_ended`: a drive period has ended, but its report is not
    due.
    """

    next_place: int
    sent: Sent
    faults: tuple[FaultEvent, FaultEvent, FaultEvent, FaultEvent]
    fault_count: int
    impacts: tuple[Impact, Impact, Impact, Impact]
    impact_count: int
    refusal: int
    refusal_place: int
    period_ended: bool
    report: RegimeReport
    regime: Cyclic
    estimate: Cyclic
    heartbeat: Cyclic
    gait: Cyclic
    answers: tuple[ParameterValue, ParameterValue, ParameterValue, ParameterValue]
    answer_count: int
    answer_place: int


IDLE = Cyclic(-NEVER_TICKS, NOT_WAITING)
NO_EVENT = FaultEvent(0, 0, 0)
NO_IMPACT = Impact(0, 0.0, 0.0, 0.0)
NO_ANSWER = ParameterValue(0.0, 0, 0, 0)
NO_FRAME = WordFrame(0, 0, 0)

INITIAL = Transmitter(
    next_place=0,
    sent=Sent(0, 0, 0, 0, 0, 0, 0),
    faults=(NO_EVENT, NO_EVENT, NO_EVENT, NO_EVENT),
    fault_count=0,
    impacts=(NO_IMPACT, NO_IMPACT, NO_IMPACT, NO_IMPACT),
    impact_count=0,
    refusal=0,
    refusal_place=NOT_WAITING,
    period_ended=False,
    report=RegimeReport(0, 0.0, 0.0, 0),
    regime=IDLE,
    estimate=IDLE,
    heartbeat=IDLE,
    gait=IDLE,
    answers=(NO_ANSWER, NO_ANSWER, NO_ANSWER, NO_ANSWER),
    answer_count=0,
    answer_place=NOT_WAITING,
)


def is_due(cyclic: Cyclic, tick: int, period_s: float, tick_s: float) -> bool:
    """Whether a cyclic frame's period has passed."""
    return (tick - cyclic.due_tick) * tick_s >= period_s - 1e-9


def regime_report(outputs: Outputs) -> RegimeReport:
    """The report of the drive period that has just ended."""
    return RegimeReport(
        outputs.period_impacts,
        360.0 * fraction(outputs.impact_phase_rad / TAU),
        outputs.peak_acceleration_m_s2,
        outputs.regime.value,
    )


def queued(
    tick_s: float,
    waiting: Transmitter,
    tick: int,
    before: Outputs,
    outputs: Outputs,
    has_gait: bool,
) -> tuple[Transmitter, int]:
    """Queue the frames that fall due in this tick; also returns the number of frames lost to a full queue."""
    lost = 0
    if outputs.separation:
        impulse_n_s = max(outputs.impact_impulse_n_s, 0.0)
        one = Impact(tick, outputs.impact_age_s, outputs.impact_speed_m_s, impulse_n_s)
        impacts, count, lost = with_one(waiting.impacts, waiting.impact_count, one)
        waiting = waiting._replace(impacts=impacts, impact_count=count)
    reason_is_new = outputs.disarm_reason not in (0, before.disarm_reason)
    if outputs.fault not in (NO_FAULT, before.fault) or reason_is_new:
        event = FaultEvent(outputs.disarm_reason, outputs.fault.value, 0)
        faults, count, more = with_one(waiting.faults, waiting.fault_count, event)
        waiting = waiting._replace(faults=faults, fault_count=count)
        lost += more
    if outputs.refusal not in (NO_REFUSAL, before.refusal):
        lost += 0 if waiting.refusal_place == NOT_WAITING else 1
        place = waiting.next_place
        waiting = waiting._replace(refusal=outputs.refusal.value, refusal_place=place, next_place=place + 1)
    if outputs.period_ended:
        waiting = waiting._replace(period_ended=True)
    if waiting.period_ended and tick - waiting.regime.due_tick >= round(REGIME_S / tick_s):
        report, place = regime_report(outputs), waiting.next_place
        regime = Cyclic(tick, place)
        waiting = waiting._replace(report=report, regime=regime, period_ended=False, next_place=place + 1)
    if is_due(waiting.estimate, tick, kinds.STRIKER_ESTIMATE.period_s, tick_s):
        place = waiting.next_place
        waiting = waiting._replace(estimate=Cyclic(tick, place), next_place=place + 1)
    if is_due(waiting.heartbeat, tick, kinds.FIRMWARE_HEARTBEAT.period_s, tick_s):
        place = waiting.next_place
        waiting = waiting._replace(heartbeat=Cyclic(tick, place), next_place=place + 1)
    if has_gait and is_due(waiting.gait, tick, kinds.GAIT_REPORT.period_s, tick_s):
        place = waiting.next_place
        waiting = waiting._replace(gait=Cyclic(tick, place), next_place=place + 1)
    return waiting, lost


def with_answer(waiting: Transmitter, answer: ParameterValue) -> tuple[Transmitter, bool]:
    """Queue an answer; also returns whether there was a place for it."""
    answers, count, lost = with_one(waiting.answers, waiting.answer_count, answer)
    if lost > 0:
        return waiting, False
    place = waiting.next_place
    later = waiting._replace(
        next_place=place + 1,
        answers=answers,
        answer_count=count,
        answer_place=place if waiting.answer_place == NOT_WAITING else waiting.answer_place,
    )
    return later, True


def drive_frame(config: DriveLinkConfig, kind: DriveFrame, position_rev: float) -> WordFrame:
    """The content of a frame that the drive link sends."""
    if kind == DriveFrame.ESTOP:
        return packing.pack_drive_estop(DriveEstop(), 0)[0]
    if kind == DriveFrame.CONTROLLER_MODE:
        return packing.pack_set_controller_mode(SetControllerMode(TORQUE_CONTROL, PASSTHROUGH), 0)[0]
    if kind == DriveFrame.LIMITS:
        limits = SetLimits(config.speed_limit_rad_s / TAU, config.current_limit_a)
        return packing.pack_set_limits(limits, 0)[0]
    if kind == DriveFrame.CLEAR_ERRORS:
        return packing.pack_clear_errors(ClearErrors(0), 0)[0]
    if kind == DriveFrame.RE_ZERO:
        # Subtract whole turns only, so that the crank's angle does not change.
        return packing.pack_set_absolute_position(SetAbsolutePosition(fraction(position_rev)), 0)[0]
    state = CLOSED_LOOP.value if kind == DriveFrame.CLOSED_LOOP else AXIS_IDLE.value
    return packing.pack_set_axis_state(SetAxisState(state), 0)[0]


def first_place(waiting: Transmitter) -> int:
    """Place of the waiting frame that fell due first, faults and impacts aside."""
    return min(
        waiting.refusal_place,
        waiting.regime.place,
        waiting.estimate.place,
        waiting.heartbeat.place,
        waiting.gait.place,
        waiting.answer_place,
    )


def any_waits(waiting: Transmitter) -> bool:
    """Whether any frame waits."""
    return waiting.fault_count > 0 or waiting.impact_count > 0 or first_place(waiting) != NOT_WAITING


def gait_report(state: State) -> GaitReport:
    """The report of the estimated gait and of the crank's lock to it."""
    cycle, lock = state.gait, state.gait_lock
    walking = cycle.confidence > 0.0
    return GaitReport(
        cycle.phase if walking else 0.0,
        1.0 / cycle.stride.mean_s if walking else 0.0,
        lock.harmonic,
        cycle.doing.value,
        lock.in_window % 256,
        lock.outside % 256,
        cycle.confidence,
    )


def next_frame(
    tick_s: float, waiting: Transmitter, tick: int, state: State, outputs: Outputs
) -> tuple[Transmitter, WordFrame]:
    """Remove the next frame from the queue; `NO_FRAME` if it cannot be encoded."""
    sent = waiting.sent
    frame, sendable = NO_FRAME, True
    first = first_place(waiting)
    if waiting.fault_count > 0:
        faults = waiting.faults
        frame, sendable = packing.pack_fault_event(faults[0], sent.fault)
        waiting = waiting._replace(
            faults=(faults[1], faults[2], faults[3], NO_EVENT),
            fault_count=waiting.fault_count - 1,
            sent=sent._replace(fault=sent.fault + 1),
        )
    elif waiting.impact_count > 0:
        impacts = waiting.impacts
        known_tick, age_s, approach_speed_m_s, impulse_n_s = impacts[0]
        age_s += (tick - known_tick + 0.5) * tick_s  # half a tick: from the sensors' time to the tick's
        event = ImpactEvent(age_s, approach_speed_m_s, impulse_n_s)
        frame, sendable = packing.pack_impact_event(event, sent.impact)
        waiting = waiting._replace(
            impacts=(impacts[1], impacts[2], impacts[3], NO_IMPACT),
            impact_count=waiting.impact_count - 1,
            sent=sent._replace(impact=sent.impact + 1),
        )
    elif first == waiting.refusal_place:
        refused = FaultEvent(0, Fault.REQUEST_REFUSED.value, waiting.refusal)
        frame, sendable = packing.pack_fault_event(refused, sent.fault)
        waiting = waiting._replace(refusal_place=NOT_WAITING, sent=sent._replace(fault=sent.fault + 1))
    elif first == waiting.regime.place:
        frame, sendable = packing.pack_regime_report(waiting.report, sent.regime)
        waiting = waiting._replace(
            regime=waiting.regime._replace(place=NOT_WAITING), sent=sent._replace(regime=sent.regime + 1)
        )
    elif first == waiting.estimate.place:
        now = StrikerEstimate(state.estimator.x_m, state.estimator.v_m_s, state.crank.omega_rad_s)
        frame, sendable = packing.pack_striker_estimate(now, sent.estimate)
        waiting = waiting._replace(
            estimate=waiting.estimate._replace(place=NOT_WAITING),
            sent=sent._replace(estimate=sent.estimate + 1),
        )
    elif first == waiting.heartbeat.place:
        beat = FirmwareHeartbeat(
            outputs.mode.value,
            outputs.acting_limit.value,
            outputs.fault.value,
            outputs.target_omega_rad_s,
            outputs.regime.value,
        )
        frame, sendable = packing.pack_firmware_heartbeat(beat, sent.heartbeat)
        waiting = waiting._replace(
            heartbeat=waiting.heartbeat._replace(place=NOT_WAITING),
            sent=sent._replace(heartbeat=sent.heartbeat + 1),
        )
    elif first == waiting.gait.place:
        frame, sendable = packing.pack_gait_report(gait_report(state), sent.gait)
        waiting = waiting._replace(
            gait=waiting.gait._replace(place=NOT_WAITING), sent=sent._replace(gait=sent.gait + 1)
        )
    elif first == waiting.answer_place:
        answers, place = waiting.answers, waiting.next_place
        frame, sendable = packing.pack_parameter_value(answers[0], sent.value)
        more = waiting.answer_count > 1
        waiting = waiting._replace(
            answers=(answers[1], answers[2], answers[3], NO_ANSWER),
            answer_count=waiting.answer_count - 1,
            answer_place=place if more else NOT_WAITING,
            next_place=place + 1 if more else place,
            sent=sent._replace(value=sent.value + 1),
        )
    return waiting, frame if sendable else NO_FRAME
