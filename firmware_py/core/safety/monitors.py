"""Fault detection: a watchdog for each input, plausibility of the drive's data, limits on measured values.

Every limit is written so that NaN violates it. A condition that may occur briefly without a fault must last
for its own duration; if several faults are found, the first in the order of the code is reported.
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
"""Longest gap in the samples that is tolerated any number of times; longer ones make the speed loop swing."""
GAPS = 3
"""Number of longer gaps, with less than `LONGEST_GAP_S` of samples between them, that is a fault."""

TURNING_RAD_S = 5.0
"""Crank speed above which two successive accelerometer samples differ by more than one count."""


RUNAWAY_RAD_S = 5.0
"""Speed above the target that is a runaway: half the natural frequency; a lagging encoder causes 4 rad/s."""
RUNAWAY_S = 0.1

IMPLAUSIBLE_SHARE = 0.25
"""Share of the torque limit: 300 rad/s² with the default motor. A lagging encoder causes that for 8 ms."""
IMPLAUSIBLE_S = 0.02

MOVES_AGAIN = 1.5
"""Factor on the limit above which a standstill ends: noise, a tenth of it for an encoder count, does not."""

STOP_MARGIN_S = 1.0
"""Time after the longest stop in which the standstill must be detected."""


class Watchdogs(NamedTuple):
    """Longest silence of each source, in ticks. `gait_ticks` is 0 if the crank does not follow the gait."""

    sensor_ticks: int
    encoder_ticks: int
    drive_ticks: int
    operator_ticks: int
    frozen_ticks: int
    enable_ticks: int
    gait_ticks: int


class Limits(NamedTuple):
    """Limits on measured and estimated quantities; two-sided where both sides can fail."""

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
    """`…_ticks`: duration before a condition counts. `parameters_damaged`: the firmware must not arm.

    `takeover_rad_s`: a start waits until the crank has been slower than this for `takeover_ticks`.
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
    """Duration of each condition, in ticks. `freewheel_ticks`: time until a start may take over the crank.

    `silent_ticks`: time since the last sample. `gaps`: number of long gaps; it returns to 0 after
    `unsteady_ticks` of samples.
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
    """The supervisor's inputs. `watchdog`, `limit` and `drive`: the first fault of each kind, or NONE.

    `freewheel_overspeed`: the crank is, or was a moment ago, too fast for a start to take it over.
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
    """The fault of the first source that is stale, not finite or repeating for too long, or NONE."""
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
    """Whether the estimated speed exceeds its limit, or the drive's own exceeds 1.5 times the limit."""
    return not (
        abs(crank.omega_rad_s) <= limits.overspeed_rad_s
        and abs(TAU * inputs.encoder.velocity_rev_s) <= 1.5 * limits.overspeed_rad_s
    )


def is_disturbed(limits: Limits, crank: CrankState) -> bool:
    """Whether the part of the crank's acceleration that the model does not explain exceeds its limit."""
    return not abs(crank.disturbance_rad_s2) <= limits.disturbance_rad_s2


def limit_fault(  # noqa: PLR0911 - a table, read top to bottom
    config: MonitorConfig,
    state: MonitorState,
    inputs: Inputs,
    impulse_n_s: float,
    peak_m_s2: float,
) -> Fault:
    """The fault of the first quantity beyond its limit, or NONE."""
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
    """DRIVE_ERROR if the drive reports an error, does not close or open its axis, or has disarmed itself."""
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
    implausible: bool,
) -> tuple[MonitorState, Findings]:
    """One tick. `mode` and `target_omega_rad_s` are those of the previous tick.

    `impulse_n_s` and `peak_m_s2` belong to an impact that has ended in this tick; 0 if there is none.
    `implausible`: neither the torque nor a known load explains the crank's acceleration.
    """
    n = inputs.elapsed_ticks
    limits = config.limits
    power = inputs.power
    encoder = inputs.encoder
    moving = mode in MOVING
    closed = inputs.drive.axis_state == CLOSED_LOOP
    # Frozen: the drive reports a speed, but its position does not change.
    frozen = encoder.position_rev == state.position_rev and abs(TAU * encoder.velocity_rev_s) > 0.5
    frozen_ticks = state.frozen_ticks
    if encoder.age_ticks == 0:
        frozen_ticks = frozen_ticks + n if frozen else 0
    # Stuck: while the crank shakes the striker, no working accelerometer repeats a reading to the last count.
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
