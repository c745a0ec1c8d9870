"""Transmitting: the torque in every tick, and at most one other frame.

If a node sent all its slow frames at once, they would delay the frames of every tick on the bus. With one
slow frame per tick there is no such delay, and no slow frame waits long: the cyclic frames need only a small
share of the ticks. The drive link's frame comes first; then the waiting frame that is first in `Slow`. Cyclic
frames fall due at different offsets (`CYCLES`).
"""

from enum import IntEnum
from typing import NamedTuple

from firmware_py.core.config import Config
from firmware_py.core.estimation.estimator_state import striker_of
from firmware_py.core.numbers import TAU, fraction
from firmware_py.core.safety.drive_link import DriveFrame
from firmware_py.core.state import Outputs, State
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import AxisState, ControlMode, Fault, InputMode, Refusal
from firmware_py.interface.frame import WordFrame
from firmware_py.interface.generated import kinds, packing, records
from firmware_py.interface.zeroed import zeroed

TORQUE_CONTROL, PASSTHROUGH = ControlMode.TORQUE_CONTROL.value, InputMode.PASSTHROUGH.value
REGIME_S = 0.05
"""The shortest time between two regime reports."""


class Slow(IntEnum):
    """The slow frames in the order of their priority: events first."""

    FAULT = 0
    IMPACT = 1
    REFUSAL = 2
    REGIME = 3
    ESTIMATE = 4
    HEARTBEAT = 5
    GAIT = 6


FAULT, IMPACT, REFUSAL, REGIME, ESTIMATE, HEARTBEAT, GAIT = Slow


class Cycle(NamedTuple):
    """A cyclic frame's period, and the tick after power-up in which it falls due first."""

    frame: int
    period_s: float
    offset_ticks: int


CYCLES = (
    Cycle(ESTIMATE.value, kinds.STRIKER_ESTIMATE.period_s, 1),
    Cycle(HEARTBEAT.value, kinds.FIRMWARE_HEARTBEAT.period_s, 2),
    Cycle(GAIT.value, kinds.GAIT_REPORT.period_s, 3),
)
CYCLED = 0x7FFFFFFF
"""The bits of the tick that cycles count: no more than a microcontroller divides with one instruction. When
they overflow, after 25 days at 1 kHz, one interval of each cyclic frame has another length."""


class Impact(NamedTuple):
    """An impact to report; its age increases while its frame waits.

    `tick` is the one in which the separation was detected, `age_s` the age of the touch-down at its samples.
    """

    tick: int
    age_s: float
    approach_speed_m_s: float
    impulse_n_s: float


class Transmitter(NamedTuple):
    """The waiting frames: bit k of `waiting` is the frame k of `Slow`, whose content is made when it is sent.

    `counts` holds the rolling counters, four bits for each frame of `Slow`. A newer event takes the place of
    one that still waits. `period_ended`: a drive period has ended, but its report is not due.
    """

    waiting: int
    counts: int
    fault: records.FaultEvent
    refusal: int
    impact: Impact
    report: records.RegimeReport
    report_tick: int
    period_ended: bool


NO_FRAME = WordFrame(0, 0, 0)

INITIAL = zeroed(Transmitter, report_tick=-NEVER_TICKS)


def queue(now: Transmitter, frame: int) -> tuple[Transmitter, int]:
    """Let a frame wait; also returns 1 if the same frame already waited, and is lost."""
    return now._replace(waiting=now.waiting | 1 << frame), now.waiting >> frame & 1


def queue_events(now: Transmitter, tick: int, before: Outputs, outputs: Outputs) -> tuple[Transmitter, int]:
    """Queue faults, impacts and refusals; also returns the number of frames lost."""
    lost = 0
    reason_is_new = outputs.disarm_reason not in (0, before.disarm_reason)
    if outputs.fault not in (Fault.NONE, before.fault) or reason_is_new:
        now, replaced = queue(now, FAULT.value)
        now = now._replace(fault=records.FaultEvent(outputs.disarm_reason, outputs.fault.value, 0))
        lost += replaced
    if outputs.separation:
        now, replaced = queue(now, IMPACT.value)
        impulse_n_s = max(outputs.impact_impulse_n_s, 0.0)
        impact = Impact(tick, outputs.impact_age_s, outputs.impact_speed_m_s, impulse_n_s)
        now = now._replace(impact=impact)
        lost += replaced
    if outputs.refusal not in (Refusal.NONE, before.refusal):
        now, replaced = queue(now, REFUSAL.value)
        now = now._replace(refusal=outputs.refusal.value)
        lost += replaced
    return now, lost


def queue_cyclic(
    config: Config, now: Transmitter, tick: int, outputs: Outputs, has_gait: bool
) -> Transmitter:
    """Queue the frames that fall due in this tick."""
    if outputs.period_ended:
        now = now._replace(period_ended=True)
    if now.period_ended and tick - now.report_tick >= round(REGIME_S / config.tick_s):
        report = records.RegimeReport(
            outputs.period_impacts,
            360.0 * fraction(outputs.impact_phase_rad / TAU),
            outputs.peak_acceleration_m_s2,
            outputs.regime.value,
        )
        waiting = now.waiting | 1 << REGIME.value
        now = now._replace(report=report, report_tick=tick, period_ended=False, waiting=waiting)
    for index in range(len(CYCLES)):
        cycle = CYCLES[index]
        period_ticks = max(round(cycle.period_s / config.tick_s), 1)
        is_due = (tick - cycle.offset_ticks & CYCLED) % period_ticks == 0
        if is_due and (has_gait or cycle.frame != GAIT.value):
            now = now._replace(waiting=now.waiting | 1 << cycle.frame)
    return now


