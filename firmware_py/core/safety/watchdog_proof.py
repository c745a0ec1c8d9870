"""The test of the drive's command watchdog: the drive must disarm soon after its last frame.

    step(own, state, mode, drive, axis_is_closed, axis_is_idle, omega_rad_s) -> state

docs/safety.md rests on a watchdog that an ODrive ships disabled. The operator requests the test in READY,
with the crank at rest. It has three stages in the mode PROOF, all at zero torque:

1. CLOSE: the axis is closed as for a start. The interval between two heartbeats is measured.
2. WITHHOLD: no frame is sent to the drive, because a real ODrive's watchdog is fed by every frame. The stage
   begins so that a heartbeat is due `WATCHDOG_S` and two ticks after the last frame. The first heartbeat
   from then on, which may be late (`longest_delay_ticks`), or an earlier one must report an idle axis and the
   error WATCHDOG_TIMER_EXPIRED.
3. CLEAR: the axis is opened and its error cleared, until a heartbeat reports an idle axis without an error.

The test has failed if a stage ends otherwise, if the test lasts longer than `LONGEST_S`, or if the crank
turns. A passed test counts until heartbeats are missing: a drive that restarts may be configured otherwise.
"""

from enum import IntEnum
from typing import NamedTuple

from firmware_py.core.inputs import DriveInput
from firmware_py.core.numbers import in_ticks
from firmware_py.core.safety.gate_limits import GateLimits
from firmware_py.interface.enums import AxisError, AxisState, Mode
from firmware_py.interface.generated.parameters import Parameters
from firmware_py.interface.zeroed import zeroed

WATCHDOG_S = 0.050
"""The drive's watchdog, a setting of the drive."""

LONGEST_S = 2.0
"""Longest test: 40 ms of settings, four heartbeats and the watchdog take half a second."""

STILL_RAD_S = 1.0
"""A faster crank ends the test: the drive gives torque, or the crank is turned from outside."""

WATCHDOG_TIMER_EXPIRED = AxisError.WATCHDOG_TIMER_EXPIRED.value


class Constants(NamedTuple):
    """`is_required`: no start before the test has passed. `due_ticks`: the watchdog and two ticks.

    `longest_ticks`: of the test. `silent_ticks`: how long the drive may be silent.
    """

    is_required: bool
    due_ticks: int
    longest_ticks: int
    silent_ticks: int


def derive(p: Parameters, limits: GateLimits) -> Constants:
    """The constants of these parameters."""
    return Constants(
        is_required=p.watchdog.proof_required > 0,
        due_ticks=in_ticks(WATCHDOG_S, limits.tick_s) + 2,
        longest_ticks=in_ticks(LONGEST_S, limits.tick_s),
        silent_ticks=limits.drive_ticks,
    )


class ProofStage(IntEnum):
    """The stage of the test; REST outside the mode PROOF."""

    REST = 0
    CLOSE = 1
    WITHHOLD = 2
    CLEAR = 3


REST, CLOSE, WITHHOLD, CLEAR = ProofStage


class ProofState(NamedTuple):
    """`withheld_ticks`: time since the last frame to the drive. `beat_ticks`: time since the last heartbeat.

    `interval_ticks`: between the last two heartbeats. −1 and 0 before the first and the second heartbeat.
    """

    stage: ProofStage
    ticks: int
    withheld_ticks: int
    beat_ticks: int
    interval_ticks: int
    passed: bool
    failed: bool


INITIAL = zeroed(ProofState, stage=REST, beat_ticks=-1)


def may_start(own: Constants, state: ProofState) -> bool:
    """Whether the test has passed, or is not required."""
    return state.passed or not own.is_required


def tolerates(state: ProofState, drive: DriveInput) -> bool:
    """Whether the drive's only error is the one that the test provokes."""
    return state.stage in (WITHHOLD, CLEAR) and drive.axis_error == WATCHDOG_TIMER_EXPIRED


def judge_heartbeat(own: Constants, state: ProofState, drive: DriveInput) -> ProofState:
    """The state after a tick of WITHHOLD, by the heartbeat of this tick."""
    due_ticks = own.due_ticks
    is_late = state.withheld_ticks > due_ticks + longest_delay_ticks(due_ticks - 1, state.interval_ticks)
    if drive.age_ticks == 0:
        is_disarmed = drive.axis_state == AxisState.IDLE and drive.axis_error == WATCHDOG_TIMER_EXPIRED
        if is_disarmed and not is_late:
            return state._replace(stage=CLEAR)
        # Before the watchdog is due, a closed axis is no failure.
        is_closed = drive.axis_state == AxisState.CLOSED_LOOP_CONTROL
        is_early = is_closed and state.withheld_ticks < due_ticks
        return state if is_early else state._replace(failed=True)
    return state._replace(failed=is_late)


def longest_delay_ticks(wait_ticks: int, interval_ticks: int) -> int:
    """The longest delay of a heartbeat that is due `wait_ticks` after the first frame was withheld.

    Each heartbeat may be a tick late, so that an interval differs from the measured one by a tick. These
    differences add up, but a heartbeat never comes later than an interval and a tick after it was due.

    >>> [longest_delay_ticks(51, interval_ticks) for interval_ticks in (5, 10, 50, 100)]
    [6, 7, 3, 2]
    """
    intervals = (wait_ticks + interval_ticks - 1) // max(interval_ticks, 1)
    return 1 + min(intervals, interval_ticks)


def wait_ticks(due_ticks: int, interval_ticks: int) -> int:
    """The time from a heartbeat after which `due_ticks` end with another heartbeat.

    >>> wait_ticks(250, 100)
    50
    """
    wait = interval_ticks - due_ticks
    while wait < 0:
        wait += interval_ticks
    return wait


def step(  # noqa: PLR0911 - stages, read top to bottom
    own: Constants,
    state: ProofState,
    mode: Mode,
    drive: DriveInput,
    axis_is_closed: bool,
    axis_is_idle: bool,
    omega_rad_s: float,
) -> ProofState:
    """One tick. `mode`: after this tick's transition. The axis: as confirmed up to the previous tick.

    In PROOF, an axis in CLEAR that is idle and without an error has passed the test.
    """
    if mode != Mode.PROOF:
        passed = state.passed and drive.age_ticks <= own.silent_ticks
        return INITIAL._replace(passed=passed)
    if state.stage == REST:
        return INITIAL._replace(stage=CLOSE)
    interval_ticks = state.interval_ticks
    beat_ticks = state.beat_ticks + 1 if state.beat_ticks >= 0 else -1
    if drive.age_ticks == 0:
        interval_ticks = max(beat_ticks, 0)
        beat_ticks = 0
    now = state._replace(
        ticks=state.ticks + 1,
        withheld_ticks=state.withheld_ticks + 1 if state.stage == WITHHOLD else 0,
        beat_ticks=beat_ticks,
        interval_ticks=interval_ticks,
        passed=False,
    )
    turns = not abs(omega_rad_s) <= STILL_RAD_S
    if turns or now.ticks > own.longest_ticks:
        return now._replace(failed=True)
    if now.stage == CLOSE:
        # The first withheld tick is one tick after the last frame.
        if interval_ticks == 0 or not axis_is_closed:
            return now
        begins = beat_ticks == wait_ticks(own.due_ticks - 1, interval_ticks)
        return now._replace(stage=WITHHOLD, withheld_ticks=1) if begins else now
    if now.stage == WITHHOLD:
        return judge_heartbeat(own, now, drive)
    return now._replace(passed=axis_is_idle and drive.axis_error == 0)
