"""What the firmware has received: written by `generate.py` out of `vibro.dbc`; do not edit."""

from typing import NamedTuple

from firmware_py.interface.arrivals import NEVER, Arrival, dated, taken
from firmware_py.interface.counters import Counters
from firmware_py.interface.frame import WordFrame
from firmware_py.interface.generated import kinds, records, unpacking

RECEIVED_IDS = (
    kinds.ENCODER_ESTIMATES.can_id,
    kinds.ACCELEROMETER.can_id,
    kinds.GAIT_SENSORS.can_id,
    kinds.DRIVE_CURRENT.can_id,
    kinds.COARSE_POSITION.can_id,
    kinds.DRIVE_HEARTBEAT.can_id,
    kinds.DRIVE_ERRORS.can_id,
    kinds.DRIVE_TEMPERATURE.can_id,
    kinds.DRIVE_SUPPLY.can_id,
    kinds.OPERATOR_COMMAND.can_id,
    kinds.DRIVE_ESTOP.can_id,
    kinds.PARAMETER_REQUEST.can_id,
)
"""The identifiers that the firmware listens to, the most frequent first."""


class Received(NamedTuple):
    """The newest record of each frame that the firmware receives, and when it came."""

    encoder_estimates: records.EncoderEstimates
    encoder_estimates_arrival: Arrival
    accelerometer: records.Accelerometer
    accelerometer_arrival: Arrival
    gait_sensors: records.GaitSensors
    gait_sensors_arrival: Arrival
    drive_current: records.DriveCurrent
    drive_current_arrival: Arrival
    coarse_position: records.CoarsePosition
    coarse_position_arrival: Arrival
    drive_heartbeat: records.DriveHeartbeat
    drive_heartbeat_arrival: Arrival
    drive_errors: records.DriveErrors
    drive_errors_arrival: Arrival
    drive_temperature: records.DriveTemperature
    drive_temperature_arrival: Arrival
    drive_supply: records.DriveSupply
    drive_supply_arrival: Arrival
    operator_command: records.OperatorCommand
    operator_command_arrival: Arrival
    drive_estop_arrival: Arrival
    parameter_request: records.ParameterRequest
    parameter_request_arrival: Arrival


INITIAL = Received(
    encoder_estimates=records.EncoderEstimates(0.0, 0.0),
    encoder_estimates_arrival=NEVER,
    accelerometer=records.Accelerometer(0.0, 0.0, 0.0),
    accelerometer_arrival=NEVER,
    gait_sensors=records.GaitSensors(0.0, 0.0, 0, 0),
    gait_sensors_arrival=NEVER,
    drive_current=records.DriveCurrent(0.0, 0.0),
    drive_current_arrival=NEVER,
    coarse_position=records.CoarsePosition(0.0),
    coarse_position_arrival=NEVER,
    drive_heartbeat=records.DriveHeartbeat(0, 0, 0, 0),
    drive_heartbeat_arrival=NEVER,
    drive_errors=records.DriveErrors(0, 0),
    drive_errors_arrival=NEVER,
    drive_temperature=records.DriveTemperature(0.0, 0.0),
    drive_temperature_arrival=NEVER,
    drive_supply=records.DriveSupply(0.0, 0.0),
    drive_supply_arrival=NEVER,
    operator_command=records.OperatorCommand(0, 0.0, 0.0),
    operator_command_arrival=NEVER,
    drive_estop_arrival=NEVER,
    parameter_request=records.ParameterRequest(0.0, 0, 0),
    parameter_request_arrival=NEVER,
)


def with_sensors_dated(received: Received, tick: int, sampled: int) -> Received:
    """The same, with the sensors' records that came in `tick` of the earlier tick `sampled`."""
    return Received(
        received.encoder_estimates,
        dated(received.encoder_estimates_arrival, tick, sampled),
        received.accelerometer,
        dated(received.accelerometer_arrival, tick, sampled),
        received.gait_sensors,
        dated(received.gait_sensors_arrival, tick, sampled),
        received.drive_current,
        received.drive_current_arrival,
        received.coarse_position,
        dated(received.coarse_position_arrival, tick, sampled),
        received.drive_heartbeat,
        received.drive_heartbeat_arrival,
        received.drive_errors,
        received.drive_errors_arrival,
        received.drive_temperature,
        received.drive_temperature_arrival,
        received.drive_supply,
        received.drive_supply_arrival,
        received.operator_command,
        received.operator_command_arrival,
        received.drive_estop_arrival,
        received.parameter_request,
        received.parameter_request_arrival,
    )


