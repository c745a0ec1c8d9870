"""The closed loop of plant, drive, sensors, operator and firmware in one compiled call, tick by tick.

`run` executes the same steps as `hil.runs.lockstep`, in the same order and with bit-identical results, while
no work in Python is required: no fault begins or ends, the bus is ideal, and the frames of operator and gait
sensors are known in advance. Where only the plant needs none, Python runs the others (`exchange`).
It consists of the nodes' own pure steps (`hil.drive.node`, `hil.drive.reports`,
`plant_sim.sensors.readings`, `firmware_py.node.tick`) and the plant's solver. Records and frames are written
into the caller's buffers.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.builds.numba_subset import register
from firmware_py.interface.frame import WordFrame
from hil.nodes.compiled import kernel
from hil.nodes.plant_steps import (
    MOST_FRAMES,
    Due,
    PlantState,
    Setup,
    encoder_sample,
    move_on,
    obey_frames,
    publish,
    put,
    record_plant,
)
from plant_sim.kernels import call_at, subroutine
from plant_sim.sensors.readings import Readers, read_sensors
from plant_sim.solvers.adaptive.adaptive import DONE
from plant_sim.solvers.adaptive.state_layout import OBSERVED, Run

register()

Vector = NDArray[np.float64]
Integers = NDArray[np.int64]
Bytes = NDArray[np.uint8]

EXCHANGE_FAILED = -1
"""Status of `run` in addition to the solver's: Python raised an exception."""
MOST_RECEIVED = MOST_FRAMES + 1
"""Most frames to the firmware per tick: those of the plant's node, and a command."""
NUMBER_BYTES = 8
"""Length of a number in the firmware's memory."""


class Firmware(NamedTuple):
    """The firmware (`firmware_py.shell.native`): addresses of its functions and its memory.

    `frames`: received frames, shape (MOST_RECEIVED, 3).
    `sent`: the number of sent frames, and three frames. `record_bytes`: length of a recorded row.
    """

    receive: int
    tick: int
    config: int
    state: int
    frames: Integers
    sent: Integers
    state_bytes: Bytes
    record_bytes: int


class Buffers(NamedTuple):
    """Memory for the records of one call, and the numbers of what it holds in `used`.

    `plant`: rows that begin with the numbers of `PlantRecord`; `plant_whole`: the same memory as integers.
    `firmware`: packed rows, copied from the firmware's memory by `moves` (rows of source, destination and
    length in bytes). `frames`: rows of time in µs, identifier, length and word; empty if they are not kept.
    """

    plant: Vector
    plant_whole: Integers
    firmware: Bytes
    moves: Integers
    frames: Integers
    used: Integers


TICKS, FRAMES, TO_PLANT, COMMAND, STOP = range(5)
"""Indices in `Buffers.used`: completed ticks, frames on the bus, frames in transit to the plant, the next row
of the operator's frames, and whether to stop after this tick."""


class Bench(NamedTuple):
    """All that ticks work on; it changes through its arrays alone.

    `period_ns`: duration of a tick. `to_plant`: frames in transit to the plant, rows of identifier, length
    and word. `commands`: the operator's frames, rows of tick, identifier, length and word, in order of time.
    `noise`: four standard normals for each tick. `exchange`: 0, or the address of a function that runs all
    nodes but the plant up to its next step: it receives the number of the plant's frames, rows of
    `firmware.frames`, and returns the number of those in `to_plant`; if they are full it is called again,
    with -1, for the others. A negative number ends the run.
    """

    period_s: float
    period_ns: int
    module: Run
    readers: Readers
    setup: Setup
    due: Due
    noise: Vector
    commands: Integers
    to_plant: Integers
    firmware: Firmware
    buffers: Buffers
    exchange: int


@subroutine
def record_firmware(rows: Bytes, start: int, state: Bytes, moves: Integers) -> None:
    """Record a tick of the firmware in the row that begins at `start`."""
    for move in range(moves.shape[0]):
        source, destination, length = moves[move, 0], start + moves[move, 1], moves[move, 2]
        if length == NUMBER_BYTES:  # a copy of known length is one instruction
            for byte in range(NUMBER_BYTES):
                rows[destination + byte] = state[source + byte]
        else:
            for byte in range(length):
                rows[destination + byte] = state[source + byte]


@subroutine
def log_frame(buffers: Buffers, t_us: int, frame: WordFrame) -> None:
    """Write a frame's row, if frames are kept."""
    frames, row = buffers.frames, buffers.used[FRAMES]
    if frames.shape[0] == 0:
        return
    frames[row, 0], frames[row, 1], frames[row, 2], frames[row, 3] = (
        t_us,
        frame.can_id,
        frame.length,
        frame.word,
    )
    buffers.used[FRAMES] = row + 1


