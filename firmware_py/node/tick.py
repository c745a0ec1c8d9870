"""The whole firmware, frames in to frames out:

    tick(config, state, rx) -> (state, tx)

Call it once a control period with the frames that have arrived since. `config` is the core's, made of the
parameters; `state` starts as `INITIAL`. `rx.frames` is anything with `rx.frame_count` items of `WordFrame`: a
sequence interpreted, a tuple of them or a pointer to them compiled; `rx.elapsed_ticks` is 1, or more after
ticks that were skipped. Samples that have waited meanwhile are then used one after the other, each at the
time that its counter says. `tx.torque` leaves in every tick, `tx.other` if `tx.frame_count` is 2.

Reading and writing parameters is no part of a control period: while `state.requests.number` is not 0,
call `served` between two ticks; its answers leave in the next ones.

All of it is the firmware's subset (floats, integers, enums, NamedTuples and tuples of them, bounded loops,
plain functions), so that one source runs interpreted, compiled by numba from within other compiled code, and
on a microcontroller.
"""

from collections.abc import Sequence
from typing import NamedTuple

from firmware_py.core.configure import config_of
from firmware_py.core.inputs import Inputs
from firmware_py.core.parameter_values import Parameters
from firmware_py.core.parameters import read_parameter, write_parameter
from firmware_py.core.safety.drive_link import DriveFrame
from firmware_py.core.state import INITIAL as INITIAL_CORE
from firmware_py.core.state import INITIAL_OUTPUTS, Config, Outputs, State
from firmware_py.core.step import act, sense, unsensed
from firmware_py.interface.counters import NOTHING_YET, Counters, also_counted
from firmware_py.interface.enums import E_STOP, FAULT, INIT, READY, Mode, ParameterOperation, ParameterStatus
from firmware_py.interface.frame import WordFrame
from firmware_py.interface.generated import kinds, packing
from firmware_py.interface.generated.received import INITIAL as NOTHING_RECEIVED
from firmware_py.interface.generated.received import Received, with_sensors_dated
from firmware_py.interface.generated.records import ParameterRequest, ParameterValue, SetInputTorque
from firmware_py.node import transmitter
from firmware_py.node.readings import inputs_of
from firmware_py.node.receiver import (
    LONGEST_DATED_TICKS,
    NO_REQUESTS,
    Requests,
    begins_sample,
    receive,
    sampled_tick,
)
from firmware_py.node.transmitter import Transmitter

MAX_RX = 64
"""Frames that a flat `rx` holds. A tick brings 3 at most; 25 ticks of patience after a pause bring 60."""


MOST_SAMPLES = 20
"""Samples that waited in an overrun and are used at most, the newest; the model bridges what was before."""


class Rx(NamedTuple):
    """The frames since the last tick, in the order of their arrival."""

    elapsed_ticks: int
    frame_count: int
    frames: Sequence[WordFrame]


class Tx(NamedTuple):
    """The frames that leave in this tick: `torque`, and `other` where `frame_count` is 2."""

    frame_count: int
    torque: WordFrame
    other: WordFrame


class NodeState(NamedTuple):
    """Everything that a tick hands to the next one; `inputs` and `outputs` are the newest tick's."""

    ticks: int
    received: Received
    requests: Requests
    inputs: Inputs
    core: State
    outputs: Outputs
    waiting: Transmitter
    counters: Counters


MAY_BE_WRITTEN = (INIT, READY, FAULT, E_STOP)
"""Modes in which nothing moves."""

INITIAL = NodeState(
    ticks=0,
    received=NOTHING_RECEIVED,
    requests=NO_REQUESTS,
    inputs=inputs_of(NOTHING_RECEIVED, 0, 1),
    core=INITIAL_CORE,
    outputs=INITIAL_OUTPUTS,
    waiting=transmitter.INITIAL,
    counters=NOTHING_YET,
)


NO_TX = Tx(0, transmitter.NO_FRAME, transmitter.NO_FRAME)


