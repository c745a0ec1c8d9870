"""The closed loop of plant, drive, sensors, operator and firmware in one compiled call, tick by tick.

`run` executes the same steps as `hil.bench.lockstep`, in the same order and with bit-identical results, while
no work in Python is required: no fault begins or ends, the bus is ideal, and the frames of operator and gait
sensors are known in advance. It consists of the nodes' own pure steps (`hil.drive.node`, `hil.drive.reports`,
`plant_sim.sensors.readings`, `firmware_py.node.tick`) and the plant's solver. Records are written as bytes
into the caller's buffers.
"""

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from firmware_py.builds.numba_subset import register
from firmware_py.interface.frame import WordFrame
from firmware_py.interface.generated import packing
from firmware_py.interface.generated.records import Accelerometer
from hil.drive import axis, messages
from hil.drive.axis import TIME_RESOLUTION_S, DriveConfig, DriveState, Telemetry
from hil.drive.node import obey, report_frame
from hil.drive.reports import NOTHING, Reports, Ticks, look, take
from hil.nodes.compiled import kernel
from hil.nodes.sampled import COUNTER, NOISE, TICK, WHICH, sampled_frame
from plant_sim.kernels import inlined, shared
from plant_sim.parts.parts import Parts
from plant_sim.sensors.readings import Readers, SensorReading, read_sensors
from plant_sim.sensors.sampled import SAMPLED, SampledSensor
from plant_sim.sensors.sensing import Probe, Sensing
from plant_sim.solvers.adaptive.adaptive import BUFFER_FULL, DONE, advance
from plant_sim.solvers.adaptive.state_layout import (
    OBSERVED,
    Grid,
    Memory,
)

register()

Vector = NDArray[np.float64]
Integers = NDArray[np.int64]
Bytes = NDArray[np.uint8]

FIRMWARE_FAILED = -1
"""Status of `run` in addition to the solver's: the firmware's arithmetic failed."""
MOST_FRAMES = 5 + len(SAMPLED)
"""Most frames to the firmware per tick: two samples, gait and sampled sensors, a report and a command."""
NO_FRAME = WordFrame(0, 0, 0)
LINE_BYTES = 48
"""Upper bound on the length of a line of can.log."""
TORQUE_SENT, OTHER_SENT = 1, 4
"""Indices of the two frames in `Firmware.sent`; index 0 holds their number."""


class Firmware(NamedTuple):
    """The firmware (`firmware_py.shell.native`): addresses of its function and its memory.

    `done`: the function's status on success. `frames`: received frames, shape (MOST_FRAMES, 3). `sent`: the
    number of sent frames, and two frames.
    """

    tick: int
    done: int
    config: int
    state: int
    frames: Integers
    sent: Integers
    state_bytes: Bytes


def _call_tick(
    _: Any, tick: Any, config: Any, state: Any, elapsed_ticks: Any, count: Any, frames: Any, sent: Any
) -> Any:
    """Call the firmware's function at the address `tick`; pointers are addresses, its status has 32 bits."""

    def generate(_: Any, builder: Any, signature: Any, values: Any) -> Any:
        number, pointer = ir.IntType(64), ir.IntType(8).as_pointer()
        kinds = [pointer, pointer, number, number, pointer, pointer]
        function = builder.inttoptr(values[0], ir.FunctionType(ir.IntType(32), kinds).as_pointer())
        passed = [
            builder.inttoptr(value, kind) if kind is pointer else value
            for value, kind in zip(values[1:], kinds, strict=True)
        ]
        return builder.sext(builder.call(function, passed), number)

    return types.int64(*[types.int64] * 7), generate


call_tick: Any = intrinsic(_call_tick)


class Constants(NamedTuple):
    """Constants of a call. `period_ns`: duration of a tick."""

    period_s: float
    period_ns: int
    readers: Readers
    sampled: tuple[SampledSensor, ...]
    drive: DriveConfig
    report_ticks: Ticks
    firmware_record_bytes: int


class Held(NamedTuple):
    """Frames in transit to the plant, in this order; `NO_FRAME` for an empty place."""

    first: WordFrame
    second: WordFrame
    third: WordFrame


class Loop(NamedTuple):
    """State between two ticks, apart from the memory of plant and firmware.

    `t_rest_s`: rounding error of `t_s`. `torque_n_m`: the torque last requested of the motor.
    """

    tick: int
    t_s: float
    t_rest_s: float
    torque_n_m: float
    drive: DriveState
    reports: Reports
    counter: int
    held: Held


class Buffers(NamedTuple):
    """Buffers for the records of one call, and their numbers in `used`; an empty `can_log` receives no lines.

    `plant`: rows of numbers in the order of `PlantRecord`. `firmware`: packed rows, copied from the
    firmware's memory by `moves` (rows of source, destination and length in bytes). `impacts`: rows in the
    plant's format. `can_log`: lines.
    """

    plant: Vector
    firmware: Bytes
    moves: Integers
    impacts: NDArray[np.void]
    can_log: Bytes
    used: Integers


TICKS, IMPACT_ROWS, LOG_BYTES = range(3)
"""Indices in `Buffers.used`."""


