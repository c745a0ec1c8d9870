"""The gate: the last word on the torque, from raw inputs and a block of limits of its own.

    take(limits, state, sample, counter) -> state            once for each accelerometer frame that arrived
    judge(limits, state, inputs) -> (state, findings)        once a tick, before the supervisor
    permit(limits, state, findings, inputs, torque) -> (state, torque, limit)    last in the tick

The gate reads no estimate and imports neither the estimators nor the controllers. It integrates the impulse
of each contact from the high-range reading: in flight that reading is the pull of the spring and of friction
plus the sensor's offset, and changes slowly; at the stop it drops by the stop's force over the striker's
mass. Every reading counts, clipped ones included, and no time after an impact is blind.

Every limit is written so that NaN violates it. A finding while torque is proposed shuts the gate: the
permitted torque stays 0 until 0 is proposed and a heartbeat of that tick reports the axis idle.
"""

import math
from typing import NamedTuple

from firmware_py.core.inputs import EncoderInput, Inputs, PowerInput
from firmware_py.core.numbers import TAU, at_least, clamp, wrap_pi
from firmware_py.core.safety import liveness
from firmware_py.core.safety.gate_limits import GateLimits
from firmware_py.core.safety.liveness import LifeState
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import ActingLimit, AxisState, Fault
from firmware_py.interface.generated.records import Accelerometer
from firmware_py.interface.zeroed import zeroed

TOUCH_M_S2 = 12.0
"""Deviation from the reading in flight that begins a contact: twelve times the noise of 1 m/s²."""
END_M_S2 = 6.0
END_SHARE = 0.02
"""A contact ends where the deviation is below `END_M_S2` or this share of the contact's peak."""
SETTLING_READINGS = 8
"""Steady readings after which the flight is known. Before, no contact begins: an accelerometer that starts
with the firmware does not show yet how the striker swings, and the striker may be at the stop. The force
limit counts at once, from 0."""
LEAD_S = 0.0004
"""Time by which the deviation is extrapolated for the force limit: the low-pass lowers a short peak,
and the peak lies between two samples."""
AWAY_FACTOR = 2.0
"""Factor on both limits for a pull away from the stop: the stop only pushes, so this is a kick or a sensor
that is the wrong way round."""
LONGEST_BRIDGE_TICKS = 4
"""Up to 3 lost readings are bridged by a straight line; over a longer gap the line would invent an area."""
COUNTER_MODULUS = 256
LONGEST_LATE = 16
"""A missing frame up to this number behind the newest may come late; the line that bridged it stays."""
ALL_MISSING = (1 << LONGEST_LATE) - 1
LONGEST_COUNTED = 64
"""A larger difference of counters is a restarted sensor and counts as 1."""

FROZEN_RAD_S = 0.5
"""Reported speed above which the crank's position must change."""

LARGEST_REV = 1e6
"""A position beyond this is no position: a float32 does not resolve a turn there."""
DRIVES_OWN = 1.5
"""Factor on the speed limit for the drive's own estimate of the speed, which counts at once."""

GAPS = 3
"""Number of longer gaps, with less than `LONGEST_GAP_S` of samples between them, that is a fault."""


class ContactState(NamedTuple):
    """The contact so far. `flight_m_s2`: the reading in flight. `deviation_m_s2`: that minus the reading.
    `readings`: number of steady readings since the first one, up to `SETTLING_READINGS`.

    A positive deviation is a push of the stop. `change_m_s` is ∫deviation dt over the contact or, after a
    change of sign, since then. `fault`: a limit was violated since the last `judge`.
    """

    readings: int
    touching: bool
    ticks: int
    flight_m_s2: float
    deviation_m_s2: float
    peak_m_s2: float
    change_m_s: float
    fault: Fault


