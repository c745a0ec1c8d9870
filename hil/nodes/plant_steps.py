"""The steps of the plant's node in a tick: it publishes at t_k, then advances to t_{k+1}.

Pure steps, which `hil.nodes.closed_loop` compiles; `PlantNode` has the same order for single ticks.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface.frame import WordFrame
from firmware_py.interface.generated import packing
from firmware_py.interface.generated.records import Accelerometer
from hil.drive import axis, messages
from hil.drive.axis import TIME_RESOLUTION_S, DriveConfig, DriveState, Telemetry
from hil.drive.node import obey, report_frame
from hil.drive.reports import NOTHING, Reports, Ticks, look, take
from hil.nodes.sampled import COUNTER, NOISE, TICK, WHICH, sampled_frame
from plant_sim.kernels import subroutine
from plant_sim.parts.parts import Parts
from plant_sim.sensors.readings import SensorReading
from plant_sim.sensors.sampled import SAMPLED, SampledSensor
from plant_sim.sensors.sensing import Sensing
from plant_sim.solvers.adaptive.adaptive import BUFFER_FULL, DONE, call_advance
from plant_sim.solvers.adaptive.state_layout import OBSERVED, Grid, Memory

Vector = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_FRAMES = 4 + len(SAMPLED)
"""Most frames that a tick publishes: two samples, gait and sampled sensors, and a report."""
GAIT, SAMPLE = range(2)
"""Indices in `Due.next`."""


class Module(NamedTuple):
    """The module, and a buffer for finished impacts: rows, and their number so far in `impact_count[0]`."""

    parts: Parts
    probe: Sensing
    memory: Memory
    no_grid: Grid
    impacts: NDArray[np.void]
    impact_count: Integers


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


class PlantState(NamedTuple):
    """The state of the plant's node between two steps, apart from the memory of the module.

    `counter`: the number of the accelerometers' last sample. `t_rest_s`: the rounding error of `t_s`.
    `torque_n_m`: the torque last requested of the motor.
    """

    tick: int
    counter: int
    reports: Reports
    drive: DriveState
    t_s: float
    t_rest_s: float
    torque_n_m: float


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
def encoder_frame(drive: DriveState, reading: SensorReading) -> WordFrame:
    """The frame of the drive's encoder sample."""
    estimates = messages.encoder_estimates(
        drive, reading.encoder_position_rev, reading.encoder_velocity_rev_s
    )
    return packing.pack_encoder_estimates(estimates, 0)[0]


@subroutine
def telemetry(observed: Vector) -> Telemetry:
    """The motor's measured state, for the drive's reports."""
    return Telemetry(
        observed[OBSERVED.current_a], observed[OBSERVED.motor_torque_n_m], observed[OBSERVED.omega_rad_s]
    )


@subroutine
def publish(
    setup: Setup, due: Due, observed: Vector, state: PlantState, reading: SensorReading, outbox: Integers
) -> tuple[PlantState, int]:
    """Put the frames of a tick into `outbox`; return the node's state, and the number of frames.

    `observed`: the module's present observation.
    """
    tick, counter, drive = state.tick, state.counter + 1, state.drive
    count = put(outbox, 0, accelerometer_frame(reading, counter))
    if tick % setup.encoder_ticks == 0:
        count = put(outbox, count, encoder_frame(drive, reading))
    row = due.next[GAIT]
    if row < due.gait.shape[0] and due.gait[row, 0] == tick:
        count = put(outbox, count, WordFrame(due.gait[row, 1], due.gait[row, 2], due.gait[row, 3]))
        due.next[GAIT] = row + 1
    while due.next[SAMPLE] < due.samples.shape[0] and due.samples[due.next[SAMPLE], TICK] == tick:
        sample = due.samples[due.next[SAMPLE]]
        which, sampled = int(sample[WHICH]), int(sample[COUNTER])
        count = put(outbox, count, sampled_frame(setup.sampled, which, observed, sample[NOISE:], sampled))
        due.next[SAMPLE] += 1
    reports, report = take(look(setup.report_ticks, state.reports, tick))
    if report != NOTHING:
        count = put(outbox, count, report_frame(setup.drive, drive, telemetry(observed), report))
    return state._replace(counter=counter, reports=reports), count


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
    drive = state.drive
    for row in range(count):
        frame = WordFrame(frames[row, 0], frames[row, 1], frames[row, 2])
        drive, _ = obey(config, drive, frame, reading.encoder_position_rev)
    torque_n_m = axis.torque_n_m(config, drive, omega_rad_s)
    return state._replace(drive=drive, torque_n_m=torque_n_m)


