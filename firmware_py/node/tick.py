"""The whole firmware, frames in to frames out:

    tick(config, state, rx) -> (state, tx)

Call it once per control period with the frames that have arrived since the last call. `config` is the core's
configuration, made from the parameters; `state` starts as `INITIAL`. `rx.frames` holds `rx.frame_count` items
of `WordFrame`: any sequence if interpreted, a tuple or a pointer if compiled. `rx.elapsed_ticks` is 1, or
more after skipped ticks. The samples that have arrived during skipped ticks are used one after the other,
each at the time given by its counter. `tx.torque` is sent in every tick, `tx.other` if `tx.frame_count` is 2.

Parameters are read and written between control periods: if `state.requests.number` is not 0, call `served`
between two ticks; its answers are sent in the following ticks.

The module uses only the firmware's subset (floats, integers, enums, NamedTuples and tuples of them, bounded
loops, plain functions), so that one source runs interpreted, compiled by numba from within other compiled
code, and on a microcontroller.
"""

from collections.abc import Sequence
from typing import NamedTuple

from firmware_py.core.configure import config_of
from firmware_py.core.inputs import Inputs
from firmware_py.core.parameter_values import Parameters
from firmware_py.core.parameters import read_parameter, write_parameter
from firmware_py.core.safety.drive_link import NO_DRIVE_FRAME
from firmware_py.core.state import INITIAL as INITIAL_CORE
from firmware_py.core.state import INITIAL_OUTPUTS, Config, Outputs, State
from firmware_py.core.step import act, sense, unsensed
from firmware_py.interface.counters import NOTHING_YET, Counters, counted
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
"""Capacity of a flat `rx`. A tick brings at most 3 frames; the 25 ticks tolerated in an overrun bring 60."""


MOST_SAMPLES = 20
"""Most samples used after an overrun, the newest ones; the model predicts over the time before them."""


class Rx(NamedTuple):
    """The frames since the last tick, in the order of their arrival."""

    elapsed_ticks: int
    frame_count: int
    frames: Sequence[WordFrame]


class Tx(NamedTuple):
    """The frames to be sent in this tick: `torque`, and `other` if `frame_count` is 2."""

    frame_count: int
    torque: WordFrame
    other: WordFrame


class NodeState(NamedTuple):
    """The firmware's state from one tick to the next; `inputs` and `outputs` belong to the newest tick."""

    ticks: int
    received: Received
    requests: Requests
    inputs: Inputs
    core: State
    outputs: Outputs
    waiting: Transmitter
    counters: Counters


MAY_BE_WRITTEN = (INIT, READY, FAULT, E_STOP)
"""Modes in which nothing moves and parameters may be written."""

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
    """The waiting frames after this tick, the number of lost frames, and the frames to be sent."""
    has_gait = received.gait_sensors_arrival.tick >= 0
    waiting, lost = transmitter.queued(config.tick_s, waiting, tick, before, now, has_gait)
    other = transmitter.NO_FRAME
    if now.drive_frame != NO_DRIVE_FRAME:
        position_rev = received.encoder_estimates.position_rev
        other = transmitter.drive_frame(config.drive_link, now.drive_frame, position_rev)
    elif transmitter.any_waits(waiting):
        waiting, other = transmitter.next_frame(config.tick_s, waiting, tick, core, now)
        lost += 1 if other.can_id == 0 else 0
    torque, _ = packing.pack_set_input_torque(SetInputTorque(now.torque_n_m), 0)
    return waiting, lost, Tx(1 if other.can_id == 0 else 2, torque, other)


def tick(config: Config, state: NodeState, rx: Rx) -> tuple[NodeState, Tx]:
    """Run one control period."""
    now = state.ticks + rx.elapsed_ticks
    received, requests, counters = state.received, state.requests, state.counters
    sensed, inputs = unsensed(state.core), state.inputs
    last = received.accelerometer_arrival
    late = rx.elapsed_ticks > 1 and now - last.tick < LONGEST_DATED_TICKS
    first_id = accepted = 0
    for index in range(rx.frame_count + 1):
        is_end = index == rx.frame_count
        frame = transmitter.NO_FRAME if is_end else rx.frames[index]
        if first_id == 0 and frame.can_id in (kinds.ACCELEROMETER.can_id, kinds.ENCODER_ESTIMATES.can_id):
            first_id = frame.can_id
        if is_end or (late and begins_sample(received, now, frame, first_id)):
            # The sample is complete. The newest one belongs to this tick, earlier ones to their own ticks.
            sampled = now if is_end else min(sampled_tick(last, received.accelerometer_arrival), now - 1)
            if sampled > state.ticks + sensed.ticks and now - sampled <= MOST_SAMPLES:
                inputs = inputs_of(received, now, sampled - state.ticks)
                sensed = sense(config, state.core.speed, sensed, inputs)
            if sampled < now:
                received = with_sensors_dated(received, now, sampled)
            last = received.accelerometer_arrival
        if not is_end:
            received, requests, counters, usable = receive(
                config.tick_s, received, requests, counters, now, frame
            )
            accepted += 1 if usable else 0
    core, outputs = act(config, state.core, sensed, inputs)
    waiting, lost, tx = transmitted(config, received, state.waiting, now, state.outputs, core, outputs)
    counters = counted(counters, accepted, rx.elapsed_ticks - 1, lost)
    return NodeState(now, received, requests, inputs, core, outputs, waiting, counters), tx


def answered(
    parameters: Parameters, request: ParameterRequest, mode: Mode
) -> tuple[Parameters, ParameterValue]:
    """Read or write one parameter and answer; a refused write changes nothing."""
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
    """Answer the waiting requests, and make the config from the written parameters."""
    waiting, lost = state.waiting, 0
    for index in range(state.requests.number):
        parameters, answer = answered(parameters, state.requests.waiting[index], state.outputs.mode)
        waiting, fits = transmitter.with_answer(waiting, answer)
        lost += 0 if fits else 1
    # A write repairs one parameter only, so damaged parameters remain marked as damaged.
    config = config_of(parameters, config.monitors.parameters_damaged)
    state = state._replace(
        requests=NO_REQUESTS, waiting=waiting, counters=counted(state.counters, 0, 0, lost)
    )
    return parameters, config, state