class GateState(NamedTuple):
    """Duration of each condition in ticks. `silent_ticks`: time since the last sample of both sources.

    `missing`: bit n is set if the frame n + 1 before the newest one, whose counter is `counter`, is missing.
    `gaps`: number of long gaps; it returns to 0 after `unsteady_ticks` of samples. `window_rev` and
    `window_ticks`: the position and the age of the beginning of the window for the crank's own speed.
    """

    contact: ContactState
    counter: int
    missing: int
    reading_ticks: int
    life: LifeState
    encoder_ticks: int
    position_rev: float
    frozen_ticks: int
    window_rev: float
    window_ticks: int
    own_rad_s: float
    overcurrent_ticks: int
    voltage_ticks: int
    silent_ticks: int
    unsteady_ticks: int
    gaps: int
    shut: bool


class Findings(NamedTuple):
    """`watchdog`, `limit` and `drive`: the first fault of each kind, or NONE; the monitors add to them.

    `touching`: the striker is at the stop.
    """

    watchdog: Fault
    limit: Fault
    drive: Fault
    operator_lost: bool
    overspeed: bool
    touching: bool


IN_FLIGHT = zeroed(ContactState, fault=Fault.NONE)
INITIAL = zeroed(
    GateState, contact=IN_FLIGHT, counter=-1, reading_ticks=NEVER_TICKS, encoder_ticks=NEVER_TICKS
)


def count_ticks(before: int, missing: int, counter: int) -> int:
    """Samples from the counter `before` (−1: none) to `counter`; 0 for a frame that is late.

    Late is one of those that were missing. Any other from behind is of a sensor that has restarted, or whose
    counter is wrong; it counts as 1, so that it hides no contact.
    """
    if before < 0:
        return 1
    ticks = (counter - before) % COUNTER_MODULUS
    behind = COUNTER_MODULUS - ticks
    if behind <= LONGEST_LATE and missing >> behind - 1 & 1 == 1:
        return 0
    return max(ticks, 1) if ticks <= LONGEST_COUNTED else 1


def find_missing(before: int, missing: int, counter: int, ticks: int) -> int:
    """The frames that are missing behind the newest after one that counts as `ticks` samples."""
    behind = (before - counter) % COUNTER_MODULUS
    if ticks == 0:
        return missing ^ 1 << behind - 1
    if before < 0 or behind != COUNTER_MODULUS - ticks:
        return 0
    if ticks > LONGEST_LATE:
        return ALL_MISSING
    return (missing << ticks | (1 << ticks - 1) - 1) & ALL_MISSING


def is_within(value: float, limit: float) -> bool:
    """Whether a deviation or its integral is within its limit, and away from the stop within twice of it."""
    return -AWAY_FACTOR * limit <= value <= limit


def in_flight(readings: int, flight_m_s2: float, deviation_m_s2: float, fault: Fault) -> ContactState:
    """The state after a reading without a contact."""
    return IN_FLIGHT._replace(
        readings=readings, flight_m_s2=flight_m_s2, deviation_m_s2=deviation_m_s2, fault=fault
    )


def exceeds_force(
    limits: GateLimits, state: ContactState, high_m_s2: float, deviation_m_s2: float, ticks: int, dt_s: float
) -> bool:
    """Whether a reading may be clipped, or violates the force limit now or `LEAD_S` ahead."""
    ahead_m_s2 = deviation_m_s2
    if ticks > 0:
        ahead_m_s2 += LEAD_S / dt_s * (deviation_m_s2 - state.deviation_m_s2)
    shown = abs(high_m_s2) <= limits.clipped_m_s2
    limit_m_s2 = limits.peak_m_s2
    return not (shown and is_within(deviation_m_s2, limit_m_s2) and is_within(ahead_m_s2, limit_m_s2))