@subroutine
def later(t_s: float, t_rest_s: float, dt_s: float) -> tuple[float, float]:
    """Add `dt_s` to a time and its rounding error (Neumaier's sum, as in `plant_sim.plant`)."""
    sum_s = t_s + dt_s
    return sum_s, t_rest_s + ((t_s - sum_s) + dt_s)


@subroutine(inline=True)
def move(module: Module, torque_n_m: float, t_s: float, dt_s: float) -> int:
    """Advance by `dt_s` under constant torque; store finished impacts; return the solver's status."""
    memory = module.memory
    memory.held[0].elapsed_s = memory.held[0].elapsed_low_s = 0.0
    while True:
        status = call_advance(module.parts, module.probe, memory, torque_n_m, t_s, dt_s, module.no_grid)
        for row in range(memory.mode[0].impacts):
            place = module.impact_count[0]
            if place < module.impacts.shape[0]:
                module.impacts[place] = memory.impacts[row]
                module.impact_count[0] = place + 1
        memory.mode[0].impacts = 0
        if status != BUFFER_FULL:
            return status


@subroutine(inline=True)
def move_on(
    module: Module, config: DriveConfig, state: PlantState, duration_s: float
) -> tuple[PlantState, int]:
    """Advance by `duration_s` under the torque of `state`, without torque once the drive's watchdog expires.

    Returns the node's state in the same tick, and the solver's status.
    """
    drive, t_s, t_rest_s, torque_n_m = state.drive, state.t_s, state.t_rest_s, state.torque_n_m
    observed = module.memory.observed
    armed_s = min(duration_s, axis.watchdog_left_s(config, drive))
    status, dt_s = DONE, armed_s
    for is_armed in (True, False):
        if dt_s > 0.0:
            status = move(module, torque_n_m, t_s + t_rest_s, dt_s)
            t_s, t_rest_s = later(t_s, t_rest_s, dt_s)
        if is_armed:
            omega_rad_s, current_a = observed[OBSERVED.omega_rad_s], observed[OBSERVED.current_a]
            drive = axis.elapse(config, drive, armed_s, omega_rad_s, current_a)
        if status != DONE or armed_s >= duration_s - TIME_RESOLUTION_S:
            break
        dt_s, torque_n_m = duration_s - armed_s, 0.0
    return state._replace(drive=drive, t_s=t_s, t_rest_s=t_rest_s, torque_n_m=torque_n_m), status


@subroutine
def record_plant(
    row: Vector, t_s: float, observed: Vector, state: PlantState, reading: SensorReading
) -> None:
    """Write a tick's numbers in the order of `PlantRecord`, before the module moves."""
    row[0], row[1] = state.tick, t_s
    for which in range(observed.size):
        row[2 + which] = observed[which]
    place, servo = 2 + observed.size, state.drive.axis
    row[place], row[place + 1], row[place + 2] = state.torque_n_m, servo.state.value, servo.errors
    row[place + 3], row[place + 4] = reading.striker_low_m_s2, reading.striker_high_m_s2
    row[place + 5], row[place + 6] = reading.housing_m_s2, reading.encoder_position_rev
    row[place + 7] = reading.encoder_velocity_rev_s
