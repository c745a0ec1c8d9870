"""The whole firmware, frames in to frames out:

    tick(config, state, inbox) -> (state, tx)

The gate takes each accelerometer frame and judges the tick's readings; the core steps; the gate permits the
torque that the core proposes; what is due is sent. A tick always advances one control period, on those frames
in the inbox that belong to this period: see `node.inbox`, which also says how many ticks are run when periods
were missed.

`config` is made from the parameters; `state` starts as `INITIAL`. `tx.frame_count` frames are sent; the first
is the torque, unless the drive's watchdog is tested or the tick runs a period that was missed.

Measurement and calibration follow the tick (`xcp.exchange`), which adds their frames to `tx`.

The module uses only the firmware's subset (floats, integers, enums, NamedTuples and tuples of them, bounded
loops, plain functions), so that one source runs interpreted, compiled by numba from within other compiled
code, and on a microcontroller.
"""

from typing import NamedTuple

from firmware_py.core.config import Config
from firmware_py.core.inputs import Inputs
from firmware_py.core.safety import gate
from firmware_py.core.safety.drive_link import NO_DRIVE_FRAME
from firmware_py.core.safety.gate import Findings, GateState
from firmware_py.core.state import INITIAL as INITIAL_CORE
from firmware_py.core.state import INITIAL_OUTPUTS, Outputs, State
from firmware_py.core.step import step
from firmware_py.interface.arrivals import NOTHING_YET, Counters, Now
from firmware_py.interface.enums import ActingLimit
from firmware_py.interface.frame import WordFrame
from firmware_py.interface.generated import kinds, packing
from firmware_py.interface.generated.received import INITIAL as NOTHING_RECEIVED
from firmware_py.interface.generated.received import Received, receive
from firmware_py.interface.generated.records import SetInputTorque
from firmware_py.node import inbox as waiting_frames
from firmware_py.node import transmitter
from firmware_py.node.readings import inputs_of
from firmware_py.node.transmitter import Transmitter
from firmware_py.node.wiring import wired_sample, wired_torque_n_m


class Tx(NamedTuple):
    """The first `frame_count` frames are to be sent in this tick, in this order."""

    frame_count: int
    first: WordFrame
    second: WordFrame
    third: WordFrame


class NodeState(NamedTuple):
    """The firmware's state from one tick to the next; `inputs` and `outputs` belong to the newest tick."""

    ticks: int
    received: Received
    inputs: Inputs
    core: State
    outputs: Outputs
    waiting: Transmitter
    counters: Counters


INITIAL = NodeState(
    ticks=0,
    received=NOTHING_RECEIVED,
    inputs=inputs_of(NOTHING_RECEIVED, 0),
    core=INITIAL_CORE,
    outputs=INITIAL_OUTPUTS,
    waiting=transmitter.INITIAL,
    counters=NOTHING_YET,
)


NO_TX = Tx(0, transmitter.NO_FRAME, transmitter.NO_FRAME, transmitter.NO_FRAME)


def add_frame(tx: Tx, frame: WordFrame) -> Tx:
    """`tx` with one more frame behind the others; `NO_FRAME` adds none."""
    if frame.can_id == 0:
        return tx
    if tx.frame_count == 0:
        return Tx(1, frame, tx.second, tx.third)
    if tx.frame_count == 1:
        return Tx(2, tx.first, frame, tx.third)
    return Tx(3, tx.first, tx.second, frame)


def permit(
    config: Config,
    core: State,
    outputs: Outputs,
    gate_now: GateState,
    found: Findings,
    inputs: Inputs,
    is_current: bool,
) -> tuple[State, Outputs]:
    """The gate's last word on the torque; a tick that catches up keeps the torque that was sent."""
    gate_now, torque_n_m, limit = gate.permit(config.gate, gate_now, found, inputs, outputs.torque_n_m)
    core = core._replace(gate=gate_now)
    if limit != ActingLimit.NONE:
        outputs = outputs._replace(acting_limit=limit)
    if limit != ActingLimit.NONE and is_current:
        core = core._replace(speed=core.speed._replace(torque_n_m=torque_n_m))
        outputs = outputs._replace(torque_n_m=torque_n_m)
    return core, outputs


def transmit(
    config: Config,
    waiting: Transmitter,
    before: Outputs,
    tick: int,
    received: Received,
    core: State,
    now: Outputs,
    behind_ticks: int,
) -> tuple[Transmitter, int, Tx]:
    """The waiting frames after this tick, the number of lost frames, and the frames to be sent."""
    has_gait = received.gait_sensors_arrival.tick >= 0
    waiting, lost = transmitter.queue_events(waiting, tick, before, now)
    waiting = transmitter.queue_cyclic(config, waiting, tick, now, has_gait)
    other = transmitter.NO_FRAME
    if now.drive_frame != NO_DRIVE_FRAME:
        position_rev = received.encoder_estimates.position_rev
        other = transmitter.pack_drive_frame(config, now.drive_frame, position_rev)
    elif waiting.waiting != 0:
        waiting, other = transmitter.next_frame(config, waiting, tick + behind_ticks, core, now)
        lost += 1 if other.can_id == 0 else 0
    tx = NO_TX
    if not now.withholds and behind_ticks == 0:
        torque, _ = packing.pack_set_input_torque(SetInputTorque(wired_torque_n_m(config, now.torque_n_m)), 0)
        tx = add_frame(tx, torque)
    return waiting, lost, add_frame(tx, other)


def tick(config: Config, state: NodeState, inbox: list[int]) -> tuple[NodeState, Tx]:
    """Run one control period; the inbox is only read."""
    now = Now(tick=state.ticks + 1, tick_s=config.tick_s)
    received, counters = state.received, state.counters
    gate_now = state.core.gate
    accepted, behind_ticks = inbox[waiting_frames.ESTOP], waiting_frames.behind_ticks(inbox)
    if inbox[waiting_frames.ESTOP] != 0:
        estop_arrival = received.drive_estop_arrival._replace(tick=now.tick)
        received = received._replace(drive_estop_arrival=estop_arrival)
    for number in range(inbox[waiting_frames.TAKEN], inbox[waiting_frames.RECEIVED]):
        index = waiting_frames.index_of(number)
        if inbox[index] >> waiting_frames.BEHIND_BIT == behind_ticks:
            frame = waiting_frames.frame_at(inbox, index)
            received, counters, usable = receive(now, received, counters, frame)
            accepted += 1 if usable else 0
            if usable and frame.can_id == kinds.ACCELEROMETER.can_id:
                received = received._replace(accelerometer=wired_sample(config, received.accelerometer))
                counter = received.accelerometer_arrival.counter
                gate_now = gate.take(config.gate, gate_now, received.accelerometer, counter)
    inputs = inputs_of(received, now.tick)
    gate_now, found = gate.judge(config.gate, gate_now, inputs)
    core, outputs = step(config, state.core, inputs, found, behind_ticks == 0)
    core, outputs = permit(config, core, outputs, gate_now, found, inputs, is_current=behind_ticks == 0)
    waiting, lost, tx = transmit(
        config,
        state.waiting,
        before=state.outputs,
        tick=now.tick,
        received=received,
        core=core,
        now=outputs,
        behind_ticks=behind_ticks,
    )
    counters = counters._replace(
        frames=counters.frames + accepted,
        skipped_ticks=counters.skipped_ticks + (1 if behind_ticks > 0 else 0),
        unsent=counters.unsent + lost,
    )
    return NodeState(
        ticks=now.tick,
        received=received,
        inputs=inputs,
        core=core,
        outputs=outputs,
        waiting=waiting,
        counters=counters,
    ), tx
