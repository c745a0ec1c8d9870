"""Receiving: frames to the newest reading of each source with its age.

Frames that fail their CRC, length or ranges, and those that repeat the counter of the one before, are dropped
and counted; their source then simply grows older. A gap in a counter is counted, and the frame used. After a
silence in which the counter may have turned once round, the same number again is no repetition.
"""

from typing import TypeVar

from firmware_py.interface import packing
from firmware_py.interface.errors import FrameErrorReason
from firmware_py.interface.frame import WordFrame
from firmware_py.node.counters import Counters, also_counted, counted, refused
from firmware_py.node.readings import NEVER, Heard, Received

Item = TypeVar("Item")

LONGEST_DATED_TICKS = (1 << packing.ACCELEROMETER_COUNTER_BITS) - 2
"""Since the last sample: for as long a sample's counter says when it was sent, give or take a tick."""

REQUESTS = 4
"""Parameter requests that wait for their answers at most; a client waits for one before it asks again."""


def taken(
    heard: Heard,
    counters: Counters,
    tick: int,
    reason: FrameErrorReason,
    counter: int,
    counter_bits: int,
    period_ticks: float,
) -> tuple[Heard, Counters, bool]:
    """Judge one frame of a source: `(received, counters, usable)`. Without a counter, `counter_bits` is 0."""
    if reason != FrameErrorReason.NONE:
        return heard, refused(counters, reason), False
    if counter_bits == 0:
        return Heard(tick, tick, -1), counted(counters, False, False), True
    modulus = 1 << counter_bits
    # A period early, as frames jitter: then the counter may be where it was.
    turn_ticks = (modulus - 1) * max(period_ticks, 1.0)
    if counter == heard.counter and tick - heard.counted_tick < turn_ticks:
        return Heard(heard.tick, tick, counter), counted(counters, True, False), False
    gap = heard.counter >= 0 and counter != (heard.counter + 1) % modulus
    return Heard(tick, tick, counter), counted(counters, False, gap), True


def counter_of(length: int, word: int, counter_bits: int) -> int:
    """The rolling counter: the bits that end where the last byte, the CRC, begins."""
    return word >> 8 * (length - 1) - counter_bits & (1 << counter_bits) - 1


def with_one(waiting: tuple[Item, Item, Item, Item], count: int, one: Item) -> tuple[Item, Item, Item, Item]:
    """Four places with `one` at place `count` < 4."""
    first, second, third, fourth = waiting
    if count == 0:
        return (one, second, third, fourth)
    if count == 1:
        return (first, one, third, fourth)
    if count == 2:
        return (first, second, one, fourth)
    return (first, second, third, one)