@shared
def record_plant(
    row: Vector,
    tick: int,
    t_s: float,
    observed: Vector,
    torque_n_m: float,
    drive: DriveState,
    reading: SensorReading,
) -> None:
    """Record a tick of the plant."""
    row[0], row[1] = tick, t_s
    for which in range(observed.size):
        row[2 + which] = observed[which]
    place = 2 + observed.size
    row[place], row[place + 1], row[place + 2] = torque_n_m, drive.axis.state.value, drive.axis.errors
    row[place + 3], row[place + 4] = reading.striker_low_m_s2, reading.striker_high_m_s2
    row[place + 5], row[place + 6] = reading.housing_m_s2, reading.encoder_position_rev
    row[place + 7] = reading.encoder_velocity_rev_s


@shared
def record_firmware(rows: Bytes, start: int, state: Bytes, moves: Integers) -> None:
    """Record a tick of the firmware in the row that begins at `start`."""
    for move in range(moves.shape[0]):
        source, destination, length = moves[move, 0], start + moves[move, 1], moves[move, 2]
        for byte in range(length):
            rows[destination + byte] = state[source + byte]


@shared
def hexadecimal(value: int) -> int:
    """The character code of a hexadecimal digit."""
    return 48 + value if value < 10 else 55 + value


@shared
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


@shared
def accelerometer_frame(reading: SensorReading, counter: int) -> WordFrame:
    """The frame of the accelerometers' sample."""
    sample = Accelerometer(reading.striker_low_m_s2, reading.striker_high_m_s2, reading.housing_m_s2)
    return packing.pack_accelerometer(sample, counter)[0]


@shared
def encoder_frame(drive: DriveState, reading: SensorReading) -> WordFrame:
    """The frame of the drive's encoder sample."""
    estimates = messages.encoder_estimates(
        drive, reading.encoder_position_rev, reading.encoder_velocity_rev_s
    )
    return packing.pack_encoder_estimates(estimates, 0)[0]


@shared
def later(t_s: float, t_rest_s: float, dt_s: float) -> tuple[float, float]:
    """Add `dt_s` to a time and its rounding error (Neumaier's sum, as in `plant_sim.plant`)."""
    sum_s = t_s + dt_s
    return sum_s, t_rest_s + ((t_s - sum_s) + dt_s)


@inlined
def move(
    parts: Parts,
    probe: Probe,
    memory: Memory,
    buffers: Buffers,
    torque_n_m: float,
    t_s: float,
    dt_s: float,
    no_grid: Grid,
) -> int:
    """Advance by `dt_s` under constant torque; store finished impacts; return the solver's status."""
    memory.held[0].elapsed_s = memory.held[0].elapsed_low_s = 0.0
    while True:
        status = advance(parts, probe, memory, torque_n_m, t_s, dt_s, no_grid)
        for row in range(memory.mode[0].impacts):
            place = buffers.used[IMPACT_ROWS]
            if place < buffers.impacts.shape[0]:
                buffers.impacts[place] = memory.impacts[row]
                buffers.used[IMPACT_ROWS] = place + 1
        memory.mode[0].impacts = 0
        if status != BUFFER_FULL:
            return status


@inlined
def move_on(
    parts: Parts,
    probe: Probe,
    memory: Memory,
    buffers: Buffers,
    config: DriveConfig,
    drive: DriveState,
    torque_n_m: float,
    t_s: float,
    t_rest_s: float,
    period_s: float,
    no_grid: Grid,
) -> tuple[DriveState, float, float, float, int]:
    """Advance by a tick, from the expiry of the drive's watchdog on without torque.

    Returns the drive's state, the last torque, the time and its rounding error, and the solver's status.
    """
    armed_s = min(period_s, axis.watchdog_left_s(config, drive))
    status, dt_s = DONE, armed_s
    for is_armed in (True, False):
        if dt_s > 0.0:
            status = move(parts, probe, memory, buffers, torque_n_m, t_s + t_rest_s, dt_s, no_grid)
            t_s, t_rest_s = later(t_s, t_rest_s, dt_s)
        if is_armed:
            omega_rad_s, current_a = (
                memory.observed[OBSERVED.omega_rad_s],
                memory.observed[OBSERVED.current_a],
            )
            drive = axis.elapse(config, drive, armed_s, omega_rad_s, current_a)
        if status != DONE or armed_s >= period_s - TIME_RESOLUTION_S:
            break
        dt_s, torque_n_m = period_s - armed_s, 0.0
    return drive, torque_n_m, t_s, t_rest_s, status


@shared
def log_frame(buffers: Buffers, t_us: int, frame: WordFrame) -> None:
    """Write a line of can.log, if the log is kept."""
    if buffers.can_log.size == 0:
        return
    buffers.used[LOG_BYTES] = log_line(buffers.can_log, buffers.used[LOG_BYTES], t_us, frame)


@shared
def received(firmware: Firmware, buffers: Buffers, count: int, t_us: int, frame: WordFrame) -> int:
    """Put a frame into the firmware's inbox after `count` others, and log it; return the new number."""
    row = firmware.frames[count]
    row[0], row[1], row[2] = frame.can_id, frame.length, frame.word
    log_frame(buffers, t_us, frame)
    return count + 1


