"""The monitors beside the gate: faults that need an estimate, the target or the mode.

The gate judges the raw inputs; its findings pass through here to the supervisor. A monitor is a condition
(`count_conditions`), the longest time for which it may hold (`Constants.longest`) and a fault
(`FAULTS`). If several faults are found, the first in this order is reported. Every condition is written so
that NaN fulfils it.
"""

import math
from typing import NamedTuple

from firmware_py.core.estimation.crank import CrankState
from firmware_py.core.estimation.estimator_state import StrikerMotion
from firmware_py.core.numbers import in_ticks
from firmware_py.core.safety.gate import Findings
from firmware_py.core.safety.gate_limits import GateLimits
from firmware_py.interface.enums import AxisState, Fault, Mode
from firmware_py.interface.generated.parameters import Limit, Parameters
from firmware_py.interface.modes import MODES, Target
from firmware_py.interface.zeroed import zeroed

RUNAWAY_RAD_S = 5.0
"""Speed above the target that is a runaway: half the natural frequency; a lagging encoder causes 4 rad/s."""
RUNAWAY_S = 0.1

IMPLAUSIBLE_SHARE = 0.25
"""Share of the torque limit, as torque on the crank: 0.15 N m with the default motor, which a lagging encoder
seems to cause for 8 ms."""
IMPLAUSIBLE_S = 0.02

SLOWEST_RAD_S = 1.0
"""STALL judges only faster targets: the ripple of a slower crank may exceed its speed."""

MOVES_AGAIN = 1.5
"""Factor on the limit above which a standstill ends: noise, a tenth of it for an encoder count, does not."""

TAKEOVER_SHARE = 0.75
"""Share of `limit.speed_rad_s` above which a free crank is too fast for a start: a swing that grows
seldom reaches the overspeed before the drive has closed its axis."""

STOP_MARGIN_S = 1.0
"""Time after the longest stop in which the standstill must be detected."""


class MonitorTicks(NamedTuple):
    """A duration of each monitor's condition, named as its fault, in the order of their reports."""

    impulse_limit: int
    estimate_invalid: int
    load_implausible: int
    runaway: int
    stall: int
    stop_failed: int


class Constants(NamedTuple):
    """`longest`: the longest time for which each condition may hold. `…_ticks`: other durations.

    `implausible_rad_s2`: limit on the crank's unexplained acceleration.
    """

    longest: MonitorTicks
    implausible_rad_s2: float
    sensor_ticks: int
    encoder_ticks: int
    enable_ticks: int
    standstill_ticks: int
    takeover_ticks: int


def derive(p: Parameters, limits: GateLimits) -> Constants:
    """The constants of these parameters, without `longest.stop_failed`, which `retune` computes."""
    tick_s = limits.tick_s
    return Constants(
        longest=MonitorTicks(
            impulse_limit=0,
            estimate_invalid=in_ticks(p.limit.estimate_s, tick_s),
            load_implausible=in_ticks(IMPLAUSIBLE_S, tick_s),
            runaway=in_ticks(RUNAWAY_S, tick_s),
            stall=in_ticks(p.limit.stall_s, tick_s),
            stop_failed=0,
        ),
        implausible_rad_s2=IMPLAUSIBLE_SHARE * p.speed.torque_limit_n_m / p.motor.inertia_kg_m2,
        sensor_ticks=limits.sensor_ticks,
        encoder_ticks=limits.encoder_ticks,
        enable_ticks=in_ticks(p.watchdog.enable_s, tick_s),
        standstill_ticks=in_ticks(p.limit.standstill_s, tick_s),
        takeover_ticks=in_ticks(p.limit.takeover_s, tick_s, 1),
    )


def retune(own: Constants, p: Parameters, spin_down_s: float) -> Constants:
    """The constants for other tuning parameters; `spin_down_s`: the longest braking."""
    longest_s = max(p.start.stop_s, spin_down_s) + STOP_MARGIN_S
    stop_ticks = in_ticks(longest_s, p.control.tick_s)
    return own._replace(longest=own.longest._replace(stop_failed=stop_ticks))


FAULTS = tuple(Fault[name.upper()] for name in MonitorTicks._fields)
"""The fault of each monitor, if its condition lasts longer than `Constants.longest`."""


class Watched(NamedTuple):
    """What the monitors watch in a tick. `mode` and `target_omega_rad_s`: of the previous tick.

    `crank`: the monitors' own (`own_crank`). `impulse_n_s` belongs to an impact that has ended in this tick;
    0 if there is none.
    """

    mode: Mode
    axis_state: AxisState
    crank: CrankState
    striker: StrikerMotion
    impulse_n_s: float
    target_omega_rad_s: float


class MonitorState(NamedTuple):
    """`held`: the duration of each monitor's condition; `…_ticks`: of the other conditions.

    `enabled`: the drive has closed its axis for this motion. `freewheel_ticks`: time until a start may take
    over the crank, which is, or was a moment ago, too fast for it.
    """

    held: MonitorTicks
    standstill_ticks: int
    enable_ticks: int
    enabled: bool
    freewheel_ticks: int


