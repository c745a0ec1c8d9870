"""What can be wrong: a watchdog for each input, plausibility of the drive's data, limits on measured values.

Every limit is written so that a NaN counts as beyond it. A condition that may pass for a moment has to hold
for its time; the first fault found, in order of the list, is reported.
"""

import math
from typing import NamedTuple

from firmware_py.core.estimation.crank import CrankState
from firmware_py.core.estimation.estimator_state import EstimatorState
from firmware_py.core.inputs import Inputs
from firmware_py.core.numbers import TAU
from firmware_py.core.records import zeroed
from firmware_py.interface.enums import CLOSED_LOOP, MOVING, NO_FAULT, STOPPING, Fault, Mode

LONGEST_GAP_S = 0.010
"""Gaps in the samples up to this are ridden through, however many come; beyond, the speed loop swings."""
GAPS = 3
"""Longer ones in a row, with no `LONGEST_GAP_S` of samples between them: samples come in bundles."""

TURNING_RAD_S = 5.0
"""From here on the striker's acceleration changes by more than a count from one sample to the next."""


RUNAWAY_RAD_S = 5.0
"""Faster than its target by half the natural frequency; a lagging encoder costs 4 rad/s."""
RUNAWAY_S = 0.1

IMPLAUSIBLE_SHARE = 0.25
"""Of the greatest torque: 300 rad/s² with the default motor. A lagging encoder shows as much for 8 ms."""
IMPLAUSIBLE_S = 0.02

MOVES_AGAIN = 1.5
"""Over the limit of a standstill: noise, of which one count of the encoder makes a tenth, does not end it."""

STOP_MARGIN_S = 1.0
"""Beyond the time that a stop takes, for its standstill to be seen."""


class Watchdogs(NamedTuple):
    """The longest silence of each source, in ticks; of the gait's sensors 0 where nothing follows them."""

    sensor_ticks: int
    encoder_ticks: int
    drive_ticks: int
    operator_ticks: int
    frozen_ticks: int
    enable_ticks: int
    gait_ticks: int


class Limits(NamedTuple):
    """Two-sided where both sides can fail."""

    overspeed_rad_s: float
    current_a: float
    inverter_degc: float
    motor_degc: float
    lowest_degc: float
    lowest_v: float
    highest_v: float
    impulse_n_s: float
    peak_m_s2: float
    position_std_m: float
    stall_share: float
    disturbance_rad_s2: float


class MonitorConfig(NamedTuple):
    """`…_ticks`: how long a condition has to hold. `parameters_damaged`: these are none to move by.

    `takeover_rad_s`: no crank that has been faster within the last `takeover_ticks` is taken over.
    """

    watchdogs: Watchdogs
    limits: Limits
    overcurrent_ticks: int
    voltage_ticks: int
    estimate_ticks: int
    stall_ticks: int
    runaway_ticks: int
    implausible_ticks: int
    stop_ticks: int
    standstill_rad_s: float
    standstill_ticks: int
    takeover_rad_s: float
    takeover_ticks: int
    gap_ticks: int
    parameters_damaged: bool


class MonitorState(NamedTuple):
    """For how long each condition has held, in ticks; `freewheel_ticks`: until the crank may be taken over.

    `silent_ticks`: since the last sample; `gaps`: long ones, which count for another `unsteady_ticks`.
    """

    frozen_ticks: int
    overcurrent_ticks: int
    voltage_ticks: int
    estimate_ticks: int
    stall_ticks: int
    runaway_ticks: int
    implausible_ticks: int
    stopping_ticks: int
    standstill_ticks: int
    enable_ticks: int
    enabled: bool
    position_rev: float
    stuck_ticks: int
    low_m_s2: float
    freewheel_ticks: int
    silent_ticks: int
    unsteady_ticks: int
    gaps: int


class Findings(NamedTuple):
    """What the supervisor decides on. `watchdog` and `limit` hold the first fault of their kind, or NONE.

    `freewheel_overspeed`: the crank turns, or has just turned, too fast to be taken over.
    """

    watchdog: Fault
    limit: Fault
    drive: Fault
    operator_lost: bool
    standstill: bool
    parameters_damaged: bool
    overspeed: bool
    freewheel_overspeed: bool