def receive(  # noqa: PLR0912, PLR0915 - a table of identifiers, the most frequent first
    tick_s: float, received: Received, counters: Counters, tick: int, frame: WordFrame
) -> tuple[Received, Counters]:
    """Take one frame that arrived before tick number `tick`; other identifiers are passed over."""
    can_id, length, word = frame
    (
        acceleration,
        acceleration_heard,
        encoder,
        encoder_heard,
        heartbeat,
        heartbeat_heard,
        disarm_reason,
        disarm_reason_heard,
        current_a,
        current_heard,
        temperature,
        temperature_heard,
        voltage_v,
        voltage_heard,
        estop_tick,
        command,
        command_heard,
        coarse,
        coarse_heard,
        gait,
        gait_heard,
        requests,
        request_count,
        request_heard,
    ) = received
    if can_id == packing.ACCELEROMETER_ID:
        sample, reason = packing.unpack_accelerometer(length, word)
        bits = packing.ACCELEROMETER_COUNTER_BITS
        counter = counter_of(packing.ACCELEROMETER_LENGTH, word, bits)
        period = packing.ACCELEROMETER_PERIOD_S / tick_s
        acceleration_heard, counters, usable = taken(
            acceleration_heard, counters, tick, reason, counter, bits, period
        )
        acceleration = sample if usable else acceleration
    elif can_id == packing.ENCODER_ESTIMATES_ID:
        estimates, reason = packing.unpack_encoder_estimates(length, word)
        encoder_heard, counters, usable = taken(encoder_heard, counters, tick, reason, 0, 0, 0.0)
        encoder = estimates if usable else encoder
    elif can_id == packing.DRIVE_CURRENT_ID:
        current, reason = packing.unpack_drive_current(length, word)
        current_heard, counters, usable = taken(current_heard, counters, tick, reason, 0, 0, 0.0)
        current_a = current.measured_a if usable else current_a
    elif can_id == packing.GAIT_SENSORS_ID:
        leg, reason = packing.unpack_gait_sensors(length, word)
        bits = packing.GAIT_SENSORS_COUNTER_BITS
        counter = counter_of(packing.GAIT_SENSORS_LENGTH, word, bits)
        period = packing.GAIT_SENSORS_PERIOD_S / tick_s
        gait_heard, counters, usable = taken(gait_heard, counters, tick, reason, counter, bits, period)
        gait = leg if usable else gait
    elif can_id == packing.COARSE_POSITION_ID:
        position, reason = packing.unpack_coarse_position(length, word)
        bits = packing.COARSE_POSITION_COUNTER_BITS
        counter = counter_of(packing.COARSE_POSITION_LENGTH, word, bits)
        period = packing.COARSE_POSITION_PERIOD_S / tick_s
        coarse_heard, counters, usable = taken(coarse_heard, counters, tick, reason, counter, bits, period)
        coarse = position if usable else coarse
    elif can_id == packing.DRIVE_HEARTBEAT_ID:
        beat, reason = packing.unpack_drive_heartbeat(length, word)
        heartbeat_heard, counters, usable = taken(heartbeat_heard, counters, tick, reason, 0, 0, 0.0)
        heartbeat = beat if usable else heartbeat
    elif can_id == packing.DRIVE_ERRORS_ID:
        errors, reason = packing.unpack_drive_errors(length, word)
        disarm_reason_heard, counters, usable = taken(disarm_reason_heard, counters, tick, reason, 0, 0, 0.0)
        disarm_reason = errors.disarm_reason & errors.active_errors if usable else disarm_reason
    elif can_id == packing.DRIVE_TEMPERATURE_ID:
        warmth, reason = packing.unpack_drive_temperature(length, word)
        temperature_heard, counters, usable = taken(temperature_heard, counters, tick, reason, 0, 0, 0.0)
        temperature = warmth if usable else temperature
    elif can_id == packing.DRIVE_SUPPLY_ID:
        supply, reason = packing.unpack_drive_supply(length, word)
        voltage_heard, counters, usable = taken(voltage_heard, counters, tick, reason, 0, 0, 0.0)
        voltage_v = supply.voltage_v if usable else voltage_v
    elif can_id == packing.DRIVE_ESTOP_ID:
        _, reason = packing.unpack_drive_estop(length, word)
        _, counters, usable = taken(NEVER, counters, tick, reason, 0, 0, 0.0)
        estop_tick = tick if usable else estop_tick
    elif can_id == packing.OPERATOR_COMMAND_ID:
        wanted, reason = packing.unpack_operator_command(length, word)
        bits = packing.OPERATOR_COMMAND_COUNTER_BITS
        counter = counter_of(packing.OPERATOR_COMMAND_LENGTH, word, bits)
        period = packing.OPERATOR_COMMAND_PERIOD_S / tick_s
        command_heard, counters, usable = taken(command_heard, counters, tick, reason, counter, bits, period)
        command = wanted if usable else command
    elif can_id == packing.PARAMETER_REQUEST_ID:
        request, reason = packing.unpack_parameter_request(length, word)
        bits = packing.PARAMETER_REQUEST_COUNTER_BITS
        counter = counter_of(packing.PARAMETER_REQUEST_LENGTH, word, bits)
        request_heard, counters, usable = taken(request_heard, counters, tick, reason, counter, bits, 0.0)
        if usable and request_count < REQUESTS:
            requests = with_one(requests, request_count, request)
            request_count += 1
        elif usable:
            counters = also_counted(counters, 0, 1)
    taken_in = Received(
        acceleration,
        acceleration_heard,
        encoder,
        encoder_heard,
        heartbeat,
        heartbeat_heard,
        disarm_reason,
        disarm_reason_heard,
        current_a,
        current_heard,
        temperature,
        temperature_heard,
        voltage_v,
        voltage_heard,
        estop_tick,
        command,
        command_heard,
        coarse,
        coarse_heard,
        gait,
        gait_heard,
        requests,
        request_count,
        request_heard,
    )
    return taken_in, counters


def begins_sample(received: Received, tick: int, frame: WordFrame, first_id: int) -> bool:
    """Whether a frame of `tick` belongs to another sample than those received in it so far.

    A sample is an accelerometer frame and its encoder frame; the frame with `first_id` comes first.
    """
    can_id, length, word = frame
    if can_id != first_id or received.accelerometer_heard.tick != tick:
        return False
    bits = packing.ACCELEROMETER_COUNTER_BITS
    own = received.accelerometer_heard.counter
    return can_id != packing.ACCELEROMETER_ID or counter_of(length, word, bits) != own


def sampled_tick(before: Heard, received: Received) -> int:
    """When the newest sample was taken, by how far its counter has moved since that of `before`."""
    modulus = 1 << packing.ACCELEROMETER_COUNTER_BITS
    return before.tick + (received.accelerometer_heard.counter - before.counter) % modulus
