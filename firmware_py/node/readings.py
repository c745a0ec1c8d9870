"""The core's inputs from the newest frames."""

from firmware_py.core.inputs import (
    AccelerometerInput,
    DriveInput,
    EncoderInput,
    GaitInput,
    Inputs,
    OperatorInput,
    PowerInput,
)
from firmware_py.core.measurements import measurements_of
from firmware_py.interface.arrivals import age, stray_age
from firmware_py.interface.enums import axis_state_of, operator_request_of
from firmware_py.interface.generated.received import Received


def inputs_of(received: Received, tick: int) -> Inputs:
    """The core's inputs at tick number `tick`."""
    acceleration, encoder = received.accelerometer, received.encoder_estimates
    command, leg = received.operator_command, received.gait_sensors
    errors, temperature = received.drive_errors, received.drive_temperature
    return Inputs(
        accelerometer=AccelerometerInput(
            acceleration.striker_low_m_s2,
            acceleration.striker_high_m_s2,
            acceleration.housing_m_s2,
            age(tick, received.accelerometer_arrival),
        ),
        measurements=measurements_of(received, tick),
        encoder=EncoderInput(
            encoder.position_rev,
            encoder.velocity_rev_s,
            age(tick, received.encoder_estimates_arrival),
            received.encoder_estimates_arrival.counter,
        ),
        drive=DriveInput(
            axis_state_of(received.drive_heartbeat.axis_state),
            received.drive_heartbeat.axis_error,
            errors.disarm_reason & errors.active_errors,
            age(tick, received.drive_heartbeat_arrival),
        ),
        power=PowerInput(
            received.drive_current.measured_a,
            received.drive_supply.voltage_v,
            temperature.inverter_degc,
            temperature.motor_degc,
            max(
                age(tick, received.drive_current_arrival),
                age(tick, received.drive_temperature_arrival),
                age(tick, received.drive_supply_arrival),
            ),
        ),
        operator=OperatorInput(
            operator_request_of(command.request),
            command.target_ratio,
            command.target_impulse_n_s,
            age(tick, received.operator_command_arrival),
            stray_age(tick, received.operator_command_arrival),
        ),
        gait=GaitInput(
            leg.shank_rate_rad_s,
            leg.heel_contact == 1,
            leg.toe_contact == 1,
            age(tick, received.gait_sensors_arrival),
        ),
        estop=received.drive_estop_arrival.tick == tick,
    )
