"""The steps of the plant's node in a tick: it publishes at t_k, obeys, is recorded, and moves to t_{k+1}.

They are written once: `hil.nodes.closed_loop` compiles them to one loop, the node's FMU to one step, and
`PlantNode` calls them one by one, with the faults in between.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface.frame import WordFrame
from firmware_py.interface.generated import packing
from firmware_py.interface.generated.records import Accelerometer, EncoderEstimates
from hil.drive import axis, messages
from hil.drive.axis import TIME_RESOLUTION_S, DriveConfig, DriveState, Telemetry
from hil.drive.node import obey, report_frame
from hil.drive.reports import NOTHING, Reports, Ticks, look, take
from hil.nodes.plant.sampled import COUNTER, MOST_SIGNALS, NOISE, TICK, WHICH, sampled_frame
from plant_sim.kernels import subroutine
from plant_sim.sensors.readings import SensorReading
from plant_sim.sensors.sampled import SAMPLED, SampledSensor
from plant_sim.solvers.adaptive.adaptive import DONE
from plant_sim.solvers.adaptive.state_layout import OBSERVED, Run
from plant_sim.tick import move

Vector = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_FRAMES = 4 + len(SAMPLED)
"""Most frames that a tick publishes: two samples, gait and sampled sensors, and a report."""
GAIT, SAMPLE = range(2)
"""Indices in `Due.next`."""


class Setup(NamedTuple):
    """The drive's configuration, the periods of frames in ticks, and a sensor of every sampled kind."""

    drive: DriveConfig
    report_ticks: Ticks
    encoder_ticks: int
    sampled: tuple[SampledSensor, ...]


class Due(NamedTuple):
    """The frames and samples that are known in advance, in order of time; `next` has the next row of each.

    `gait`: the gait sensors' frames, rows of tick, identifier, length and word. `samples`: samples of
    `Setup.sampled`, rows as of `SampledFrames.rows`.
    """

    gait: Integers
    samples: Vector
    next: Integers


NOTHING_DUE = Due(np.zeros((0, 4), np.int64), np.zeros((0, NOISE + MOST_SIGNALS)), np.zeros(2, np.int64))
"""For scenes without a gait and without sensors with periods of their own."""


class PlantState(NamedTuple):
    """The state of the plant's node between two steps, apart from the module.

    `counter`: the number of the accelerometers' last sample. `torque_n_m`: the torque last requested of the
    motor. `rejected`: the number of drive commands that could not be read.
    """

    tick: int
    counter: int
    reports: Reports
    drive: DriveState
    torque_n_m: float
    rejected: int


@subroutine
def put(rows: Integers, count: int, frame: WordFrame) -> int:
    """Put a frame into rows of identifier, length and word after `count` others; return the new number."""
    rows[count, 0], rows[count, 1], rows[count, 2] = frame.can_id, frame.length, frame.word
    return count + 1


@subroutine
def accelerometer_frame(reading: SensorReading, counter: int) -> WordFrame:
    """The frame of the accelerometers' sample."""
    sample = Accelerometer(reading.striker_low_m_s2, reading.striker_high_m_s2, reading.housing_m_s2)
    return packing.pack_accelerometer(sample, counter)[0]


@subroutine
def encoder_sample(drive: DriveState, reading: SensorReading) -> EncoderEstimates:
    """The drive's encoder sample."""
    return messages.encoder_estimates(drive, reading.encoder_position_rev, reading.encoder_velocity_rev_s)


@subroutine
def encoder_frame(sample: EncoderEstimates) -> WordFrame:
    """The frame of the drive's encoder sample."""
    return packing.pack_encoder_estimates(sample, 0)[0]


@subroutine
def telemetry(observed: Vector) -> Telemetry:
    """The motor's measured state, for the drive's reports."""
    return Telemetry(
        observed[OBSERVED.current_a], observed[OBSERVED.motor_torque_n_m], observed[OBSERVED.omega_rad_s]
    )


