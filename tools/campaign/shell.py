"""What the firmware has received, and how the drive obeys the frames it sends, compiled."""

from typing import NamedTuple

from firmware_py.core.drive_link import DriveFrame
from firmware_py.core.inputs import NEVER_TICKS
from firmware_py.interface.enums import AXIS_IDLE, CLOSED_LOOP, AxisState
from hil import drive as axis
from hil.drive import ESTOP_REQUESTED, TURN_RAD, DriveConfig, DriveState, Telemetry
from hil.reports import CURRENT, ERRORS, HEARTBEAT, SUPPLY, TEMPERATURE
from tools.campaign.kernels import subroutine
from tools.campaign.quantise import single


class Heard(NamedTuple):
    """What the firmware's shell received last, and for how many ticks nothing newer."""

    axis_state: AxisState
    axis_error: int
    disarm_reason: int
    heartbeat_age: int
    current_a: float
    current_age: int
    voltage_v: float
    inverter_degc: float
    motor_degc: float
    temperature_age: int
    supply_age: int
    request: int
    target_ratio: float
    target_impulse_n_s: float
    operator_age: int


FIRST_HEARD = Heard(
    axis_state=AxisState.UNDEFINED,
    axis_error=0,
    disarm_reason=0,
    heartbeat_age=NEVER_TICKS,
    current_a=0.0,
    current_age=NEVER_TICKS,
    voltage_v=0.0,
    inverter_degc=0.0,
    motor_degc=0.0,
    temperature_age=NEVER_TICKS,
    supply_age=NEVER_TICKS,
    request=0,
    target_ratio=0.0,
    target_impulse_n_s=0.0,
    operator_age=NEVER_TICKS,
)


@subroutine
def heard_at(
    heard: Heard, report: int, drive: DriveState, config: DriveConfig, telemetry: Telemetry
) -> Heard:
    """One of the drive's reports has arrived, or none; everything else has grown a tick older."""
    beat, errs, ampere = report == HEARTBEAT, report == ERRORS, report == CURRENT
    warmth, power = report == TEMPERATURE, report == SUPPLY
    temperature = axis.temperature(config, drive)
    return Heard(
        axis_state=drive.axis.state if beat else heard.axis_state,
        axis_error=drive.axis.errors if beat else heard.axis_error,
        disarm_reason=drive.axis.disarm_reason if errs else heard.disarm_reason,
        heartbeat_age=0 if beat else min(heard.heartbeat_age + 1, NEVER_TICKS),
        current_a=single(telemetry.current_a) if ampere else heard.current_a,
        current_age=0 if ampere else min(heard.current_age + 1, NEVER_TICKS),
        voltage_v=single(config.supply_v) if power else heard.voltage_v,
        inverter_degc=single(temperature.inverter_degc) if warmth else heard.inverter_degc,
        motor_degc=single(temperature.motor_degc) if warmth else heard.motor_degc,
        temperature_age=0 if warmth else min(heard.temperature_age + 1, NEVER_TICKS),
        supply_age=0 if power else min(heard.supply_age + 1, NEVER_TICKS),
        request=heard.request,
        target_ratio=heard.target_ratio,
        target_impulse_n_s=heard.target_impulse_n_s,
        operator_age=min(heard.operator_age + 1, NEVER_TICKS),
    )


@subroutine
def obeyed(
    drive: DriveState,
    torque_n_m: float,
    frame: DriveFrame,
    config: DriveConfig,
    velocity_limit_rad_s: float,
    current_limit_a: float,
) -> DriveState:
    """The drive after the torque and the one other frame of a tick."""
    drive = axis.set_torque(drive, torque_n_m)
    if frame == DriveFrame.ESTOP:
        drive = axis.disarm(drive, ESTOP_REQUESTED)
    if frame == DriveFrame.CLEAR_ERRORS:
        drive = axis.clear_errors(drive)
    if frame == DriveFrame.LIMITS:
        drive = axis.set_limits(
            config, drive, single(velocity_limit_rad_s / TURN_RAD), single(current_limit_a)
        )
    if frame == DriveFrame.IDLE:
        drive = axis.request_state(drive, AXIS_IDLE)
    if frame == DriveFrame.CLOSED_LOOP:
        drive = axis.request_state(drive, CLOSED_LOOP)
    return drive


@subroutine
def told(heard: Heard, request: int, target_ratio: float, target_impulse_n_s: float) -> Heard:
    """The operator's command has arrived."""
    return Heard(
        axis_state=heard.axis_state,
        axis_error=heard.axis_error,
        disarm_reason=heard.disarm_reason,
        heartbeat_age=heard.heartbeat_age,
        current_a=heard.current_a,
        current_age=heard.current_age,
        voltage_v=heard.voltage_v,
        inverter_degc=heard.inverter_degc,
        motor_degc=heard.motor_degc,
        temperature_age=heard.temperature_age,
        supply_age=heard.supply_age,
        request=request,
        target_ratio=target_ratio,
        target_impulse_n_s=target_impulse_n_s,
        operator_age=0,
    )