def transmitted(
    config: Config,
    received: Received,
    waiting: Transmitter,
    tick: int,
    before: Outputs,
    core: State,
    now: Outputs,
) -> tuple[Transmitter, int, Tx]:
    """What leaves in this tick, what still waits, and how many frames were lost."""
    has_gait = received.gait_sensors_arrival.tick >= 0
    waiting, lost = transmitter.queued(config.tick_s, waiting, tick, before, now, has_gait)
    other = transmitter.NO_FRAME
    if now.drive_frame != DriveFrame.NOTHING:
        position_rev = received.encoder_estimates.position_rev
        other = transmitter.drive_frame(config.drive_link, now.drive_frame, position_rev)
    elif transmitter.any_waits(waiting):
        waiting, other = transmitter.next_frame(config.tick_s, waiting, tick, core, now)
        lost += 1 if other.can_id == 0 else 0
    torque, _ = packing.pack_set_input_torque(SetInputTorque(now.torque_n_m), 0)
    return waiting, lost, Tx(1 if other.can_id == 0 else 2, torque, other)


def tick(config: Config, state: NodeState, rx: Rx) -> tuple[NodeState, Tx]:
    """One control period."""
    now = state.ticks + rx.elapsed_ticks
    received, requests, counters = state.received, state.requests, state.counters
    sensed, inputs = unsensed(state.core), state.inputs
    last = received.accelerometer_arrival
    late = rx.elapsed_ticks > 1 and now - last.tick < LONGEST_DATED_TICKS
    first_id = 0
    for index in range(rx.frame_count + 1):
        is_end = index == rx.frame_count
        frame = transmitter.NO_FRAME if is_end else rx.frames[index]
        if first_id == 0 and frame.can_id in (kinds.ACCELEROMETER.can_id, kinds.ENCODER_ESTIMATES.can_id):
            first_id = frame.can_id
        if is_end or (late and begins_sample(received, now, frame, first_id)):
            # The sample so far is complete: the newest one is of now, those before of their own time.
            sampled = now if is_end else min(sampled_tick(last, received.accelerometer_arrival), now - 1)
            if sampled > state.ticks + sensed.ticks and now - sampled <= MOST_SAMPLES:
                inputs = inputs_of(received, now, sampled - state.ticks)
                sensed = sense(config, state.core.speed, sensed, inputs)
            received = with_sensors_dated(received, now, sampled)
            last = received.accelerometer_arrival
        if not is_end:
            received, requests, counters = receive(config.tick_s, received, requests, counters, now, frame)
    core, outputs = act(config, state.core, sensed, inputs)
    waiting, lost, tx = transmitted(config, received, state.waiting, now, state.outputs, core, outputs)
    if lost > 0 or rx.elapsed_ticks > 1:
        counters = also_counted(counters, rx.elapsed_ticks - 1, lost)
    return NodeState(now, received, requests, inputs, core, outputs, waiting, counters), tx


def answered(
    parameters: Parameters, request: ParameterRequest, mode: Mode
) -> tuple[Parameters, ParameterValue]:
    """Read or write one parameter; a write that is refused changes nothing."""
    index = request.parameter_index
    status = ParameterStatus.OK
    if request.operation == ParameterOperation.WRITE:
        if mode in MAY_BE_WRITTEN:
            parameters, status = write_parameter(parameters, index, request.value)
        else:
            status = ParameterStatus.NOT_WHILE_MOVING
    value, tier, known = read_parameter(parameters, index)
    if known != ParameterStatus.OK:
        status = known
    return parameters, ParameterValue(value, index, tier, status.value)


def served(parameters: Parameters, config: Config, state: NodeState) -> tuple[Parameters, Config, NodeState]:
    """Answer the requests that wait, and make the config of what was written."""
    waiting, lost = state.waiting, 0
    for index in range(state.requests.number):
        parameters, answer = answered(parameters, state.requests.waiting[index], state.outputs.mode)
        waiting, fits = transmitter.with_answer(waiting, answer)
        lost += 0 if fits else 1
    # Of damaged parameters one is written, and the others are as unknown as before.
    config = config_of(parameters, config.monitors.parameters_damaged)
    state = state._replace(
        requests=NO_REQUESTS, waiting=waiting, counters=also_counted(state.counters, 0, lost)
    )
    return parameters, config, state