@subroutine
def publish(
    setup: Setup,
    due: Due,
    observed: Vector,
    state: PlantState,
    reading: SensorReading,
    sample: EncoderEstimates,
    outbox: Integers,
) -> tuple[PlantState, int]:
    """Put the frames of a tick into `outbox`; return the node's state, and the number of frames.

    `observed`: the module's present observation. `sample`: `encoder_sample` as the drive reports it.
    """
    tick, counter, drive = state.tick, state.counter + 1, state.drive
    count = put(outbox, 0, accelerometer_frame(reading, counter))
    if tick % setup.encoder_ticks == 0:
        count = put(outbox, count, encoder_frame(sample))
    row = due.next[GAIT]
    if row < due.gait.shape[0] and due.gait[row, 0] == tick:
        count = put(outbox, count, WordFrame(due.gait[row, 1], due.gait[row, 2], due.gait[row, 3]))
        due.next[GAIT] = row + 1
    while due.next[SAMPLE] < due.samples.shape[0] and due.samples[due.next[SAMPLE], TICK] == tick:
        next_one = due.samples[due.next[SAMPLE]]
        which, number = int(next_one[WHICH]), int(next_one[COUNTER])
        count = put(outbox, count, sampled_frame(setup.sampled, which, observed, next_one[NOISE:], number))
        due.next[SAMPLE] += 1
    reports, report = take(look(setup.report_ticks, state.reports, tick))
    if report != NOTHING:
        count = put(outbox, count, report_frame(setup.drive, drive, telemetry(observed), report))
    return PlantState(tick, counter, reports, drive, state.torque_n_m, state.rejected), count


@subroutine(inline=True)
def obey_frames(
    config: DriveConfig,
    state: PlantState,
    reading: SensorReading,
    omega_rad_s: float,
    frames: Integers,
    count: int,
) -> PlantState:
    """Obey the first `count` rows of `frames`; return the node's state with the torque that follows.

    `frames`: rows of identifier, length and word. `omega_rad_s`: the motor's speed.
    """
    drive, rejected = state.drive, state.rejected
    for row in range(count):
        frame = WordFrame(frames[row, 0], frames[row, 1], frames[row, 2])
        drive, was_read = obey(config, drive, frame, reading.encoder_position_rev)
        rejected += 0 if was_read else 1
    torque_n_m = axis.torque_n_m(config, drive, omega_rad_s)
    return PlantState(state.tick, state.counter, state.reports, drive, torque_n_m, rejected)


@subroutine(inline=True)
def move_on(
    module: Run, config: DriveConfig, drive: DriveState, torque_n_m: float, duration_s: float
) -> tuple[DriveState, int]:
    """Advance by `duration_s` under the motor's torque, without torque once the drive's watchdog expires.

    Returns the drive, and the solver's status.
    """
    observed = module.memory[0].observed
    armed_s = axis.watchdog_left_s(config, drive)
    if armed_s > duration_s - TIME_RESOLUTION_S:
        armed_s = duration_s
    status, dt_s = DONE, armed_s
    for is_armed in (True, False):
        if dt_s > 0.0:
            status = move(module, torque_n_m, dt_s)
        if is_armed:
            omega_rad_s, current_a = observed[OBSERVED.omega_rad_s], observed[OBSERVED.current_a]
            drive = axis.elapse(config, drive, armed_s, omega_rad_s, current_a)
        if status != DONE or armed_s == duration_s:
            break
        dt_s, torque_n_m = duration_s - armed_s, 0.0
    return drive, status


@subroutine
def record_plant(
    row: Vector, whole: Integers, t_s: float, observed: Vector, state: PlantState, reading: SensorReading
) -> None:
    """Write a tick's record as of `PlantRecord`, before the module moves; `whole`: `row` as integers."""
    whole[0], row[1] = state.tick, t_s
    for which in range(observed.size - 1):
        row[2 + which] = observed[which]
    whole[1 + observed.size] = int(observed[observed.size - 1])  # the phase
    place, servo = 2 + observed.size, state.drive.axis
    row[place], whole[place + 1], whole[place + 2] = state.torque_n_m, servo.state.value, servo.errors
    row[place + 3], row[place + 4] = reading.striker_low_m_s2, reading.striker_high_m_s2
    row[place + 5], row[place + 6] = reading.housing_m_s2, reading.encoder_position_rev
    row[place + 7] = reading.encoder_velocity_rev_s
