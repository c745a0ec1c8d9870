"""Receiving: frames to the newest reading of each source with its age.

Frames that fail their CRC, length or ranges, and those that repeat the counter of the one before, are dropped
and counted; their source then simply grows older. A gap in a counter is counted, and the frame used. After a
silence in which the counter may have turned once round, the same number again is no repetition.
"""

from typing import TypeVar

from firmware_py.interface.errors import FrameErrorReason
from firmware_py.interface.frame import WordFrame
from firmware_py.interface.framing import FrameKind, counter_of
from firmware_py.interface.generated import kinds, unpacking
from firmware_py.node.counters import Counters, also_counted, counted, refused
from firmware_py.node.readings import NEVER, Heard, Received

Item = TypeVar("Item")

LONGEST_DATED_TICKS = (1 << kinds.ACCELEROMETER.counter_bits) - 2
"""Since the last sample: for as long a sample's counter says when it was sent, give or take a tick."""

REQUESTS = 4
"""Parameter requests that wait for their answers at most; a client waits for one before it asks again."""


def taken(
    heard: Heard,
    counters: Counters,
    tick: int,
    reason: FrameErrorReason,
    kind: FrameKind,
    word: int,
    tick_s: float,
) -> tuple[Heard, Counters, bool]:
    """Judge one frame of a source: `(received, counters, usable)`."""
    if reason != FrameErrorReason.NONE:
        return heard, refused(counters, reason), False
    if kind.counter_bits == 0:
        return Heard(tick, tick, -1), counted(counters, False, False), True
    counter, modulus = counter_of(kind, word), 1 << kind.counter_bits
    # A period early, as frames jitter: then the counter may be where it was.
    turn_ticks = (modulus - 1) * max(kind.period_s / tick_s, 1.0)
    if counter == heard.counter and tick - heard.counted_tick < turn_ticks:
        return Heard(heard.tick, tick, counter), counted(counters, True, False), False
    gap = heard.counter >= 0 and counter != (heard.counter + 1) % modulus
    return Heard(tick, tick, counter), counted(counters, False, gap), True


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
    if can_id == kinds.ACCELEROMETER.can_id:
        sample, reason = unpacking.unpack_accelerometer(length, word)
        acceleration_heard, counters, usable = taken(
            acceleration_heard, counters, tick, reason, kinds.ACCELEROMETER, word, tick_s
        )
        acceleration = sample if usable else acceleration
    elif can_id == kinds.ENCODER_ESTIMATES.can_id:
        estimates, reason = unpacking.unpack_encoder_estimates(length, word)
        encoder_heard, counters, usable = taken(
            encoder_heard, counters, tick, reason, kinds.ENCODER_ESTIMATES, word, tick_s
        )
        encoder = estimates if usable else encoder
    elif can_id == kinds.DRIVE_CURRENT.can_id:
        current, reason = unpacking.unpack_drive_current(length, word)
        current_heard, counters, usable = taken(
            current_heard, counters, tick, reason, kinds.DRIVE_CURRENT, word, tick_s
        )
        current_a = current.measured_a if usable else current_a
    elif can_id == kinds.GAIT_SENSORS.can_id:
        leg, reason = unpacking.unpack_gait_sensors(length, word)
        gait_heard, counters, usable = taken(
            gait_heard, counters, tick, reason, kinds.GAIT_SENSORS, word, tick_s
        )
        gait = leg if usable else gait
    elif can_id == kinds.COARSE_POSITION.can_id:
        position, reason = unpacking.unpack_coarse_position(length, word)
        coarse_heard, counters, usable = taken(
            coarse_heard, counters, tick, reason, kinds.COARSE_POSITION, word, tick_s
        )
        coarse = position if usable else coarse
    elif can_id == kinds.DRIVE_HEARTBEAT.can_id:
        beat, reason = unpacking.unpack_drive_heartbeat(length, word)
        heartbeat_heard, counters, usable = taken(
            heartbeat_heard, counters, tick, reason, kinds.DRIVE_HEARTBEAT, word, tick_s
        )
        heartbeat = beat if usable else heartbeat
    elif can_id == kinds.DRIVE_ERRORS.can_id:
        errors, reason = unpacking.unpack_drive_errors(length, word)
        disarm_reason_heard, counters, usable = taken(
            disarm_reason_heard, counters, tick, reason, kinds.DRIVE_ERRORS, word, tick_s
        )
        disarm_reason = errors.disarm_reason & errors.active_errors if usable else disarm_reason
    elif can_id == kinds.DRIVE_TEMPERATURE.can_id:
        warmth, reason = unpacking.unpack_drive_temperature(length, word)
        temperature_heard, counters, usable = taken(
            temperature_heard, counters, tick, reason, kinds.DRIVE_TEMPERATURE, word, tick_s
        )
        temperature = warmth if usable else temperature
    elif can_id == kinds.DRIVE_SUPPLY.can_id:
        supply, reason = unpacking.unpack_drive_supply(length, word)
        voltage_heard, counters, usable = taken(
            voltage_heard, counters, tick, reason, kinds.DRIVE_SUPPLY, word, tick_s
        )
        voltage_v = supply.voltage_v if usable else voltage_v
    elif can_id == kinds.DRIVE_ESTOP.can_id:
        _, reason = unpacking.unpack_drive_estop(length, word)
        _, counters, usable = taken(NEVER, counters, tick, reason, kinds.DRIVE_ESTOP, word, tick_s)
        estop_tick = tick if usable else estop_tick
    elif can_id == kinds.OPERATOR_COMMAND.can_id:
        wanted, reason = unpacking.unpack_operator_command(length, word)
        command_heard, counters, usable = taken(
            command_heard, counters, tick, reason, kinds.OPERATOR_COMMAND, word, tick_s
        )
        command = wanted if usable else command
    elif can_id == kinds.PARAMETER_REQUEST.can_id:
        request, reason = unpacking.unpack_parameter_request(length, word)
        request_heard, counters, usable = taken(
            request_heard, counters, tick, reason, kinds.PARAMETER_REQUEST, word, tick_s
        )
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
    if frame.can_id != first_id or received.accelerometer_heard.tick != tick:
        return False
    own = received.accelerometer_heard.counter
    return frame.can_id != kinds.ACCELEROMETER.can_id or counter_of(kinds.ACCELEROMETER, frame.word) != own


def sampled_tick(before: Heard, received: Received) -> int:
    """When the newest sample was taken, by how far its counter has moved since that of `before`."""
    modulus = 1 << kinds.ACCELEROMETER.counter_bits
    return before.tick + (received.accelerometer_heard.counter - before.counter) % modulus
