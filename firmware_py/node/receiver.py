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
    if can_id == kinds.ACCELEROMETER.can_id:
        sample, reason = unpacking.unpack_accelerometer(length, word)
        heard, counters, usable = taken(
            received.accelerometer_heard, counters, tick, reason, kinds.ACCELEROMETER, word, tick_s
        )
        received = received._replace(accelerometer_heard=heard)
        if usable:
            received = received._replace(accelerometer=sample)
    elif can_id == kinds.ENCODER_ESTIMATES.can_id:
        estimates, reason = unpacking.unpack_encoder_estimates(length, word)
        heard, counters, usable = taken(
            received.encoder_heard, counters, tick, reason, kinds.ENCODER_ESTIMATES, word, tick_s
        )
        received = received._replace(encoder_heard=heard)
        if usable:
            received = received._replace(encoder=estimates)
    elif can_id == kinds.DRIVE_CURRENT.can_id:
        current, reason = unpacking.unpack_drive_current(length, word)
        heard, counters, usable = taken(
            received.current_heard, counters, tick, reason, kinds.DRIVE_CURRENT, word, tick_s
        )
        received = received._replace(current_heard=heard)
        if usable:
            received = received._replace(current_a=current.measured_a)
    elif can_id == kinds.GAIT_SENSORS.can_id:
        leg, reason = unpacking.unpack_gait_sensors(length, word)
        heard, counters, usable = taken(
            received.gait_heard, counters, tick, reason, kinds.GAIT_SENSORS, word, tick_s
        )
        received = received._replace(gait_heard=heard)
        if usable:
            received = received._replace(gait=leg)
    elif can_id == kinds.COARSE_POSITION.can_id:
        position, reason = unpacking.unpack_coarse_position(length, word)
        heard, counters, usable = taken(
            received.coarse_heard, counters, tick, reason, kinds.COARSE_POSITION, word, tick_s
        )
        received = received._replace(coarse_heard=heard)
        if usable:
            received = received._replace(coarse=position)
    elif can_id == kinds.DRIVE_HEARTBEAT.can_id:
        beat, reason = unpacking.unpack_drive_heartbeat(length, word)
        heard, counters, usable = taken(
            received.heartbeat_heard, counters, tick, reason, kinds.DRIVE_HEARTBEAT, word, tick_s
        )
        received = received._replace(heartbeat_heard=heard)
        if usable:
            received = received._replace(heartbeat=beat)
    elif can_id == kinds.DRIVE_ERRORS.can_id:
        errors, reason = unpacking.unpack_drive_errors(length, word)
        heard, counters, usable = taken(
            received.disarm_reason_heard, counters, tick, reason, kinds.DRIVE_ERRORS, word, tick_s
        )
        received = received._replace(disarm_reason_heard=heard)
        if usable:
            received = received._replace(disarm_reason=errors.disarm_reason & errors.active_errors)
    elif can_id == kinds.DRIVE_TEMPERATURE.can_id:
        warmth, reason = unpacking.unpack_drive_temperature(length, word)
        heard, counters, usable = taken(
            received.temperature_heard, counters, tick, reason, kinds.DRIVE_TEMPERATURE, word, tick_s
        )
        received = received._replace(temperature_heard=heard)
        if usable:
            received = received._replace(temperature=warmth)
    elif can_id == kinds.DRIVE_SUPPLY.can_id:
        supply, reason = unpacking.unpack_drive_supply(length, word)
        heard, counters, usable = taken(
            received.voltage_heard, counters, tick, reason, kinds.DRIVE_SUPPLY, word, tick_s
        )
        received = received._replace(voltage_heard=heard)
        if usable:
            received = received._replace(voltage_v=supply.voltage_v)
    elif can_id == kinds.DRIVE_ESTOP.can_id:
        _, reason = unpacking.unpack_drive_estop(length, word)
        _, counters, usable = taken(NEVER, counters, tick, reason, kinds.DRIVE_ESTOP, word, tick_s)
        if usable:
            received = received._replace(estop_tick=tick)
    elif can_id == kinds.OPERATOR_COMMAND.can_id:
        wanted, reason = unpacking.unpack_operator_command(length, word)
        heard, counters, usable = taken(
            received.command_heard, counters, tick, reason, kinds.OPERATOR_COMMAND, word, tick_s
        )
        received = received._replace(command_heard=heard)
        if usable:
            received = received._replace(command=wanted)
    elif can_id == kinds.PARAMETER_REQUEST.can_id:
        request, reason = unpacking.unpack_parameter_request(length, word)
        heard, counters, usable = taken(
            received.request_heard, counters, tick, reason, kinds.PARAMETER_REQUEST, word, tick_s
        )
        received = received._replace(request_heard=heard)
        count = received.request_count
        if usable and count < REQUESTS:
            requests = with_one(received.requests, count, request)
            received = received._replace(requests=requests, request_count=count + 1)
        elif usable:
            counters = also_counted(counters, 0, 1)
    return received, counters


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