def pack_drive_frame(config: Config, kind: DriveFrame, position_rev: float) -> WordFrame:
    """The content of a frame that the drive link sends."""
    if kind == DriveFrame.ESTOP:
        return packing.pack_drive_estop(records.DriveEstop(), 0)[0]
    if kind == DriveFrame.CONTROLLER_MODE:
        return packing.pack_set_controller_mode(records.SetControllerMode(TORQUE_CONTROL, PASSTHROUGH), 0)[0]
    if kind == DriveFrame.LIMITS:
        limits = records.SetLimits(config.p.limit.drive_speed_rad_s / TAU, config.p.speed.current_limit_a)
        return packing.pack_set_limits(limits, 0)[0]
    if kind == DriveFrame.CLEAR_ERRORS:
        return packing.pack_clear_errors(records.ClearErrors(0), 0)[0]
    if kind == DriveFrame.RE_ZERO:
        # Subtract whole turns only, so that the crank's angle does not change.
        return packing.pack_set_absolute_position(records.SetAbsolutePosition(fraction(position_rev)), 0)[0]
    state = AxisState.CLOSED_LOOP_CONTROL.value if kind == DriveFrame.CLOSED_LOOP else AxisState.IDLE.value
    return packing.pack_set_axis_state(records.SetAxisState(state), 0)[0]


def gait_report_of(state: State) -> records.GaitReport:
    """The report of the estimated gait and of the crank's lock to it."""
    cycle, lock = state.gait, state.gait_lock
    walking = cycle.confidence > 0.0
    return records.GaitReport(
        gait_phase=cycle.phase if walking else 0.0,
        stride_hz=1.0 / cycle.stride.mean_s if walking else 0.0,
        harmonic=lock.harmonic,
        gait_state=cycle.doing.value,
        pulses_in_window=lock.in_window % 256,
        pulses_outside=lock.outside % 256,
        confidence=cycle.confidence,
    )


def heartbeat_of(outputs: Outputs) -> records.FirmwareHeartbeat:
    """The mode and its reasons."""
    return records.FirmwareHeartbeat(
        outputs.mode.value,
        outputs.acting_limit.value,
        outputs.fault.value,
        outputs.target_omega_rad_s,
        outputs.regime.value,
    )


def first_waiting(waiting: int) -> int:
    """The frame of `Slow` that waits and comes first; `waiting` is not 0."""
    frame = 0
    while waiting >> frame & 1 == 0:
        frame += 1
    return frame


def pack(  # noqa: PLR0911 - a line a frame
    config: Config, now: Transmitter, frame: int, tick: int, state: State, outputs: Outputs, count: int
) -> tuple[WordFrame, bool]:
    """`(frame, sendable)` of one frame of `Slow`; `count`: its rolling counter."""
    if frame == FAULT.value:
        return packing.pack_fault_event(now.fault, count)
    if frame == REFUSAL.value:
        refused = records.FaultEvent(0, Fault.REQUEST_REFUSED.value, now.refusal)
        return packing.pack_fault_event(refused, count)
    if frame == IMPACT.value:
        seen_tick, age_s, approach_speed_m_s, impulse_n_s = now.impact
        age_s += (tick - seen_tick + 0.5) * config.tick_s  # half a tick: from the sensors' time to the tick's
        return packing.pack_impact_event(records.ImpactEvent(age_s, approach_speed_m_s, impulse_n_s), count)
    if frame == REGIME.value:
        return packing.pack_regime_report(now.report, count)
    if frame == ESTIMATE.value:
        striker = striker_of(state.estimator)
        estimate = records.StrikerEstimate(striker.x_m, striker.v_m_s, state.crank.omega_rad_s)
        return packing.pack_striker_estimate(estimate, count)
    if frame == HEARTBEAT.value:
        return packing.pack_firmware_heartbeat(heartbeat_of(outputs), count)
    if frame == GAIT.value:
        return packing.pack_gait_report(gait_report_of(state), count)
    return NO_FRAME, False


def next_frame(
    config: Config, now: Transmitter, tick: int, state: State, outputs: Outputs
) -> tuple[Transmitter, WordFrame]:
    """Remove the first waiting frame, which is sent in `tick`; `NO_FRAME` if it cannot be encoded."""
    frame = first_waiting(now.waiting)
    # Faults and refusals share an identifier, and so a counter.
    lowest_bit = 4 * (FAULT.value if frame == REFUSAL.value else frame)
    count = now.counts >> lowest_bit & 15
    packed, sendable = pack(config, now, frame, tick, state, outputs, count=count)
    counts = now.counts & ~(15 << lowest_bit) | (count + 1 & 15) << lowest_bit
    now = now._replace(counts=counts, waiting=now.waiting & ~(1 << frame))
    return now, packed if sendable else NO_FRAME
