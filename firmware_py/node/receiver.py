"""Receiving: frames to the newest reading of each source with its age.

Frames that fail their CRC, length or ranges, and those that repeat the counter of the one before, are dropped
and counted; their source then simply grows older. A gap in a counter is counted, and the frame used. After a
silence in which the counter may have turned once round, the same number again is no repetition.
"""

from typing import NamedTuple, TypeVar

from firmware_py.core.inputs import (
    NEVER_TICKS,
    AccelerometerInput,
    CoarseInput,
    DriveInput,
    EncoderInput,
    GaitInput,
    Inputs,
    OperatorInput,
    PowerInput,
)
from firmware_py.interface import packing
from firmware_py.interface.enums import axis_state_of, operator_request_of
from firmware_py.interface.errors import FrameErrorReason
from firmware_py.interface.frame import WordFrame
from firmware_py.interface.records import (
    Accelerometer,
    CoarsePosition,
    DriveHeartbeat,
    DriveTemperature,
    EncoderEstimates,
    GaitSensors,
    OperatorCommand,
    ParameterRequest,
)

Item = TypeVar("Item")

NO_COARSE = CoarseInput(0.0, NEVER_TICKS)
NO_GAIT = GaitInput(0.0, 0.0, heel=False, toe=False, age_ticks=NEVER_TICKS)
"""What modules without such a sensor read."""

LONGEST_DATED_TICKS = (1 << packing.ACCELEROMETER_COUNTER_BITS) - 2
"""Since the last sample: for as long a sample's counter says when it was sent, give or take a tick."""

REQUESTS = 4
"""Parameter requests that wait for their answers at most; a client waits for one before it asks again."""


class Counters(NamedTuple):
    """Since power-up: frames taken, frames dropped by reason, gaps in rolling counters, skipped ticks, and
    own frames that found no place in the queue or could not be encoded."""

    frames: int
    rejected_length: int
    rejected_crc: int
    rejected_value: int
    rejected_repeated: int
    counter_gaps: int
    skipped_ticks: int
    unsent: int


class Heard(NamedTuple):
    """The tick of a source's newest frame, and that frame's rolling counter (−1: none yet).

    `counted_tick` is that of the newest counter, of dropped repetitions too.
    """

    tick: int
    counted_tick: int
    counter: int


class Received(NamedTuple):
    """The newest reading of each source. Of `requests` the first `request_count` wait for an answer."""

    accelerometer: Accelerometer
    accelerometer_heard: Heard
    encoder: EncoderEstimates
    encoder_heard: Heard
    heartbeat: DriveHeartbeat
    heartbeat_heard: Heard
    disarm_reason: int
    disarm_reason_heard: Heard
    current_a: float
    current_heard: Heard
    temperature: DriveTemperature
    temperature_heard: Heard
    voltage_v: float
    voltage_heard: Heard
    estop_tick: int
    command: OperatorCommand
    command_heard: Heard
    coarse: CoarsePosition
    coarse_heard: Heard
    gait: GaitSensors
    gait_heard: Heard
    requests: tuple[ParameterRequest, ParameterRequest, ParameterRequest, ParameterRequest]
    request_count: int
    request_heard: Heard


NEVER = Heard(-NEVER_TICKS, -NEVER_TICKS, -1)
NOTHING_YET = Counters(0, 0, 0, 0, 0, 0, 0, 0)
NO_REQUEST = ParameterRequest(0, 0, 0.0)

INITIAL = Received(
    accelerometer=Accelerometer(0.0, 0.0, 0.0),
    accelerometer_heard=NEVER,
    encoder=EncoderEstimates(0.0, 0.0),
    encoder_heard=NEVER,
    heartbeat=DriveHeartbeat(0, 0, 0, 0),
    heartbeat_heard=NEVER,
    disarm_reason=0,
    disarm_reason_heard=NEVER,
    current_a=0.0,
    current_heard=NEVER,
    temperature=DriveTemperature(0.0, 0.0),
    temperature_heard=NEVER,
    voltage_v=0.0,
    voltage_heard=NEVER,
    estop_tick=-NEVER_TICKS,
    command=OperatorCommand(0, 0.0, 0.0),
    command_heard=NEVER,
    coarse=CoarsePosition(0.0),
    coarse_heard=NEVER,
    gait=GaitSensors(0.0, 0.0, 0, 0),
    gait_heard=NEVER,
    requests=(NO_REQUEST, NO_REQUEST, NO_REQUEST, NO_REQUEST),
    request_count=0,
    request_heard=NEVER,
)


def refused(counters: Counters, reason: FrameErrorReason) -> Counters:
    """Count a frame that the codec refuses."""
    frames, length, crc, value, repeated, gaps, skipped, unsent = counters
    if reason == FrameErrorReason.LENGTH:
        length += 1
    elif reason == FrameErrorReason.CRC:
        crc += 1
    else:
        value += 1
    return Counters(frames, length, crc, value, repeated, gaps, skipped, unsent)