INITIAL = zeroed(MonitorState)


def watchdog_fault(
    config: Watchdogs, state: MonitorState, inputs: Inputs, crank: CrankState, estimate: EstimatorState
) -> Fault:
    """The first source that has been silent, sent no numbers, or but one again and again, for too long."""
    if (
        inputs.accelerometer.age_ticks > config.sensor_ticks
        or estimate.sensor.missed_ticks > config.sensor_ticks
        or state.stuck_ticks > config.sensor_ticks
    ):
        return Fault.SENSOR_TIMEOUT
    if config.gait_ticks > 0 and inputs.gait.age_ticks > config.gait_ticks:
        return Fault.SENSOR_TIMEOUT
    if inputs.encoder.age_ticks > config.encoder_ticks or crank.missed_ticks > config.encoder_ticks:
        return Fault.ENCODER_TIMEOUT
    if inputs.drive.age_ticks > config.drive_ticks or inputs.power.age_ticks > config.drive_ticks:
        return Fault.DRIVE_TIMEOUT
    if state.gaps >= GAPS:
        return Fault.STALE_SAMPLES
    return NO_FAULT


def is_overspeed(limits: Limits, inputs: Inputs, crank: CrankState) -> bool:
    """Whether the crank turns too fast, or the drive says so by far."""
    return not (
        abs(crank.omega_rad_s) <= limits.overspeed_rad_s
        and abs(TAU * inputs.encoder.velocity_rev_s) <= 1.5 * limits.overspeed_rad_s
    )


def limit_fault(  # noqa: PLR0911 - a table, read top to bottom
    config: MonitorConfig,
    state: MonitorState,
    inputs: Inputs,
    impulse_n_s: float,
    peak_m_s2: float,
) -> Fault:
    """The first measured quantity beyond its limit."""
    limits = config.limits
    power = inputs.power
    if state.frozen_ticks > config.watchdogs.frozen_ticks:
        return Fault.DRIVE_FROZEN
    if state.overcurrent_ticks > config.overcurrent_ticks:
        return Fault.OVERCURRENT
    if not (
        limits.lowest_degc <= power.inverter_degc <= limits.inverter_degc
        and limits.lowest_degc <= power.motor_degc <= limits.motor_degc
    ):
        return Fault.OVERTEMPERATURE
    if state.voltage_ticks > config.voltage_ticks:
        return Fault.OVERVOLTAGE if power.voltage_v > limits.highest_v else Fault.UNDERVOLTAGE
    if not impulse_n_s <= limits.impulse_n_s:
        return Fault.IMPULSE_LIMIT
    if not peak_m_s2 <= limits.peak_m_s2:
        return Fault.FORCE_LIMIT
    if state.estimate_ticks > config.estimate_ticks:
        return Fault.ESTIMATE_INVALID
    if state.implausible_ticks > config.implausible_ticks:
        return Fault.LOAD_IMPLAUSIBLE
    if state.runaway_ticks > config.runaway_ticks:
        return Fault.RUNAWAY
    if state.stall_ticks > config.stall_ticks:
        return Fault.STALL
    if state.stopping_ticks > config.stop_ticks:
        return Fault.STOP_FAILED
    return NO_FAULT


def drive_fault(config: Watchdogs, state: MonitorState, inputs: Inputs) -> Fault:
    """Whether the drive reports an error, neither closes nor opens its axis, or has disarmed itself."""
    if inputs.drive.axis_error != 0:
        return Fault.DRIVE_ERROR
    if state.enabled and inputs.drive.axis_state != CLOSED_LOOP:
        return Fault.DRIVE_ERROR
    if state.enable_ticks > config.enable_ticks:
        return Fault.DRIVE_ERROR
    return NO_FAULT


