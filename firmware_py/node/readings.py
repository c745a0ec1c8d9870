"""The newest reading of each source with its age, and what the core is given of them."""

from typing import NamedTuple

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
from firmware_py.interface.enums import axis_state_of, operator_request_of
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

NO_COARSE = CoarseInput(0.0, NEVER_TICKS)
NO_GAIT = GaitInput(0.0, 0.0, heel=False, toe=False, age_ticks=NEVER_TICKS)
"""What modules without such a sensor read."""


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


def dated(heard: Heard, tick: int, sampled: int) -> Heard:
    """The same, of `sampled` if it was received in `tick`."""
    return Heard(sampled, sampled, heard.counter) if heard.tick == tick else heard


def with_sensors_dated(received: Received, tick: int, sampled: int) -> Received:
    """The same, with the sensors' readings that were received in `tick` of the earlier tick `sampled`."""
    return received._replace(
        accelerometer_heard=dated(received.accelerometer_heard, tick, sampled),
        encoder_heard=dated(received.encoder_heard, tick, sampled),
        coarse_heard=dated(received.coarse_heard, tick, sampled),
        gait_heard=dated(received.gait_heard, tick, sampled),
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
