"""The firmware's shell, compiled: what it has heard, and the frames that wait to be sent, one a tick.

It is that of `firmware_py.shell.node` with the frames' pacing: beside the torque of every tick at most one
frame leaves, so a request to the drive may stand behind others.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.core.inputs import NEVER_TICKS
from firmware_py.core.step import Outputs
from firmware_py.interface.enums import AXIS_IDLE, CLOSED_LOOP, AxisState, Fault, Mode
from hil import drive as axis
from hil.drive import ESTOP_REQUESTED, TURN_RAD, DriveConfig, DriveState, Telemetry
from hil.reports import CURRENT, ERRORS, HEARTBEAT, SUPPLY, TEMPERATURE
from tools.campaign.kernels import subroutine
from tools.campaign.quantise import single

HEARTBEAT_TICKS = 100
ESTIMATE_TICKS = 10
GAIT_TICKS = 40
RETRY_TICKS = 50
NEVER = -1_000_000

NOTHING, OTHER, CLEAR, LIMITS, CLOSE, IDLE = range(6)
"""What waits; OTHER is nothing to the drive."""
PLACES = 32


class Wishes(NamedTuple):
    """What the firmware's frames of the last tick ask of the drive: a torque, and one more thing at most."""

    torque_n_m: float
    estop: bool
    clear_errors: bool
    limits: bool
    closed: bool
    idle: bool


class Heard(NamedTuple):
    """What the firmware's shell heard last, and for how many ticks nothing newer."""

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


class Line(NamedTuple):
    """Frames that wait, a ring of shape (PLACES,), and when some were last queued.

    `news` counts impacts' frames, which overtake the others.
    """

    waiting: NDArray[np.int64]
    first: int
    size: int
    news: int
    estop: bool
    state_tick: int
    clear_tick: int
    regime_tick: int
    regime_pending: bool
    mode: Mode
    fault: Fault


def first_line() -> Line:
    """Nothing waits at power-up."""
    return Line(
        waiting=np.zeros(PLACES, dtype=np.int64),
        first=0,
        size=0,
        news=0,
        estop=False,
        state_tick=NEVER,
        clear_tick=NEVER,
        regime_tick=NEVER,
        regime_pending=False,
        mode=Mode.INIT,
        fault=Fault.NONE,
    )


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
    wishes: Wishes,
    config: DriveConfig,
    velocity_limit_rad_s: float,
    current_limit_a: float,
) -> DriveState:
    """The drive after the firmware's frames, in the order in which they are sent."""
    drive = axis.set_torque(drive, wishes.torque_n_m)
    if wishes.estop:
        drive = axis.disarm(drive, ESTOP_REQUESTED)
    if wishes.clear_errors:
        drive = axis.clear_errors(drive)
    if wishes.limits:
        drive = axis.set_limits(
            config, drive, single(velocity_limit_rad_s / TURN_RAD), single(current_limit_a)
        )
    if wishes.idle:
        drive = axis.request_state(drive, AXIS_IDLE)
    if wishes.closed:
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


@subroutine
def sent(line: Line, outputs: Outputs, heard: Heard, hears_gait: bool, tick: int) -> tuple[Line, Wishes]:
    """Queue what this tick has to say; the torque and the frame whose turn it is leave."""
    waiting, size = line.waiting, line.size
    changed = outputs.mode != line.mode
    end = line.first + size
    estop = line.estop or (outputs.estop and changed)
    clear_tick, state_tick = line.clear_tick, line.state_tick
    if outputs.clear_errors and heard.axis_error != 0 and tick - clear_tick >= RETRY_TICKS:
        waiting[end % PLACES] = CLEAR
        end += 1
        clear_tick = tick
    disagree = heard.axis_state != outputs.axis_request and heard.heartbeat_age < NEVER_TICKS
    if disagree and (changed or tick - state_tick >= RETRY_TICKS):
        if outputs.axis_request == AxisState.CLOSED_LOOP_CONTROL:
            waiting[end % PLACES] = OTHER
            waiting[(end + 1) % PLACES] = LIMITS
            waiting[(end + 2) % PLACES] = CLOSE
            end += 3
        else:
            waiting[end % PLACES] = IDLE
            end += 1
        state_tick = tick
    news = line.news + (1 if outputs.separation else 0)
    others = 1 if outputs.fault not in (line.fault, Fault.NONE) else 0
    regime_pending = line.regime_pending or outputs.period_ended
    regime_tick = line.regime_tick
    if regime_pending and tick - regime_tick >= RETRY_TICKS:
        regime_pending = False
        regime_tick = tick
        others += 1
    if tick % ESTIMATE_TICKS == 0:
        others += 1
    if tick % HEARTBEAT_TICKS == 0:
        others += 1
    if hears_gait and tick % GAIT_TICKS == 0:
        others += 1
    for _ in range(others):
        waiting[end % PLACES] = OTHER
        end += 1

    first, leaves = line.first, NOTHING
    asks_estop = estop
    if estop:
        estop = False
    elif news > 0:
        news -= 1
    elif end > first:
        leaves = waiting[first % PLACES]
        first += 1
    size = end - first
    after = Line(
        waiting,
        first % PLACES,
        size,
        news,
        estop,
        state_tick,
        clear_tick,
        regime_tick,
        regime_pending,
        outputs.mode,
        outputs.fault,
    )
    return after, Wishes(
        single(outputs.torque_n_m),
        asks_estop,
        leaves == CLEAR,
        leaves == LIMITS,
        leaves == CLOSE,
        leaves == IDLE,
    )
