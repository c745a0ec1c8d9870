"""The plant as one CAN node: the module, its sensors and its motor's drive.

At t_k `publish` returns the frames of the sensors. `advance` then obeys the frames that have arrived and
moves the module to t_{k+1}. If the loop has skipped ticks, `sleep_through` advances the module by their time.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface import codec
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import Accelerometer, GaitSensors
from hil.bus.wire import REMOTE_FLAG
from hil.drive import axis, messages
from hil.drive.axis import TIME_RESOLUTION_S, DriveConfig, DriveState, Telemetry
from hil.drive.axis_table import AxisTable, axis_of
from hil.drive.node import (
    COMMAND_IDS,
    NOT_MODELLED_IDS,
    POWERS_ID,
    REPORT_OF_REQUEST,
    REQUEST_IDS,
    TORQUES_ID,
    VERSION,
    VERSION_ID,
    address,
    is_new_address,
    obey,
    powers,
    report_frame,
    torques,
)
from hil.drive.reports import NOTHING, Ticks, first_reports, look, report_ticks, take, ticks_of
from hil.faults.fault import Fault
from hil.faults.on_sensor import SensorFaults
from hil.faults.plant import PlantFaults
from hil.nodes.frame_rows import byte_frame, word_frame
from hil.nodes.plant_steps import Due, PlantState, Setup
from hil.nodes.sampled import SampledFrames
from hil.record.traces.plant_trace import PlantRecord
from plant_sim.parts.drive import MotorDrive, MotorTable
from plant_sim.plant import Plant
from plant_sim.result import Impact
from plant_sim.scene import Scene
from plant_sim.sensors.gait import GaitReading, GaitTruth
from plant_sim.sensors.readings import SensorReading

OBEYED_IDS = frozenset((*COMMAND_IDS, *NOT_MODELLED_IDS))
ACCEPTED_IDS = (
    *COMMAND_IDS,
    *NOT_MODELLED_IDS,
    *REQUEST_IDS,
    *(REMOTE_FLAG | can_id for can_id in REQUEST_IDS),
)
"""Identifiers that this node receives, remote frames with their flag."""
MOST_ANSWERS = 8
"""Largest number of requests answered per tick; further requests in the tick are ignored."""
CONTROL_MODES = {"torque": axis.TORQUE_CONTROL, "velocity": axis.VELOCITY_CONTROL}
CAN_PERIOD_S = 1e-3
"""Period of the fastest frame on the real bus; lockstep may use another tick."""


def drive_config(scene: Scene) -> DriveConfig:
    """Configuration of the drive for the scene's motor; for a default motor if the scene's drive is ideal."""
    drive = scene.parts().drive
    motor: MotorDrive | MotorTable = drive if isinstance(drive, MotorDrive) else MotorTable()
    axis_table = axis_of(scene) or AxisTable()
    return DriveConfig(
        motor.torque_constant_n_m_a,
        motor.resistance_ohm,
        motor.supply_v,
        motor.current_limit_a,
        motor.speed_limit_rad_s,
        watchdog_s=math.inf if axis_table.watchdog_feed == "off" else axis_table.watchdog_s,
        is_fed_by_every_frame=axis_table.watchdog_feed == "frames",
        control_mode=CONTROL_MODES[axis_table.control_mode],
    )


def frame_ticks(scene: Scene, period_s: float) -> tuple[Ticks, int]:
    """The periods of the drive's reports and of the encoder's frame, in ticks of `period_s`."""
    configured = axis_of(scene)
    encoder_s = (configured or AxisTable()).encoder_s or period_s
    heartbeat_s = None if configured is None else configured.heartbeat_s
    return report_ticks(period_s, heartbeat_s), max(1, round(encoder_s / period_s))


def gait_record(reading: GaitReading) -> GaitSensors:
    """The content of the gait sensors' frame."""
    heel, toe = int(reading.heel_contact), int(reading.toe_contact)
    return GaitSensors(reading.shank_rate_rad_s, reading.along_m_s2, heel, toe)