INITIAL = zeroed(MonitorState)


def find_watchdog_fault(own: Constants, crank: CrankState, striker: StrikerMotion) -> Fault:
    """The fault of the first observer that has had no usable reading for too long, or NONE."""
    if striker.silent_ticks > own.sensor_ticks:
        return Fault.SENSOR_TIMEOUT
    return Fault.ENCODER_TIMEOUT if crank.missed_ticks > own.encoder_ticks else Fault.NONE


def count(ticks: int, condition: bool) -> int:
    """The duration of a condition after this tick."""
    return ticks + 1 if condition else 0


def is_invalid(limit: Limit, striker: StrikerMotion) -> bool:
    """Whether the estimate is missing, far outside the module, or too uncertain."""
    largest_std_m = limit.position_std_m
    return not (
        striker.started
        and abs(striker.x_m) < 10.0
        and math.isfinite(striker.v_m_s)
        and 0.0 < striker.variance_m2 <= largest_std_m * largest_std_m
    )


def count_conditions(own: Constants, limit: Limit, held: MonitorTicks, now: Watched) -> MonitorTicks:
    """The condition of each monitor: the duration of each after this tick."""
    moving, stops = MODES[now.mode.value].moving, MODES[now.mode.value].target == Target.STOP
    driven = moving and now.axis_state == AxisState.CLOSED_LOOP_CONTROL
    target_rad_s, omega_rad_s = now.target_omega_rad_s, now.crank.omega_rad_s
    disturbed = not abs(now.crank.disturbance_rad_s2) <= own.implausible_rad_s2
    stalled = target_rad_s > SLOWEST_RAD_S and not omega_rad_s > limit.stall_share * target_rad_s
    return MonitorTicks(
        impulse_limit=count(held.impulse_limit, not now.impulse_n_s <= limit.impulse_n_s),
        estimate_invalid=count(held.estimate_invalid, moving and is_invalid(limit, now.striker)),
        load_implausible=count(held.load_implausible, driven and disturbed),
        runaway=count(held.runaway, driven and not omega_rad_s <= target_rad_s + RUNAWAY_RAD_S),
        stall=count(held.stall, driven and stalled),
        stop_failed=count(held.stop_failed, stops),
    )


def find_first_fault(own: Constants, held: MonitorTicks) -> Fault:
    """The fault of the first monitor whose condition has lasted too long, or NONE."""
    for index in range(len(FAULTS)):
        if held[index] > own.longest[index]:
            return FAULTS[index]
    return Fault.NONE


def is_disobeyed(own: Constants, state: MonitorState, axis_state: AxisState) -> bool:
    """Whether the drive does not close or open its axis in time, or has opened it by itself."""
    has_left = state.enabled and axis_state != AxisState.CLOSED_LOOP_CONTROL
    return has_left or state.enable_ticks > own.enable_ticks


def stands_still(own: Constants, state: MonitorState) -> bool:
    """Whether the crank has been at rest for long enough to end a stop."""
    return state.standstill_ticks > own.standstill_ticks


def step(
    own: Constants, limits: Limit, state: MonitorState, found: Findings, now: Watched
) -> tuple[MonitorState, Findings]:
    """One tick; `found`: the gate's findings, which precede those of the monitors."""
    omega_rad_s = now.crank.omega_rad_s
    moving, closed = MODES[now.mode.value].moving, now.axis_state == AxisState.CLOSED_LOOP_CONTROL
    still_rad_s = limits.standstill_rad_s * (MOVES_AGAIN if state.standstill_ticks > 0 else 1.0)
    disagrees = (moving and not closed and not state.enabled) or (closed and not moving)
    too_fast = not abs(omega_rad_s) <= TAKEOVER_SHARE * limits.speed_rad_s
    state = MonitorState(
        held=count_conditions(own, limits, state.held, now),
        standstill_ticks=count(state.standstill_ticks, abs(omega_rad_s) < still_rad_s),
        enable_ticks=count(state.enable_ticks, disagrees),
        enabled=moving and (state.enabled or closed),
        freewheel_ticks=own.takeover_ticks if too_fast else max(state.freewheel_ticks - 1, 0),
    )
    watchdog, limit, drive = found.watchdog, found.limit, found.drive
    if watchdog == Fault.NONE:
        watchdog = find_watchdog_fault(own, now.crank, now.striker)
    if limit == Fault.NONE:
        limit = find_first_fault(own, state.held)
    if drive == Fault.NONE and is_disobeyed(own, state, now.axis_state):
        drive = Fault.DRIVE_ERROR
    overspeed = found.overspeed or not abs(omega_rad_s) <= limits.overspeed_rad_s
    return state, found._replace(watchdog=watchdog, limit=limit, drive=drive, overspeed=overspeed)
