"""The closed loop of plant, drive, sensors, operator and firmware in one compiled call, tick by tick.

`run` executes the same steps as `hil.runs.lockstep`, in the same order and with bit-identical results. It
calls Python (`Bench.call_python`) for the operator's steps, and where frames that a fault names leave their
node. Without a firmware, Python runs all nodes but the plant, whose frames are then all named.
It consists of the nodes' own pure steps (`hil.drive.node`, `hil.drive.reports`,
`plant_sim.sensors.readings`, `firmware_py.node.tick`) and the plant's solver. Records and frames are written
into the caller's buffers.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.builds.numba_subset import register
from firmware_py.interface.frame import WordFrame
from hil.bus.model.bits import INTERMISSION_BITS, bits_on_wire
from hil.nodes.compiled import kernel
from hil.nodes.operator.node import RECEIVED_IDS
from hil.nodes.plant.steps import (
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
from hil.timing.clock import NS_PER_US
from plant_sim.kernels import call_at, subroutine
from plant_sim.sensors.readings import Readers, read_sensors
from plant_sim.solvers.adaptive.adaptive import DONE
from plant_sim.solvers.adaptive.state_layout import OBSERVED, Run

register()

Vector = NDArray[np.float64]
Integers = NDArray[np.int64]
Bytes = NDArray[np.uint8]

PLANT, OPERATOR, FIRMWARE, BUS_BEFORE, BUS_AFTER = range(5)
"""The nodes for which Python is called, and the bus before and after the firmware's turn."""
NUMBER_BYTES = 8
"""Length of a number in the firmware's memory."""


class Firmware(NamedTuple):
    """The firmware (`firmware_py.shell.native`): addresses of its functions and its memory.

    The addresses are 0 where Python runs it. `turns`: rows of the bench's tick, counted from the call's
    first, and the periods since the turn before; a firmware that is paused or whose clock is wrong has none
    or several in a tick. `sent`: the number of sent frames, and three frames. `record_bytes`: length of a
    recorded row.
    """

    receive: int
    advance: int
    tick: int
    turns: Integers
    config: int
    state: int
    sent: Integers
    state_bytes: Bytes
    record_bytes: int


NO_FIRMWARE = Firmware(
    receive=0,
    advance=0,
    tick=0,
    turns=np.zeros((0, 2), np.int64),
    config=0,
    state=0,
    sent=np.zeros(1, np.int64),
    state_bytes=np.zeros(0, np.uint8),
    record_bytes=0,
)
"""Of a bench on which Python runs it."""


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


TICKS, TURNS, FRAMES, TO_PLANT, TO_OPERATOR, OPERATOR_TICK, STOP, BUSY, HELD = range(9)
"""Indices in `Buffers.used`: completed ticks and the firmware's turns, frames on the bus, frames in transit
to the plant and to the operator, the tick of the operator's next step, whether to stop (1: after this tick,
`AT_ONCE`), whether Python runs the bus because it does not rest between two turns, and from `HELD` on the
number of frames that faults hold back at each node."""
USED = HELD + 3
"""Length of `Buffers.used`."""
WORD_32 = 0xFFFFFFFF
"""What of a register a result of 32 bits fills."""
AT_ONCE = 2
"""Value of `Buffers.used[STOP]` after an exception in Python."""


class Bench(NamedTuple):
    """All that ticks work on; it changes through its arrays alone.

    `period_ns`: duration of a tick. `middle_ns`: time of the firmware's turn in it. `bit_ns`: duration of a
    bit, 0 on a bus without delay. `to_firmware`, `to_plant`, `to_operator`: frames in transit, rows of
    identifier, length and word; of those to the operator, what it receives. `noise`: four standard normals
    for each tick. `named`: for each identifier, whether faults act on its frames. `call_python`: address of
    a function of a node, or of the bus, and of the first row and the end of the frames that leave it, in
    `to_firmware` or, from the firmware on, in `to_plant`; it may change them, and returns their new end.
    """

    period_s: float
    period_ns: int
    middle_ns: int
    bit_ns: int
    run: Run
    readers: Readers
    setup: Setup
    due: Due
    noise: Vector
    to_firmware: Integers
    to_plant: Integers
    to_operator: Integers
    named: Bytes
    firmware: Firmware
    buffers: Buffers
    call_python: int


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
    """Count a frame, and write its row if there is memory for it."""
    frames, row = buffers.frames, buffers.used[FRAMES]
    if row < frames.shape[0]:
        frames[row, 0], frames[row, 1], frames[row, 2], frames[row, 3] = (
            t_us,
            frame.can_id,
            frame.length,
            frame.word,
        )
    buffers.used[FRAMES] = row + 1


