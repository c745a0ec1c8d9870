"""The closed loop of plant, drive, sensors, operator and firmware in one compiled call, tick by tick.

`run` executes the same steps as `hil.bench.lockstep`, in the same order and with bit-identical results, while
no work in Python is required: no fault begins or ends, the bus is ideal, and the frames of operator and gait
sensors are known in advance. It consists of the nodes' own pure steps (`hil.drive.node`, `hil.drive.reports`,
`plant_sim.sensors.readings`, `firmware_py.node.tick`) and the plant's solver. Records are written as bytes
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

MOST_RECEIVED = MOST_FRAMES + 1
"""Most frames to the firmware per tick: those of the plant's node, and a command."""
NUMBER_BYTES = 8
"""Length of a number in the firmware's memory."""
LINE_BYTES = 48
"""Upper bound on the length of a line of can.log."""


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
    """Buffers for the records of one call, and their numbers in `used`; an empty `can_log` receives no lines.

    `plant`: rows of numbers in the order of `PlantRecord`. `firmware`: packed rows, copied from the
    firmware's memory by `moves` (rows of source, destination and length in bytes). `can_log`: lines.
    """

    plant: Vector
    firmware: Bytes
    moves: Integers
    can_log: Bytes
    used: Integers


TICKS, LOG_BYTES, TO_PLANT, COMMAND = range(4)
"""Indices in `Buffers.used`: completed ticks, bytes of can.log, frames in transit to the plant, and the next
row of the operator's frames."""


class Bench(NamedTuple):
    """All that ticks work on; it changes through its arrays alone.

    `period_ns`: duration of a tick. `to_plant`: frames in transit to the plant, rows of identifier, length
    and word. `commands`: the operator's frames, rows of tick, identifier, length and word, in order of time.
    `noise`: four standard normals for each tick.
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
def hexadecimal(value: int) -> int:
    """The character code of a hexadecimal digit."""
    return 48 + value if value < 10 else 55 + value


@subroutine
def log_line(buffer: Bytes, start: int, t_us: int, frame: WordFrame) -> int:
    """Write a line of can.log, `(seconds.micros) can0 ID#DATA`; returns the index after it."""
    seconds, micros = t_us // 1_000_000, t_us % 1_000_000
    buffer[start] = 40
    digits, rest = 1, seconds
    while rest >= 10:
        digits, rest = digits + 1, rest // 10
    for place in range(digits):
        buffer[start + digits - place] = 48 + seconds % 10
        seconds //= 10
    start += digits + 1
    buffer[start] = 46
    for place in range(6):
        buffer[start + 6 - place] = 48 + micros % 10
        micros //= 10
    start += 7
    for character in (41, 32, 99, 97, 110, 48, 32):  # ") can0 "
        buffer[start] = character
        start += 1
    for place in range(3):
        buffer[start + place] = hexadecimal(frame.can_id >> (8 - 4 * place) & 15)
    buffer[start + 3] = 35
    start += 4
    for place in range(frame.length):
        byte = frame.word >> 8 * place & 255
        buffer[start] = hexadecimal(byte >> 4)
        buffer[start + 1] = hexadecimal(byte & 15)
        start += 2
    buffer[start] = 10
    return start + 1


@subroutine
def log_frame(buffers: Buffers, t_us: int, frame: WordFrame) -> None:
    """Write a line of can.log, if the log is kept."""
    if buffers.can_log.size == 0:
        return
    buffers.used[LOG_BYTES] = log_line(buffers.can_log, buffers.used[LOG_BYTES], t_us, frame)


@subroutine
def log_rows(buffers: Buffers, t_us: int, rows: Integers, count: int) -> None:
    """Write the lines of the first `count` frames in `rows`."""
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
    state = obey_frames(setup.drive, state, reading, omega_rad_s, bench.to_plant, buffers.used[TO_PLANT])
    buffers.used[TO_PLANT] = 0
    record_plant(buffers.plant[row], tick * bench.period_s, observed, state, reading)
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
    buffers.used[TICKS] = row + 1


@kernel
def run(bench: Bench, state: PlantState, ticks: int) -> tuple[PlantState, int]:
    """Run `ticks`; return the plant's state and the solver's status.

    After a failure the state is that of the failed tick.
    """
    for _ in range(ticks):
        state, count, status = plant_turn(bench, state)
        if status != DONE:
            return state, status
        count = operator_turn(bench, state.tick, count)
        firmware_turn(bench, state.tick, count)
        state = state._replace(tick=state.tick + 1)
    return state, DONE