def extend_contact(state: ContactState, deviation_m_s2: float, ticks: int, dt_s: float) -> ContactState:
    """The contact with one more reading; a reading of the other sign begins a new one."""
    turns = state.touching and deviation_m_s2 * state.change_m_s < 0.0 and abs(deviation_m_s2) > TOUCH_M_S2
    before = IN_FLIGHT if turns else state
    return state._replace(
        touching=True,
        ticks=before.ticks + ticks,
        deviation_m_s2=deviation_m_s2,
        peak_m_s2=at_least(abs(deviation_m_s2), before.peak_m_s2),
        change_m_s=before.change_m_s + 0.5 * (before.deviation_m_s2 + deviation_m_s2) * dt_s,
    )


def settle(
    limits: GateLimits, state: ContactState, high_m_s2: float, ticks: int, fault: Fault
) -> ContactState:
    """The state after one of the first readings.

    They end with `SETTLING_READINGS` in a row, of which none is a contact's jump away from the one before,
    and in any case after `LONGEST_CONTACT_S`.
    """
    steady, waited_ticks = abs(high_m_s2 - state.flight_m_s2) <= TOUCH_M_S2, state.ticks + ticks
    readings = state.readings + 1 if steady else 1
    if readings == SETTLING_READINGS or waited_ticks > limits.longest_contact_ticks:
        return in_flight(SETTLING_READINGS, high_m_s2, 0.0, fault)
    return in_flight(readings, high_m_s2, 0.0, fault)._replace(ticks=waited_ticks)


def integrate_reading(limits: GateLimits, state: ContactState, high_m_s2: float, ticks: int) -> ContactState:
    """The contact after one reading, `ticks` after the previous one; a late one (0) counts as force only."""
    settling = state.readings < SETTLING_READINGS
    flight_m_s2 = 0.0 if settling else state.flight_m_s2
    deviation_m_s2 = flight_m_s2 - high_m_s2
    dt_s = min(ticks, LONGEST_BRIDGE_TICKS) * limits.tick_s
    fault = state.fault
    if exceeds_force(limits, state, high_m_s2, deviation_m_s2, ticks, dt_s):
        fault = Fault.FORCE_LIMIT
    if ticks == 0 or not abs(deviation_m_s2) < math.inf:  # not a number: nothing can be integrated
        return state._replace(fault=fault)
    if settling:
        return settle(limits, state, high_m_s2, ticks, fault)
    if not state.touching and abs(deviation_m_s2) <= TOUCH_M_S2:
        flight_m_s2 -= clamp(deviation_m_s2, limits.flight_m_s3 * dt_s)
        return in_flight(state.readings, flight_m_s2, deviation_m_s2, fault)
    contact = extend_contact(state, deviation_m_s2, ticks, dt_s)
    too_long = contact.ticks > limits.longest_contact_ticks
    if fault == Fault.NONE and (too_long or not is_within(contact.change_m_s, limits.change_m_s)):
        fault = Fault.IMPULSE_LIMIT
    if too_long:
        return in_flight(state.readings, high_m_s2, 0.0, fault)
    if abs(deviation_m_s2) < at_least(END_SHARE * contact.peak_m_s2, END_M_S2):
        return in_flight(state.readings, flight_m_s2, deviation_m_s2, fault)
    return contact._replace(fault=fault)


def take(limits: GateLimits, state: GateState, sample: Accelerometer, counter: int) -> GateState:
    """The state after one accelerometer frame; the frames of a bundle one after the other."""
    ticks = count_ticks(state.counter, state.missing, counter)
    missing = find_missing(state.counter, state.missing, counter, ticks)
    contact = state.contact
    # After a silence that `judge` has found, nothing is known of the flight; before, the motor has a torque.
    if state.reading_ticks > limits.sensor_ticks + 1:
        ticks, missing, contact = 1, 0, IN_FLIGHT._replace(fault=contact.fault)
    contact = integrate_reading(limits, contact, sample.striker_high_m_s2, ticks)
    state = state._replace(contact=contact, missing=missing, reading_ticks=0)
    if ticks == 0:
        return state
    return state._replace(counter=counter, life=liveness.take(limits, state.life, sample))