def step(
    config: MonitorConfig,
    state: MonitorState,
    mode: Mode,
    inputs: Inputs,
    crank: CrankState,
    estimate: EstimatorState,
    impulse_n_s: float,
    peak_m_s2: float,
    target_omega_rad_s: float,
    load_known: bool,
) -> tuple[MonitorState, Findings]:
    """One tick; `mode` and `target_omega_rad_s` are those of the tick before.

    `impulse_n_s` and `peak_m_s2` are of the impact that has just ended, 0 if none has.
    `load_known`: the estimate gives the spring a stretch that a striker can give it.
    """
    n = inputs.elapsed_ticks
    limits = config.limits
    power = inputs.power
    encoder = inputs.encoder
    moving = mode in MOVING
    closed = inputs.drive.axis_state == CLOSED_LOOP
    # Frozen: the drive goes on reporting a speed, but the position does not move with it.
    frozen = encoder.position_rev == state.position_rev and abs(TAU * encoder.velocity_rev_s) > 0.5
    frozen_ticks = state.frozen_ticks
    if encoder.age_ticks == 0:
        frozen_ticks = frozen_ticks + n if frozen else 0
    # Stuck: no accelerometer reads the same to the last count while the crank shakes the striker.
    low_m_s2 = inputs.accelerometer.low_m_s2
    stuck = low_m_s2 == state.low_m_s2 and abs(crank.omega_rad_s) > TURNING_RAD_S
    stuck_ticks = state.stuck_ticks
    if inputs.accelerometer.age_ticks == 0:
        stuck_ticks = stuck_ticks + n if stuck else 0
    invalid = not (
        estimate.started
        and abs(estimate.x_m) < 10.0
        and math.isfinite(estimate.v_m_s)
        and 0.0 < estimate.p_xx <= limits.position_std_m * limits.position_std_m
    )
    stalled = target_omega_rad_s > 1.0 and not crank.omega_rad_s > limits.stall_share * target_omega_rad_s
    runs_away = not crank.omega_rad_s <= target_omega_rad_s + RUNAWAY_RAD_S
    implausible = load_known and not abs(crank.disturbance_rad_s2) <= limits.disturbance_rad_s2
    strong = not abs(power.current_a) <= limits.current_a
    odd_voltage = not limits.lowest_v <= power.voltage_v <= limits.highest_v
    still_rad_s = config.standstill_rad_s * (MOVES_AGAIN if state.standstill_ticks > 0 else 1.0)
    standing = abs(crank.omega_rad_s) < still_rad_s
    refused = (moving and not closed and not state.enabled) or (closed and not moving)
    too_fast = not abs(crank.omega_rad_s) <= config.takeover_rad_s
    silent_ticks = max(inputs.accelerometer.age_ticks, encoder.age_ticks)
    unsteady_ticks, gaps = state.unsteady_ticks, state.gaps
    if silent_ticks == 0 and state.silent_ticks >= config.gap_ticks:
        unsteady_ticks, gaps = config.gap_ticks, min(gaps + 1, GAPS)
    elif silent_ticks == 0:
        unsteady_ticks = max(unsteady_ticks - n, 0)
        gaps = gaps if unsteady_ticks > 0 else 0
    new = MonitorState(
        frozen_ticks,
        state.overcurrent_ticks + n if strong else 0,
        state.voltage_ticks + n if odd_voltage else 0,
        state.estimate_ticks + n if moving and invalid else 0,
        state.stall_ticks + n if moving and closed and stalled else 0,
        state.runaway_ticks + n if moving and closed and runs_away else 0,
        state.implausible_ticks + n if moving and closed and implausible else 0,
        state.stopping_ticks + n if mode == STOPPING else 0,
        state.standstill_ticks + n if standing else 0,
        state.enable_ticks + n if refused else 0,
        moving and (state.enabled or closed),
        encoder.position_rev,
        stuck_ticks,
        low_m_s2,
        config.takeover_ticks if too_fast else max(state.freewheel_ticks - n, 0),
        silent_ticks,
        unsteady_ticks,
        gaps,
    )
    watchdog = watchdog_fault(config.watchdogs, new, inputs, crank, estimate)
    limit = limit_fault(config, new, inputs, impulse_n_s, peak_m_s2)
    drive = drive_fault(config.watchdogs, new, inputs)
    return new, Findings(
        watchdog,
        limit,
        drive,
        inputs.operator.age_ticks > config.watchdogs.operator_ticks,
        new.standstill_ticks > config.standstill_ticks,
        config.parameters_damaged,
        is_overspeed(limits, inputs, crank),
        too_fast or new.freewheel_ticks > 0,
    )