@subroutine
def log_rows(buffers: Buffers, t_us: int, rows: Integers, count: int) -> None:
    """Write the rows of the first `count` frames in `rows`."""
    for row in range(count):
        log_frame(buffers, t_us, WordFrame(rows[row, 0], rows[row, 1], rows[row, 2]))


@subroutine(inline=True)
def plant_turn(bench: Bench, state: PlantState) -> tuple[PlantState, int, int]:
    """The plant at t_k publishes to the firmware, obeys the frames that have arrived, and advances.

    Returns its state, the number of frames in the firmware's inbox, and the solver's status.
    """
    setup, buffers, observed = bench.setup, bench.buffers, bench.module.memory[0].observed
    row, tick = buffers.used[TICKS], state.tick
    omega_rad_s, readings = observed[OBSERVED.omega_rad_s], bench.module.probe.readings
    reading = read_sensors(bench.readers, readings, observed[OBSERVED.crank_rad], bench.noise[row])
    sample = encoder_sample(state.drive, reading)
    state, count = publish(setup, bench.due, observed, state, reading, sample, bench.firmware.frames)
    log_rows(buffers, tick * bench.period_ns // 1000, bench.firmware.frames, count)
    if bench.exchange != 0:
        most = bench.to_plant.shape[0]
        arrived = call_at(bench.exchange, (count,))
        while arrived == most:
            state = obey_frames(setup.drive, state, reading, omega_rad_s, bench.to_plant, most)
            arrived = call_at(bench.exchange, (-1,))
        if arrived < 0:
            return state, count, EXCHANGE_FAILED
        buffers.used[TO_PLANT] = arrived
    state = obey_frames(setup.drive, state, reading, omega_rad_s, bench.to_plant, buffers.used[TO_PLANT])
    buffers.used[TO_PLANT] = 0
    whole = buffers.plant_whole[row]
    record_plant(buffers.plant[row], whole, tick * bench.period_s, observed, state, reading)
    drive, status = move_on(bench.module, setup.drive, state.drive, state.torque_n_m, bench.period_s)
    return state._replace(drive=drive), count, status


@subroutine
def operator_turn(bench: Bench, tick: int, count: int) -> int:
    """The operator at t_k sends to firmware and plant; returns the number of frames in the inbox."""
    buffers, row = bench.buffers, bench.buffers.used[COMMAND]
    if row < bench.commands.shape[0] and bench.commands[row, 0] == tick:
        command = WordFrame(bench.commands[row, 1], bench.commands[row, 2], bench.commands[row, 3])
        buffers.used[COMMAND] = row + 1
        buffers.used[TO_PLANT] = put(bench.to_plant, buffers.used[TO_PLANT], command)
        log_frame(buffers, tick * bench.period_ns // 1000, command)
        count = put(bench.firmware.frames, count, command)
    return count


@subroutine(inline=True)
def firmware_turn(bench: Bench, tick: int, count: int) -> None:
    """The firmware at t_k + T/2 ticks on the first `count` frames of its inbox."""
    firmware, buffers = bench.firmware, bench.buffers
    frames, sent = firmware.frames.ctypes.data, firmware.sent.ctypes.data
    call_at(firmware.receive, (firmware.state, count, frames))
    call_at(firmware.tick, (firmware.config, firmware.state, sent))
    for place in range(firmware.sent[0]):
        begin = 1 + 3 * place
        frame = WordFrame(firmware.sent[begin], firmware.sent[begin + 1], firmware.sent[begin + 2])
        log_frame(buffers, (tick * bench.period_ns + bench.period_ns // 2) // 1000, frame)
        buffers.used[TO_PLANT] = put(bench.to_plant, buffers.used[TO_PLANT], frame)
    row = buffers.used[TICKS]
    record_firmware(buffers.firmware, row * firmware.record_bytes, firmware.state_bytes, buffers.moves)


@kernel
def run(bench: Bench, state: PlantState, ticks: int) -> tuple[PlantState, int]:
    """Run `ticks`; return the plant's state and the status: the solver's, or EXCHANGE_FAILED.

    After a failure the state is that of the failed tick.
    """
    for _ in range(ticks):
        state, count, status = plant_turn(bench, state)
        if status != DONE:
            return state, status
        if bench.exchange == 0:
            count = operator_turn(bench, state.tick, count)
            firmware_turn(bench, state.tick, count)
        bench.buffers.used[TICKS] += 1
        state = state._replace(tick=state.tick + 1)
        if bench.buffers.used[STOP] != 0:
            break
    return state, DONE