@subroutine
def log_rows(buffers: Buffers, t_us: int, rows: Integers, first: int, end: int) -> None:
    """Write the frames in `rows` from `first` to `end`."""
    for row in range(first, end):
        log_frame(buffers, t_us, WordFrame(rows[row, 0], rows[row, 1], rows[row, 2]))


@subroutine
def sort_by_priority(rows: Integers, first: int, end: int) -> None:
    """Sort the frames in `rows` by identifier, the lowest first, as a bus sends frames that wait."""
    for last in range(first + 1, end):
        row = last
        while row > first and rows[row - 1, 0] > rows[row, 0]:
            for column in range(3):
                rows[row - 1, column], rows[row, column] = rows[row, column], rows[row - 1, column]
            row -= 1


@subroutine
def arrive(bench: Bench, sent_ns: int, due_ns: int, rows: Integers, first: int, end: int) -> bool:
    """Let the frames in `rows` from `first` to `end` arrive, sent at once on a bus at rest, and log them.

    A modelled bus sorts them, and it is busy until after `due_ns` if the result is False; then nothing is
    logged, and not all frames arrive in time.
    """
    buffers, bit_ns = bench.buffers, bench.bit_ns
    if bit_ns == 0:
        log_rows(buffers, sent_ns // NS_PER_US, rows, first, end)
        return True
    sort_by_priority(rows, first, end)
    before, idle_bit = buffers.used[FRAMES], -(-sent_ns // bit_ns)
    for row in range(first, end):
        frame = WordFrame(rows[row, 0], rows[row, 1], rows[row, 2])
        idle_bit += bits_on_wire(frame.can_id, frame.length, frame.word)
        log_frame(buffers, (idle_bit - INTERMISSION_BITS) * bit_ns // NS_PER_US, frame)
    is_in_time: bool = idle_bit * bit_ns <= due_ns
    if not is_in_time:
        buffers.used[FRAMES] = before
    return is_in_time


@subroutine
def pass_to_firmware(bench: Bench, tick: int, count: int) -> int:
    """Let the first `count` frames pass to the firmware; return the number that arrive before its turn."""
    used = bench.buffers.used
    sent_ns = tick * bench.period_ns
    if used[BUSY] == 0 and not arrive(bench, sent_ns, sent_ns + bench.middle_ns, bench.to_firmware, 0, count):
        used[BUSY] = 1
    if used[BUSY] != 0:
        count = call_at(bench.call_python, (BUS_BEFORE, 0, count))
    return count


@subroutine
def pass_from_firmware(bench: Bench, tick: int, first: int, end: int) -> None:
    """Let the firmware's frames in `to_plant`, from `first` to `end`, pass to plant and operator."""
    rows, used = bench.to_plant, bench.buffers.used
    used[TO_PLANT] = end
    if used[BUSY] != 0:
        call_at(bench.call_python, (BUS_AFTER, first, end))
        return
    begin_ns = tick * bench.period_ns
    arrive(bench, begin_ns + bench.middle_ns, begin_ns + bench.period_ns, rows, first, end)
    for row in range(first, end):
        if rows[row, 0] in RECEIVED_IDS:
            frame = WordFrame(rows[row, 0], rows[row, 1], rows[row, 2])
            used[TO_OPERATOR] = put(bench.to_operator, used[TO_OPERATOR], frame)


@subroutine
def leave(bench: Bench, node: int, rows: Integers, first: int, end: int) -> int:
    """Let the frames from `first` to `end` leave a node; the new end, after the faults that act on them."""
    is_faulty = bench.buffers.used[HELD + node] != 0
    for row in range(first, end):
        is_faulty = is_faulty or bench.named[rows[row, 0]] != 0
    if is_faulty:
        end = call_at(bench.call_python, (node, first, end))
    return end


@subroutine(inline=True)
def plant_turn(bench: Bench, state: PlantState) -> tuple[PlantState, int, int]:
    """The plant at t_k publishes to the firmware, obeys the frames that have arrived, and advances.

    Returns its state, the number of frames in the firmware's inbox, and the solver's status.
    """
    setup, buffers, observed = bench.setup, bench.buffers, bench.run.memory[0].observed
    row, tick = buffers.used[TICKS], state.tick
    omega_rad_s, readings = observed[OBSERVED.omega_rad_s], bench.run.probe.readings
    reading = read_sensors(bench.readers, readings, observed[OBSERVED.crank_rad], bench.noise[row])
    sample = encoder_sample(state.drive, reading)
    state, count = publish(setup, bench.due, observed, state, reading, sample, bench.to_firmware)
    count = leave(bench, PLANT, bench.to_firmware, 0, count)
    state = obey_frames(setup.drive, state, reading, omega_rad_s, bench.to_plant, buffers.used[TO_PLANT])
    buffers.used[TO_PLANT] = 0
    whole = buffers.plant_whole[row]
    record_plant(buffers.plant[row], whole, tick * bench.period_s, observed, state, reading)
    drive, status = move_on(bench.run, setup.drive, state.drive, state.torque_n_m, bench.period_s)
    return state._replace(drive=drive), count, status


@subroutine
def operator_turn(bench: Bench, tick: int, count: int) -> int:
    """The operator at t_k sends to firmware and plant; returns the number of frames for the firmware."""
    buffers, rows = bench.buffers, bench.to_firmware
    if tick < buffers.used[OPERATOR_TICK]:
        return count
    end: int = call_at(bench.call_python, (OPERATOR, count, count))
    for row in range(count, end):
        frame = WordFrame(rows[row, 0], rows[row, 1], rows[row, 2])
        buffers.used[TO_PLANT] = put(bench.to_plant, buffers.used[TO_PLANT], frame)
    return end


@subroutine(inline=True)
def firmware_turns(bench: Bench, tick: int, count: int) -> None:
    """The firmware at t_k + T/2 receives the first `count` frames, and runs its turns of this tick."""
    firmware, buffers, rows = bench.firmware, bench.buffers, bench.to_plant
    used, turns, sent = buffers.used, firmware.turns, firmware.sent
    call_at(firmware.receive, (firmware.state, count, bench.to_firmware.ctypes.data))
    while used[TURNS] < turns.shape[0] and turns[used[TURNS], 0] == used[TICKS]:
        elapsed_ticks = turns[used[TURNS], 1]
        periods = 1
        if elapsed_ticks != 1:
            periods = call_at(firmware.advance, (firmware.config, firmware.state, elapsed_ticks)) & WORD_32
        first = end = used[TO_PLANT]
        for _ in range(periods):
            call_at(firmware.tick, (firmware.config, firmware.state, sent.ctypes.data))
            for begin in range(1, 1 + 3 * sent[0], 3):
                end = put(rows, end, WordFrame(sent[begin], sent[begin + 1], sent[begin + 2]))
        pass_from_firmware(bench, tick, first, leave(bench, FIRMWARE, rows, first, end))
        start = used[TURNS] * firmware.record_bytes
        record_firmware(buffers.firmware, start, firmware.state_bytes, buffers.moves)
        used[TURNS] += 1


@kernel
def run(bench: Bench, state: PlantState, ticks: int) -> tuple[PlantState, int]:
    """Run `ticks`; return the plant's state and the solver's status.

    After a failure, of the solver or in Python, the state is that of the failed tick.
    """
    used = bench.buffers.used
    for _ in range(ticks):
        state, count, status = plant_turn(bench, state)
        if status == DONE and bench.firmware.tick != 0:
            count = operator_turn(bench, state.tick, count)
            firmware_turns(bench, state.tick, pass_to_firmware(bench, state.tick, count))
        if status != DONE or used[STOP] == AT_ONCE:
            return state, status
        used[TICKS] += 1
        state = state._replace(tick=state.tick + 1)
        if used[STOP] != 0:
            break
    return state, DONE
