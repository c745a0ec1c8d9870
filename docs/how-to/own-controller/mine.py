"""A speed controller on one page, for `vibrohil run speed.toml --firmware mine.py:tick`.

It turns the crank at the operator's ratio below the impacts, and stops on any other request, after an E-stop,
and when the encoder or the operator falls silent. It knows nothing of the striker.
"""

from math import tau
from typing import NamedTuple

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError, decode, encode
from firmware_py.interface.enums import AxisState, ControlMode, InputMode, Mode, OperatorRequest
from firmware_py.interface.generated.records import (
    DriveEstop,
    EncoderEstimates,
    FirmwareHeartbeat,
    OperatorCommand,
    SetAxisState,
    SetControllerMode,
    SetInputTorque,
    StrikerEstimate,
)
from firmware_py.interface.modes import MOVING

RAMP_RAD_S2, GAIN_N_M_S, INTEGRAL_N_M, LARGEST_N_M = 2.0, 0.05, 0.2, 0.3
ENCODER_TICKS, OPERATOR_TICKS = 30, 350
READ_IDS = {one.can_id for one in (codec.ENCODER_ESTIMATES, codec.DRIVE_ESTOP, codec.OPERATOR_COMMAND)}


class State(NamedTuple):
    """Each member is recorded as a signal, such as firmware.own.torque_n_m."""

    ticks: int = 0
    mode: Mode = Mode.READY
    omega_rad_s: float = 0.0
    wanted_rad_s: float = 0.0
    target_rad_s: float = 0.0
    integral_n_m: float = 0.0
    torque_n_m: float = 0.0
    encoder_age: int = ENCODER_TICKS
    operator_age: int = OPERATOR_TICKS
    may_start: bool = False


INITIAL = State()


def read(config, state, rx):
    """The state after the received frames. A start needs an IDLE before the RUN; an E-stop stays."""
    state = state._replace(encoder_age=state.encoder_age + 1, operator_age=state.operator_age + 1)
    for frame in rx:
        if frame.can_id not in READ_IDS:
            continue
        try:
            received = decode(frame)
        except FrameError:
            continue
        if isinstance(received, EncoderEstimates):
            state = state._replace(omega_rad_s=tau * received.velocity_rev_s, encoder_age=0)
        elif isinstance(received, DriveEstop):
            state = state._replace(mode=Mode.E_STOP)
        elif isinstance(received, OperatorCommand):
            runs = received.request == OperatorRequest.RUN
            wanted_rad_s = (
                received.target_ratio * config.nominal.natural_rad_s if runs and state.may_start else 0.0
            )
            state = state._replace(
                operator_age=0, wanted_rad_s=wanted_rad_s, may_start=state.may_start or not runs
            )
    return state


def mode_of(state, target_rad_s):
    """The mode that the heartbeat reports: the bench judges the hold, which is the time in RUN."""
    if state.wanted_rad_s > 0.0:
        return Mode.RUN if target_rad_s == state.wanted_rad_s else Mode.SOFT_START
    return Mode.STOPPING if target_rad_s > 0.0 else Mode.READY


def tick(config, state, rx):
    """One control period: the next state, and the frames to be sent."""
    state = read(config, state, rx)
    fresh = state.encoder_age < ENCODER_TICKS and state.operator_age < OPERATOR_TICKS
    if not fresh:
        state = state._replace(wanted_rad_s=0.0, may_start=False)
    step_rad_s = RAMP_RAD_S2 * config.tick_s
    target_rad_s = min(
        max(state.wanted_rad_s, state.target_rad_s - step_rad_s), state.target_rad_s + step_rad_s
    )
    mode = mode_of(state, target_rad_s) if fresh else Mode.READY
    mode = Mode.E_STOP if state.mode == Mode.E_STOP else mode
    drives = mode in MOVING
    target_rad_s = target_rad_s if drives else 0.0
    error_rad_s = target_rad_s - state.omega_rad_s
    integral_n_m = state.integral_n_m + INTEGRAL_N_M * error_rad_s * config.tick_s if drives else 0.0
    torque_n_m = (
        min(max(GAIN_N_M_S * error_rad_s + integral_n_m, -LARGEST_N_M), LARGEST_N_M) if drives else 0.0
    )
    state = state._replace(
        ticks=state.ticks + 1,
        mode=mode,
        target_rad_s=target_rad_s,
        integral_n_m=integral_n_m,
        torque_n_m=torque_n_m,
    )
    return state, list(sent(state, drives))


def sent(state, drives):
    """The torque in each tick, and one other frame in most."""
    yield encode(SetInputTorque(state.torque_n_m))
    phase = state.ticks % 100
    if phase == 0:
        yield encode(FirmwareHeartbeat(state.mode, 0, 0, state.target_rad_s, 0))
    elif phase in (25, 75):
        axis = AxisState.CLOSED_LOOP_CONTROL if drives else AxisState.IDLE
        yield encode(SetAxisState(axis))
    elif phase == 50 and state.mode == Mode.E_STOP:
        yield encode(DriveEstop())
    elif phase == 50:
        yield encode(SetControllerMode(ControlMode.TORQUE_CONTROL, InputMode.PASSTHROUGH))
    elif phase % 10 == 1:
        yield encode(StrikerEstimate(0.0, 0.0, state.omega_rad_s))