def counted(counters: Counters, repeated: bool, gap: bool) -> Counters:
    """Count a frame that the codec accepts."""
    return Counters(
        counters.frames if repeated else counters.frames + 1,
        counters.rejected_length,
        counters.rejected_crc,
        counters.rejected_value,
        counters.rejected_repeated + 1 if repeated else counters.rejected_repeated,
        counters.counter_gaps + 1 if gap else counters.counter_gaps,
        counters.skipped_ticks,
        counters.unsent,
    )


def also_counted(counters: Counters, skipped_ticks: int, unsent: int) -> Counters:
    """Count skipped ticks and own frames that do not leave."""
    return Counters(
        counters.frames,
        counters.rejected_length,
        counters.rejected_crc,
        counters.rejected_value,
        counters.rejected_repeated,
        counters.counter_gaps,
        counters.skipped_ticks + skipped_ticks,
        counters.unsent + unsent,
    )


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


def without_requests(received: Received) -> Received:
    """All parameter requests are answered."""
    return Received(
        received.accelerometer,
        received.accelerometer_heard,
        received.encoder,
        received.encoder_heard,
        received.heartbeat,
        received.heartbeat_heard,
        received.disarm_reason,
        received.disarm_reason_heard,
        received.current_a,
        received.current_heard,
        received.temperature,
        received.temperature_heard,
        received.voltage_v,
        received.voltage_heard,
        received.estop_tick,
        received.command,
        received.command_heard,
        received.coarse,
        received.coarse_heard,
        received.gait,
        received.gait_heard,
        received.requests,
        0,
        received.request_heard,
    )


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


def dated(heard: Heard, tick: int, sampled: int) -> Heard:
    """The same, of `sampled` if it was received in `tick`."""
    return Heard(sampled, sampled, heard.counter) if heard.tick == tick else heard


def with_sensors_dated(received: Received, tick: int, sampled: int) -> Received:
    """The same, with the sensors' readings that were received in `tick` of the earlier tick `sampled`."""
    return Received(
        received.accelerometer,
        dated(received.accelerometer_heard, tick, sampled),
        received.encoder,
        dated(received.encoder_heard, tick, sampled),
        received.heartbeat,
        received.heartbeat_heard,
        received.disarm_reason,
        received.disarm_reason_heard,
        received.current_a,
        received.current_heard,
        received.temperature,
        received.temperature_heard,
        received.voltage_v,
        received.voltage_heard,
        received.estop_tick,
        received.command,
        received.command_heard,
        received.coarse,
        dated(received.coarse_heard, tick, sampled),
        received.gait,
        dated(received.gait_heard, tick, sampled),
        received.requests,
        received.request_count,
        received.request_heard,
    )


def age(tick: int, heard: Heard) -> int:
    """Ticks since a source's newest frame, `NEVER_TICKS` at most."""
    return min(tick - heard.tick, NEVER_TICKS)


def inputs_of(received: Received, tick: int, elapsed_ticks: int) -> Inputs:
    """What the core sees of the world at tick number `tick`."""
    acceleration, encoder = received.accelerometer, received.encoder
    command, gait = received.command, received.gait
    coarse = NO_COARSE
    if received.coarse_heard.tick >= 0:
        coarse = CoarseInput(received.coarse.striker_position_m, age(tick, received.coarse_heard))
    leg = NO_GAIT
    if received.gait_heard.tick >= 0:
        leg = GaitInput(
            gait.shank_rate_rad_s,
            gait.along_m_s2,
            gait.heel_contact == 1,
            gait.toe_contact == 1,
            age(tick, received.gait_heard),
        )
    power_tick = min(
        received.current_heard.tick, received.temperature_heard.tick, received.voltage_heard.tick
    )
    return Inputs(
        elapsed_ticks,
        AccelerometerInput(
            acceleration.striker_low_m_s2,
            acceleration.striker_high_m_s2,
            acceleration.housing_m_s2,
            age(tick, received.accelerometer_heard),
        ),
        coarse,
        EncoderInput(encoder.position_rev, encoder.velocity_rev_s, age(tick, received.encoder_heard)),
        DriveInput(
            axis_state_of(received.heartbeat.axis_state),
            received.heartbeat.axis_error,
            received.disarm_reason,
            age(tick, received.heartbeat_heard),
        ),
        PowerInput(
            received.current_a,
            received.voltage_v,
            received.temperature.inverter_degc,
            received.temperature.motor_degc,
            min(tick - power_tick, NEVER_TICKS),
        ),
        OperatorInput(
            operator_request_of(command.request),
            command.target_ratio,
            command.target_impulse_n_s,
            age(tick, received.command_heard),
        ),
        leg,
        received.estop_tick == tick,
    )