def is_overspeed(limits: GateLimits, own_rad_s: float, velocity_rev_s: float) -> bool:
    """Whether the speed from the positions exceeds its limit, or the drive's own 1.5 times the limit."""
    return not (
        abs(own_rad_s) <= limits.overspeed_rad_s
        and abs(TAU * velocity_rev_s) <= DRIVES_OWN * limits.overspeed_rad_s
    )


def find_watchdog_fault(limits: GateLimits, state: GateState, inputs: Inputs) -> Fault:
    """The fault of the first source that is stale, not finite or repeating for too long, or NONE."""
    if (
        inputs.accelerometer.age_ticks > limits.sensor_ticks
        or state.reading_ticks > limits.sensor_ticks
        or not liveness.is_alive(limits, state.life)
    ):
        return Fault.SENSOR_TIMEOUT
    if limits.reads_gait and inputs.gait.age_ticks > limits.gait_ticks:
        return Fault.SENSOR_TIMEOUT
    if state.encoder_ticks > limits.encoder_ticks or inputs.encoder.age_ticks > limits.encoder_ticks:
        return Fault.ENCODER_TIMEOUT
    if inputs.drive.age_ticks > limits.drive_ticks or inputs.power.age_ticks > limits.drive_ticks:
        return Fault.DRIVE_TIMEOUT
    if state.gaps >= GAPS:
        return Fault.STALE_SAMPLES
    return Fault.NONE


def is_hot(limits: GateLimits, power: PowerInput) -> bool:
    """Whether inverter or motor is outside its temperatures."""
    return not (
        limits.lowest_degc <= power.inverter_degc <= limits.inverter_degc
        and limits.lowest_degc <= power.motor_degc <= limits.motor_degc
    )


def find_limit_fault(limits: GateLimits, state: GateState, power: PowerInput) -> Fault:
    """The fault of the first quantity beyond its limit, or NONE."""
    if state.frozen_ticks > limits.frozen_ticks:
        return Fault.DRIVE_FROZEN
    if state.overcurrent_ticks > limits.overcurrent_ticks:
        return Fault.OVERCURRENT
    if is_hot(limits, power):
        return Fault.OVERTEMPERATURE
    if state.voltage_ticks > limits.voltage_ticks:
        return Fault.OVERVOLTAGE if power.voltage_v > limits.highest_v else Fault.UNDERVOLTAGE
    return state.contact.fault


def watch_encoder(limits: GateLimits, state: GateState, encoder: EncoderInput) -> GateState:
    """The state after this tick's encoder reading, if there is a usable one.

    Its age, the time for which a drive has reported a speed at a position that does not change, and the
    crank's speed from its positions.
    """
    encoder_ticks, window_ticks = min(state.encoder_ticks + 1, NEVER_TICKS), state.window_ticks + 1
    frozen_ticks, window_rev, own_rad_s = state.frozen_ticks, state.window_rev, state.own_rad_s
    if encoder.age_ticks == 0 and abs(encoder.position_rev) < LARGEST_REV:
        encoder_ticks = 0
        still = encoder.position_rev == state.position_rev
        frozen = still and abs(TAU * encoder.velocity_rev_s) > FROZEN_RAD_S
        frozen_ticks = frozen_ticks + 1 if frozen else 0
        if state.encoder_ticks > limits.encoder_ticks:
            own_rad_s, window_rev, window_ticks = 0.0, encoder.position_rev, 0
        elif window_ticks >= limits.window_ticks:
            turned_rad = wrap_pi(TAU * (encoder.position_rev - window_rev))
            own_rad_s = turned_rad / (window_ticks * limits.tick_s)
            window_rev, window_ticks = encoder.position_rev, 0
    return state._replace(
        encoder_ticks=encoder_ticks,
        position_rev=encoder.position_rev,
        frozen_ticks=frozen_ticks,
        window_rev=window_rev,
        window_ticks=window_ticks,
        own_rad_s=own_rad_s,
    )