def receive(
    tick_s: float, received: Received, counters: Counters, tick: int, frame: WordFrame
) -> tuple[Received, Counters, bool]:
    """Take one frame that arrived before tick number `tick`: `(received, counters, usable)`."""
    can_id, length, word = frame
    usable = False
    (
        encoder_estimates,
        encoder_estimates_arrival,
        accelerometer,
        accelerometer_arrival,
        gait_sensors,
        gait_sensors_arrival,
        drive_current,
        drive_current_arrival,
        coarse_position,
        coarse_position_arrival,
        drive_heartbeat,
        drive_heartbeat_arrival,
        drive_errors,
        drive_errors_arrival,
        drive_temperature,
        drive_temperature_arrival,
        drive_supply,
        drive_supply_arrival,
        operator_command,
        operator_command_arrival,
        drive_estop_arrival,
        parameter_request,
        parameter_request_arrival,
    ) = received
    if can_id == kinds.ENCODER_ESTIMATES.can_id:
        new_encoder_estimates, reason = unpacking.unpack_encoder_estimates(length, word)
        encoder_estimates_arrival, counters, usable = taken(
            encoder_estimates_arrival, counters, tick, reason, kinds.ENCODER_ESTIMATES, word, tick_s
        )
        encoder_estimates = new_encoder_estimates if usable else encoder_estimates
    elif can_id == kinds.ACCELEROMETER.can_id:
        new_accelerometer, reason = unpacking.unpack_accelerometer(length, word)
        accelerometer_arrival, counters, usable = taken(
            accelerometer_arrival, counters, tick, reason, kinds.ACCELEROMETER, word, tick_s
        )
        accelerometer = new_accelerometer if usable else accelerometer
    elif can_id == kinds.GAIT_SENSORS.can_id:
        new_gait_sensors, reason = unpacking.unpack_gait_sensors(length, word)
        gait_sensors_arrival, counters, usable = taken(
            gait_sensors_arrival, counters, tick, reason, kinds.GAIT_SENSORS, word, tick_s
        )
        gait_sensors = new_gait_sensors if usable else gait_sensors
    elif can_id == kinds.DRIVE_CURRENT.can_id:
        new_drive_current, reason = unpacking.unpack_drive_current(length, word)
        drive_current_arrival, counters, usable = taken(
            drive_current_arrival, counters, tick, reason, kinds.DRIVE_CURRENT, word, tick_s
        )
        drive_current = new_drive_current if usable else drive_current
    elif can_id == kinds.COARSE_POSITION.can_id:
        new_coarse_position, reason = unpacking.unpack_coarse_position(length, word)
        coarse_position_arrival, counters, usable = taken(
            coarse_position_arrival, counters, tick, reason, kinds.COARSE_POSITION, word, tick_s
        )
        coarse_position = new_coarse_position if usable else coarse_position
    elif can_id == kinds.DRIVE_HEARTBEAT.can_id:
        new_drive_heartbeat, reason = unpacking.unpack_drive_heartbeat(length, word)
        drive_heartbeat_arrival, counters, usable = taken(
            drive_heartbeat_arrival, counters, tick, reason, kinds.DRIVE_HEARTBEAT, word, tick_s
        )
        drive_heartbeat = new_drive_heartbeat if usable else drive_heartbeat
    elif can_id == kinds.DRIVE_ERRORS.can_id:
        new_drive_errors, reason = unpacking.unpack_drive_errors(length, word)
        drive_errors_arrival, counters, usable = taken(
            drive_errors_arrival, counters, tick, reason, kinds.DRIVE_ERRORS, word, tick_s
        )
        drive_errors = new_drive_errors if usable else drive_errors
    elif can_id == kinds.DRIVE_TEMPERATURE.can_id:
        new_drive_temperature, reason = unpacking.unpack_drive_temperature(length, word)
        drive_temperature_arrival, counters, usable = taken(
            drive_temperature_arrival, counters, tick, reason, kinds.DRIVE_TEMPERATURE, word, tick_s
        )
        drive_temperature = new_drive_temperature if usable else drive_temperature
    elif can_id == kinds.DRIVE_SUPPLY.can_id:
        new_drive_supply, reason = unpacking.unpack_drive_supply(length, word)
        drive_supply_arrival, counters, usable = taken(
            drive_supply_arrival, counters, tick, reason, kinds.DRIVE_SUPPLY, word, tick_s
        )
        drive_supply = new_drive_supply if usable else drive_supply
    elif can_id == kinds.OPERATOR_COMMAND.can_id:
        new_operator_command, reason = unpacking.unpack_operator_command(length, word)
        operator_command_arrival, counters, usable = taken(
            operator_command_arrival, counters, tick, reason, kinds.OPERATOR_COMMAND, word, tick_s
        )
        operator_command = new_operator_command if usable else operator_command
    elif can_id == kinds.DRIVE_ESTOP.can_id:
        _, reason = unpacking.unpack_drive_estop(length, word)
        drive_estop_arrival, counters, usable = taken(
            drive_estop_arrival, counters, tick, reason, kinds.DRIVE_ESTOP, word, tick_s
        )
    elif can_id == kinds.PARAMETER_REQUEST.can_id:
        new_parameter_request, reason = unpacking.unpack_parameter_request(length, word)
        parameter_request_arrival, counters, usable = taken(
            parameter_request_arrival, counters, tick, reason, kinds.PARAMETER_REQUEST, word, tick_s
        )
        parameter_request = new_parameter_request if usable else parameter_request
    return (
        Received(
            encoder_estimates,
            encoder_estimates_arrival,
            accelerometer,
            accelerometer_arrival,
            gait_sensors,
            gait_sensors_arrival,
            drive_current,
            drive_current_arrival,
            coarse_position,
            coarse_position_arrival,
            drive_heartbeat,
            drive_heartbeat_arrival,
            drive_errors,
            drive_errors_arrival,
            drive_temperature,
            drive_temperature_arrival,
            drive_supply,
            drive_supply_arrival,
            operator_command,
            operator_command_arrival,
            drive_estop_arrival,
            parameter_request,
            parameter_request_arrival,
        ),
        counters,
        usable,
    )