@shared
def frame_of(row: Integers) -> WordFrame:
    """The frame in a row of tick, identifier, length and word."""
    return WordFrame(row[1], row[2], row[3])


@shared
def sent(firmware: Firmware, place: int) -> WordFrame:
    """The firmware's sent frame at index `place`."""
    numbers = firmware.sent
    return WordFrame(numbers[place], numbers[place + 1], numbers[place + 2])


@kernel
def run(
    parts: Parts,
    probe: Sensing,
    memory: Memory,
    constants: Constants,
    firmware: Firmware,
    loop: Loop,
    gait_frames: Integers,
    commands: Integers,
    samples: Vector,
    noise: Vector,
    buffers: Buffers,
    no_grid: Grid,
) -> tuple[Loop, int]:
    """Run a tick for each row of `noise` (four standard normals); return the loop's state and its status.

    `gait_frames`, `commands`: the gait sensors' and the operator's frames, rows of tick, identifier, length
    and word, ascending. `samples`: the samples of `constants.sampled`, as `SampledFrames.rows`. The status is
    DONE, another status of the solver, or FIRMWARE_FAILED; after a failure the state is that of the failed
    tick.
    """
    readers, period_s, drive_config = constants.readers, constants.period_s, constants.drive
    readings, observed, used = probe.readings, memory.observed, buffers.used
    next_gait_frame = next_sample = next_command = 0
    for row in range(noise.shape[0]):
        number, t_s, t_rest_s, torque_n_m, drive, reports, counter, held = loop
        now_us = number * constants.period_ns // 1000

        # The plant at t_k: sensors and drive report.
        omega_rad_s = observed[OBSERVED.omega_rad_s]
        reading = read_sensors(readers, readings, observed[OBSERVED.crank_rad], noise[row])
        counter += 1
        count = received(firmware, buffers, 0, now_us, accelerometer_frame(reading, counter))
        count = received(firmware, buffers, count, now_us, encoder_frame(drive, reading))
        if next_gait_frame < gait_frames.shape[0] and gait_frames[next_gait_frame, 0] == number:
            count = received(firmware, buffers, count, now_us, frame_of(gait_frames[next_gait_frame]))
            next_gait_frame += 1
        while next_sample < samples.shape[0] and samples[next_sample, TICK] == number:
            sample = samples[next_sample]
            which, sampled = int(sample[WHICH]), int(sample[COUNTER])
            frame = sampled_frame(constants.sampled, which, observed, sample[NOISE:], sampled)
            count = received(firmware, buffers, count, now_us, frame)
            next_sample += 1
        reports, report = take(look(constants.report_ticks, reports, number))
        if report != NOTHING:
            telemetry = Telemetry(
                observed[OBSERVED.current_a], observed[OBSERVED.motor_torque_n_m], omega_rad_s
            )
            frame = report_frame(drive_config, drive, telemetry, report)
            count = received(firmware, buffers, count, now_us, frame)

        # The plant obeys the frames that have arrived, and advances to t_{k+1}.
        for frame in (held.first, held.second, held.third):
            if frame.can_id != 0:
                drive, _ = obey(drive_config, drive, frame, reading.encoder_position_rev)
        torque_n_m = axis.torque_n_m(drive_config, drive, omega_rad_s)
        record_plant(buffers.plant[row], number, number * period_s, observed, torque_n_m, drive, reading)
        drive, torque_n_m, t_s, t_rest_s, status = move_on(
            parts, probe, memory, buffers, drive_config, drive, torque_n_m, t_s, t_rest_s, period_s, no_grid
        )
        if status != DONE:
            return Loop(number, t_s, t_rest_s, torque_n_m, drive, reports, counter, held), status

        # The operator.
        command = NO_FRAME
        if next_command < commands.shape[0] and commands[next_command, 0] == number:
            command = frame_of(commands[next_command])
            count = received(firmware, buffers, count, now_us, command)
            next_command += 1

        # The firmware at t_k + T/2.
        frames, sent_to = firmware.frames.ctypes.data, firmware.sent.ctypes.data
        status = call_tick(firmware.tick, firmware.config, firmware.state, 1, count, frames, sent_to)
        if status != firmware.done:
            loop = Loop(number, t_s, t_rest_s, torque_n_m, drive, reports, counter, held)
            return loop, FIRMWARE_FAILED
        later_us = (number * constants.period_ns + constants.period_ns // 2) // 1000
        torque, other = sent(firmware, TORQUE_SENT), NO_FRAME
        log_frame(buffers, later_us, torque)
        if firmware.sent[0] > 1:
            other = sent(firmware, OTHER_SENT)
            log_frame(buffers, later_us, other)
        record_firmware(
            buffers.firmware, row * constants.firmware_record_bytes, firmware.state_bytes, buffers.moves
        )
        held = Held(command, torque, other)
        used[TICKS] = row + 1
        loop = Loop(number + 1, t_s, t_rest_s, torque_n_m, drive, reports, counter, held)
    return loop, DONE