class PlantNode:
    """Publishes the state at t_k, then moves to t_{k+1} under the drive's torque."""

    def __init__(
        self,
        scene: Scene,
        seed: int,
        period_s: float = CAN_PERIOD_S,
        faults: Sequence[Fault] = (),
        first_tick: int = 0,
    ) -> None:
        """`first_tick`: tick of power-up, at which the module is in the scene's initial state."""
        self.plant = Plant(scene, seed=seed)
        self.drive_config = drive_config(scene)
        self.drive: DriveState = axis.power_up(self.drive_config)
        self.rejected = 0
        """Number of drive commands that could not be read."""
        self.began_s = first_tick * period_s
        self._sensor_faults = SensorFaults(faults, seed)
        self._faults = PlantFaults(faults, self.plant, self.drive_config, self.began_s)
        self.period_s = period_s
        self.tick = first_tick
        self.record: PlantRecord
        self.gait: GaitTruth | None = None
        """The gait at t_k; None without a walk."""
        self.counter = -1
        self._report_ticks, self._ticks_an_encoder_frame = frame_ticks(scene, period_s)
        self.reports = first_reports(first_tick)
        self._reading: SensorReading
        self.node_id = 0
        """The drive's node number on its bus, for clients that request its address."""
        self.requests: list[int] = []
        self._ticks_a_gait_frame = ticks_of(codec.GAIT_SENSORS, period_s)
        self._last_gait_frame = -1
        self.sampled = SampledFrames(self.plant, period_s)

    def publish(self) -> list[Frame]:
        """The frames of tick k: sensor samples, at most one further report of the drive, and answers."""
        self.act()
        self._reading = reading = self._sensor_faults.published(self.tick * self.period_s, self.plant.sense())
        estimates = messages.encoder_estimates(
            self.drive, reading.encoder_position_rev, reading.encoder_velocity_rev_s
        )
        estimates = self._faults.reported(estimates)
        self.counter += 1
        frames = [
            codec.ACCELEROMETER.encode(
                Accelerometer(reading.striker_low_m_s2, reading.striker_high_m_s2, reading.housing_m_s2),
                self.counter,
            ),
        ]
        encoder_frame = codec.ENCODER_ESTIMATES.encode(estimates)
        if self.tick % self._ticks_an_encoder_frame == 0:
            frames.append(encoder_frame)
        if self.plant.has_gait_sensors:
            frames += [frame for _, frame in self.gait_frames(range(self.tick, self.tick + 1))]
        frames += self.sampled.frames(self.tick)
        self.reports, report = take(look(self._report_ticks, self.reports, self.tick))
        if report != NOTHING:
            frames.append(self._report(report))
        if self.requests:
            frames += [self._answer(can_id, encoder_frame) for can_id in self.requests[:MOST_ANSWERS]]
            self.requests.clear()
        return self._faults.sent(frames)

    def gait_frames(self, ticks: range) -> list[tuple[int, Frame]]:
        """The gait sensors' frames in these ticks: one for each period that begins, unless it drops out."""
        due = []
        for tick in ticks:
            number = tick // self._ticks_a_gait_frame
            if number != self._last_gait_frame:
                self._last_gait_frame = number
                due.append(tick)
        if not due:
            return []
        readings = self.plant.sense_gaits(np.array([self._since_start_s(tick) for tick in due]))
        return [
            (tick, codec.GAIT_SENSORS.encode(gait_record(reading), tick // self._ticks_a_gait_frame))
            for tick, reading in zip(due, readings, strict=True)
            if reading is not None
        ]

    def _answer(self, can_id: int, estimates: Frame) -> Frame:
        """The frame that answers a client's request for `can_id`."""
        if can_id in REPORT_OF_REQUEST:
            return self._report(REPORT_OF_REQUEST[can_id])
        if can_id == estimates.can_id:
            return estimates
        if can_id == TORQUES_ID:
            return torques(self.drive_config, self.drive, self._telemetry())
        if can_id == POWERS_ID:
            return powers(self.drive_config, self.drive, self._telemetry())
        return VERSION if can_id == VERSION_ID else address(self.node_id)

    def _report(self, report: int) -> Frame:
        return byte_frame(*report_frame(self.drive_config, self.drive, self._telemetry(), report))

    def _telemetry(self) -> Telemetry:
        now = self.plant.now
        return Telemetry(now.current_a, now.motor_torque_n_m, now.omega_rad_s)

    def advance(self, frames: Sequence[Frame]) -> None:
        """Obey `frames`, make the record of this tick, and advance to the next."""
        self._obey(self._faults.received(frames))
        self.record = self._record_of(self._torque_n_m())
        self.gait = self.plant.gait_at(self._since_start_s(self.tick))
        self._pass_time(self.period_s, 2.0 * TIME_RESOLUTION_S, self._drive_on)
        self.tick += 1

    def _pass_time(self, duration_s: float, after_s: float, move_by: Callable[[float], None]) -> None:
        """Let faults begin and end at their times, from `after_s` on; `move_by` the durations in between."""
        begin_s, gone_s = self.tick * self.period_s, 0.0
        edges_s = self._faults.edges_s(begin_s + after_s, begin_s + duration_s)
        for edge_s in edges_s:
            move_by(edge_s - begin_s - gone_s)
            gone_s = edge_s - begin_s
            self.drive_config, self.drive = self._faults.act(edge_s, self.drive)
        move_by(duration_s - gone_s)

    def _torque_n_m(self) -> float:
        """The torque that the drive requests of the motor."""
        return axis.torque_n_m(self.drive_config, self.drive, self.plant.now.omega_rad_s)

    def _drive_on(self, dt_s: float) -> None:
        """Advance by `dt_s` under the drive's torque, until its watchdog expires."""
        config = self.drive_config
        armed_s = min(dt_s, axis.watchdog_left_s(config, self.drive))
        self._move(self._torque_n_m(), armed_s)
        now = self.plant.now
        self.drive = axis.elapse(config, self.drive, armed_s, now.omega_rad_s, now.current_a)
        if armed_s < dt_s - TIME_RESOLUTION_S:
            self._move(0.0, dt_s - armed_s)

    def _obey(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            can_id, data = frame
            if can_id in OBEYED_IDS:
                position_rev = self._reading.encoder_position_rev
                self.drive, was_read = obey(self.drive_config, self.drive, word_frame(frame), position_rev)
                self.rejected += not was_read
            elif not data and can_id in REQUEST_IDS:
                self.requests.append(can_id)
                if self.drive_config.is_fed_by_every_frame:
                    self.drive = axis.feed_watchdog(self.drive)
            elif is_new_address(self.node_id, frame):
                self.drive = axis.disarm(self.drive, axis.BAD_CONFIG)  # the node number is a parameter

    def gaits_in(self, tick: int, ticks: int) -> NDArray[np.float64] | None:
        """The gait in `ticks` from `tick` on, one row of `GaitTruth` each; None without a walk."""
        numbers = np.arange(tick, tick + ticks, dtype=np.float64)
        return self.plant.gaits_at(numbers * self.period_s - self.began_s)

    def _since_start_s(self, tick: int) -> float:
        return tick * self.period_s - self.began_s

    def act(self, ticks: int = 1) -> None:
        """Begin and end the faults that are due in this tick; they act for `ticks` until the next call."""
        self.drive_config, self.drive = self._faults.act(self.tick * self.period_s, self.drive, ticks)

    @property
    def has_waiting_fault(self) -> bool:
        """Whether a fault is due that cannot act yet (`PlantFaults.waits`)."""
        return self._faults.waits

    @property
    def setup(self) -> Setup:
        """The drive's configuration and the frames' periods, for compiled steps."""
        sensors = self.sampled.all_sensors()
        return Setup(self.drive_config, self._report_ticks, self._ticks_an_encoder_frame, sensors)

    @property
    def state(self) -> PlantState:
        """The state between two ticks, for compiled steps."""
        lent = self.plant.lend()
        return PlantState(
            self.tick, self.counter, self.reports, self.drive, lent.t_s, lent.t_rest_s, torque_n_m=0.0
        )

    def due(self, ticks: int) -> Due:
        """The gait sensors' frames and the samples of the next `ticks`, for compiled steps."""
        numbers = range(self.tick, self.tick + ticks)
        frames = self.gait_frames(numbers) if self.plant.has_gait_sensors else []
        rows = [(number, *word_frame(frame)) for number, frame in frames]
        gait = np.array(rows, dtype=np.int64).reshape(-1, 4)
        return Due(gait, self.sampled.rows(self.tick, ticks), np.zeros(2, np.int64))

    def resume(self, state: PlantState, status: int) -> None:
        """Continue from the state that compiled steps have reached, with the solver's status."""
        self.tick, self.counter, self.reports, self.drive, t_s, t_rest_s, torque_n_m = state
        self.plant.take_back(t_s, t_rest_s, torque_n_m, status)

    def sleep_through(self, ticks: int, frames: Sequence[Frame]) -> None:
        """Advance by `ticks` in which this process did not run; `frames` arrived in that time.

        The module moves under the torque of the last command until the drive's watchdog would expire; faults
        of module and drive act at their times. The
        pause does not count towards the watchdog afterwards, since this process could not receive commands in
        it.
        """
        if self.counter < 0:  # the first sample has not been sent yet
            self._reading = self.plant.sense()
        self._obey(frames)
        armed_s = axis.watchdog_left_s(self.drive_config, self.drive)

        def coast(dt_s: float) -> None:
            nonlocal armed_s
            driven_s = min(armed_s, dt_s)
            self._move(self._torque_n_m(), driven_s)
            self._move(0.0, dt_s - driven_s)
            armed_s -= driven_s

        self._pass_time(ticks * self.period_s, 0.0, coast)
        self.tick += ticks
        self.counter += ticks  # the sensors continued to sample: their counter counts periods

    def _move(self, torque_n_m: float, dt_s: float) -> None:
        if dt_s > 0.0:
            self.plant.advance(self._faults.given_n_m(torque_n_m, self.plant.now.crank_rad), dt_s)

    def _record_of(self, torque_n_m: float) -> PlantRecord:
        return PlantRecord(
            self.tick,
            self.tick * self.period_s,
            *self.plant.now,
            torque_n_m,
            self.drive.axis.state,
            self.drive.axis.errors,
            *self._reading,
        )

    def take_impacts(self) -> list[Impact]:
        """Remove and return the impacts that have ended since the last call."""
        impacts = self.plant.take_impacts()
        if self.began_s == 0.0:
            return impacts
        return [impact._replace(t_s=impact.t_s + self.began_s) for impact in impacts]
