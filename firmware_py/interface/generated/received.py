"""Frames received by the firmware: written by `generate.py` out of `vibro.dbc`; do not edit."""

from typing import NamedTuple

from firmware_py.interface.arrivals import Arrival, Counters, Now, accept
from firmware_py.interface.frame import WordFrame
from firmware_py.interface.generated import kinds, records, unpacking
from firmware_py.interface.zeroed import zeroed

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
    kinds.XCP_COMMAND.can_id,
)
"""The identifiers that the firmware receives, the most frequent first."""


class Received(NamedTuple):
    """The newest record and arrival of each frame that the firmware receives."""

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
    xcp_command: records.XcpCommand
    xcp_command_arrival: Arrival


INITIAL = zeroed(Received)


def receive(
    now: Now, received: Received, counters: Counters, frame: WordFrame
) -> tuple[Received, Counters, bool]:
    """Process one frame that arrived before the present tick: `(received, counters, usable)`."""
    can_id, length, word = frame
    usable = False
    if can_id == kinds.ENCODER_ESTIMATES.can_id:
        encoder_estimates, reason = unpacking.unpack_encoder_estimates(length, word)
        arrival, counters, usable = accept(
            received.encoder_estimates_arrival, counters, kinds.ENCODER_ESTIMATES, reason, word, now
        )
        received = received._replace(
            encoder_estimates_arrival=arrival,
            encoder_estimates=encoder_estimates if usable else received.encoder_estimates,
        )
    elif can_id == kinds.ACCELEROMETER.can_id:
        accelerometer, reason = unpacking.unpack_accelerometer(length, word)
        arrival, counters, usable = accept(
            received.accelerometer_arrival, counters, kinds.ACCELEROMETER, reason, word, now
        )
        received = received._replace(
            accelerometer_arrival=arrival, accelerometer=accelerometer if usable else received.accelerometer
        )
    elif can_id == kinds.GAIT_SENSORS.can_id:
        gait_sensors, reason = unpacking.unpack_gait_sensors(length, word)
        arrival, counters, usable = accept(
            received.gait_sensors_arrival, counters, kinds.GAIT_SENSORS, reason, word, now
        )
        received = received._replace(
            gait_sensors_arrival=arrival, gait_sensors=gait_sensors if usable else received.gait_sensors
        )
    elif can_id == kinds.DRIVE_CURRENT.can_id:
        drive_current, reason = unpacking.unpack_drive_current(length, word)
        arrival, counters, usable = accept(
            received.drive_current_arrival, counters, kinds.DRIVE_CURRENT, reason, word, now
        )
        received = received._replace(
            drive_current_arrival=arrival, drive_current=drive_current if usable else received.drive_current
        )
    elif can_id == kinds.COARSE_POSITION.can_id:
        coarse_position, reason = unpacking.unpack_coarse_position(length, word)
        arrival, counters, usable = accept(
            received.coarse_position_arrival, counters, kinds.COARSE_POSITION, reason, word, now
        )
        received = received._replace(
            coarse_position_arrival=arrival,
            coarse_position=coarse_position if usable else received.coarse_position,
        )
    elif can_id == kinds.DRIVE_HEARTBEAT.can_id:
        drive_heartbeat, reason = unpacking.unpack_drive_heartbeat(length, word)
        arrival, counters, usable = accept(
            received.drive_heartbeat_arrival, counters, kinds.DRIVE_HEARTBEAT, reason, word, now
        )
        received = received._replace(
            drive_heartbeat_arrival=arrival,
            drive_heartbeat=drive_heartbeat if usable else received.drive_heartbeat,
        )
    elif can_id == kinds.DRIVE_ERRORS.can_id:
        drive_errors, reason = unpacking.unpack_drive_errors(length, word)
        arrival, counters, usable = accept(
            received.drive_errors_arrival, counters, kinds.DRIVE_ERRORS, reason, word, now
        )
        received = received._replace(
            drive_errors_arrival=arrival, drive_errors=drive_errors if usable else received.drive_errors
        )
    elif can_id == kinds.DRIVE_TEMPERATURE.can_id:
        drive_temperature, reason = unpacking.unpack_drive_temperature(length, word)
        arrival, counters, usable = accept(
            received.drive_temperature_arrival, counters, kinds.DRIVE_TEMPERATURE, reason, word, now
        )
        received = received._replace(
            drive_temperature_arrival=arrival,
            drive_temperature=drive_temperature if usable else received.drive_temperature,
        )
    elif can_id == kinds.DRIVE_SUPPLY.can_id:
        drive_supply, reason = unpacking.unpack_drive_supply(length, word)
        arrival, counters, usable = accept(
            received.drive_supply_arrival, counters, kinds.DRIVE_SUPPLY, reason, word, now
        )
        received = received._replace(
            drive_supply_arrival=arrival, drive_supply=drive_supply if usable else received.drive_supply
        )
    elif can_id == kinds.OPERATOR_COMMAND.can_id:
        operator_command, reason = unpacking.unpack_operator_command(length, word)
        arrival, counters, usable = accept(
            received.operator_command_arrival, counters, kinds.OPERATOR_COMMAND, reason, word, now
        )
        received = received._replace(
            operator_command_arrival=arrival,
            operator_command=operator_command if usable else received.operator_command,
        )
    elif can_id == kinds.DRIVE_ESTOP.can_id:
        _, reason = unpacking.unpack_drive_estop(length, word)
        arrival, counters, usable = accept(
            received.drive_estop_arrival, counters, kinds.DRIVE_ESTOP, reason, word, now
        )
        received = received._replace(drive_estop_arrival=arrival)
    elif can_id == kinds.XCP_COMMAND.can_id:
        xcp_command, reason = unpacking.unpack_xcp_command(length, word)
        arrival, counters, usable = accept(
            received.xcp_command_arrival, counters, kinds.XCP_COMMAND, reason, word, now
        )
        received = received._replace(
            xcp_command_arrival=arrival, xcp_command=xcp_command if usable else received.xcp_command
        )
    return received, counters, usable