def count_gaps(limits: GateLimits, state: GateState, silent_ticks: int) -> GateState:
    """The state after a tick in which the older one of the two sources is this old."""
    unsteady_ticks, gaps = state.unsteady_ticks, state.gaps
    if silent_ticks == 0 and state.silent_ticks >= limits.gap_ticks:
        unsteady_ticks, gaps = limits.gap_ticks, min(gaps + 1, GAPS)
    elif silent_ticks == 0:
        unsteady_ticks = max(unsteady_ticks - 1, 0)
        gaps = gaps if unsteady_ticks > 0 else 0
    return state._replace(silent_ticks=silent_ticks, unsteady_ticks=unsteady_ticks, gaps=gaps)


def judge(limits: GateLimits, state: GateState, inputs: Inputs) -> tuple[GateState, Findings]:
    """One tick, after its readings have been taken."""
    power, encoder = inputs.power, inputs.encoder
    state = watch_encoder(limits, state, encoder)
    state = count_gaps(limits, state, max(inputs.accelerometer.age_ticks, encoder.age_ticks))
    strong = not abs(power.current_a) <= limits.current_a
    odd_voltage = not limits.lowest_v <= power.voltage_v <= limits.highest_v
    new = state._replace(
        overcurrent_ticks=state.overcurrent_ticks + 1 if strong else 0,
        voltage_ticks=state.voltage_ticks + 1 if odd_voltage else 0,
    )
    findings = Findings(
        find_watchdog_fault(limits, new, inputs),
        find_limit_fault(limits, new, power),
        Fault.DRIVE_ERROR if inputs.drive.axis_error != 0 else Fault.NONE,
        inputs.operator.age_ticks > limits.operator_ticks,
        is_overspeed(limits, new.own_rad_s, encoder.velocity_rev_s),
        new.contact.touching,
    )
    return new._replace(
        contact=state.contact._replace(fault=Fault.NONE),
        reading_ticks=min(state.reading_ticks + 1, NEVER_TICKS),
    ), findings


def permit(
    limits: GateLimits, state: GateState, findings: Findings, inputs: Inputs, torque_n_m: float
) -> tuple[GateState, float, ActingLimit]:
    """The permitted part of the proposed torque, and the gate's limit that acts on it, or NONE."""
    found = (
        findings.watchdog != Fault.NONE
        or findings.limit != Fault.NONE
        or findings.drive != Fault.NONE
        or findings.operator_lost
        or findings.overspeed
        or inputs.estop
    )
    proposed = torque_n_m != 0.0
    is_idle = inputs.drive.age_ticks == 0 and inputs.drive.axis_state == AxisState.IDLE
    shut = (state.shut and (proposed or not is_idle)) or (found and proposed)
    state = state._replace(shut=shut)
    if shut:
        return state, 0.0, ActingLimit.SAFE_STATE
    permitted_n_m = clamp(torque_n_m, limits.torque_n_m)
    rad_s = TAU * inputs.encoder.velocity_rev_s
    # The speed from the positions is up to two windows old. It judges a drive whose own speed is wrong; at
    # the same limit a speed that varies within a turn would cut the torque long after it has fallen again.
    own_rad_s, own_limit_rad_s = state.own_rad_s, 0.5 * (limits.speed_rad_s + limits.overspeed_rad_s)
    forward = permitted_n_m > 0.0 and not (rad_s <= limits.speed_rad_s and own_rad_s <= own_limit_rad_s)
    backward = permitted_n_m < 0.0 and not (rad_s >= -limits.speed_rad_s and own_rad_s >= -own_limit_rad_s)
    if forward or backward:
        return state, 0.0, ActingLimit.SPEED
    return state, permitted_n_m, ActingLimit.NONE if permitted_n_m == torque_n_m else ActingLimit.TORQUE
