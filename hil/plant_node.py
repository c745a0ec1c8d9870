"""The plant as one CAN node: the module, its sensors and its motor's drive.

At t_k `publish` gives what the sensors see. `advance` then obeys the frames that have arrived and moves the
module to t_{k+1}. Where the loop has skipped ticks, `sleep_through` lets their time pass: the world goes on.
"""

from collections.abc import Sequence
from typing import NamedTuple

from firmware_py.interface import codec
from firmware_py.interface.frame import Frame, WordFrame, bytes_of, word_of
from firmware_py.interface.records import Accelerometer, GaitSensors
from hil import drive as axis
from hil.bus.wire import REMOTE_FLAG
from hil.drive import TIME_RESOLUTION_S, DriveConfig, DriveState, Telemetry
from hil.drive_node import (
    COMMAND_IDS,
    REPORT_OF_REQUEST,
    REQUEST_IDS,
    VERSION,
    VERSION_ID,
    address,
    obey,
    report_frame,
)
from hil.faults.plant import PlantFaults
from hil.faults.tables import Fault
from hil.reports import NOTHING, Reports, first_reports, look, report_ticks, take, ticks_of
from plant_sim.gait_sensors import GaitTruth
from plant_sim.parts.drive import MotorDrive
from plant_sim.plant import Impact, Plant
from plant_sim.result import Phase
from plant_sim.scene import Scene
from plant_sim.scene_tables import AxisTable, MotorTable
from plant_sim.sensors import SensorReading

ACCEPTED_IDS = (*COMMAND_IDS, *REQUEST_IDS, *(REMOTE_FLAG | can_id for can_id in REQUEST_IDS))
"""All that this node listens to, remote frames with their flag."""
MOST_ANSWERS = 8
"""Requests answered in a tick; others in the same tick are not."""
CAN_PERIOD_S = 1e-3
"""The fastest frame's period on the real bus; a lockstep run may tick faster or slower."""


class PlantRecord(NamedTuple):
    """The truth at t_k (`Observation`), the torque asked for from then on, the drive, what was published."""

    tick: int
    t_s: float
    x_m: float
    v_m_s: float
    accel_m_s2: float
    crank_rad: float
    omega_rad_s: float
    motor_torque_n_m: float
    current_a: float
    stop_force_n: float
    felt_force_n: float
    drive_work_j: float
    stored_j: float
    friction_j: float
    impact_loss_j: float
    housing_work_j: float
    ankle_j: float
    phase: Phase
    torque_command_n_m: float
    axis_state: int
    axis_error: int
    striker_low_m_s2: float
    striker_high_m_s2: float
    housing_m_s2: float
    encoder_position_rev: float
    encoder_velocity_rev_s: float


class ImpactRecord(NamedTuple):
    """One impact that has ended; the time is the touch-down's."""

    t_s: float
    v_m_s: float
    v_after_m_s: float
    impulse_n_s: float
    peak_force_n: float
    crank_rad: float


def drive_config(scene: Scene) -> DriveConfig:
    """The drive that fits the scene's motor; the default one where the scene's drive is ideal."""
    drive = scene.parts().drive
    motor: MotorDrive | MotorTable = drive if isinstance(drive, MotorDrive) else MotorTable()
    return DriveConfig(
        motor.torque_constant_n_m_a,
        motor.resistance_ohm,
        motor.supply_v,
        motor.current_limit_a,
        motor.speed_limit_rad_s,
        watchdog_s=(scene.axis or AxisTable()).watchdog_s,
    )


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
        """`first_tick`: when it is switched on; the module is then as its scene begins."""
        self.plant = Plant(scene, seed=seed)
        self.drive_config = drive_config(scene)
        self.drive: DriveState = axis.power_up(self.drive_config)
        self.rejected = 0
        """Frames with an identifier of the drive's commands that could not be read."""
        self._faults = PlantFaults(faults, seed, self.plant, self.drive_config) if faults else None
        self.period_s = period_s
        self.tick = first_tick
        self.record: PlantRecord
        self.gait: GaitTruth | None = None
        """The gait at t_k, where somebody walks."""
        self.began_s = first_tick * period_s
        self.counter = -1
        heartbeat_s = None if scene.axis is None else scene.axis.heartbeat_s
        self.report_periods = report_ticks(period_s, heartbeat_s)
        self.reports = first_reports(first_tick)
        self._reading: SensorReading
        self.node_id = 0
        """The drive's node number on its bus, for the clients that ask."""
        self.requests: list[int] = []
        self._ticks_a_gait_frame = ticks_of(codec.GAIT_SENSORS, period_s)
        self._last_gait_frame = -1

    def publish(self) -> list[Frame]:
        """The frames of tick k: both sensors', and one of the drive's others whose period has passed."""
        if self._faults is not None:
            self.drive_config, self.drive = self._faults.act(self.tick * self.period_s, self.drive)
        reading = self.plant.sense()
        if self._faults is not None:
            reading = self._faults.published(self.tick * self.period_s, reading)
        self._reading = reading
        estimates = axis.encoder_estimates(
            self.drive, reading.encoder_position_rev, reading.encoder_velocity_rev_s
        )
        if self._faults is not None:
            estimates = self._faults.counted(estimates)
        self.counter += 1
        frames = [
            codec.ACCELEROMETER.encode(
                Accelerometer(reading.striker_low_m_s2, reading.striker_high_m_s2, reading.housing_m_s2),
                self.counter,
            ),
            codec.ENCODER_ESTIMATES.encode(estimates),
        ]
        if self.plant.has_gait_sensors:
            frames += self._gait_frame()
        self.reports, report = take(look(self.report_periods, self.reports, self.tick))
        if report != NOTHING:
            frames.append(self._report(report))
        if self.requests:
            frames += [self._answer(can_id, frames[1]) for can_id in self.requests[:MOST_ANSWERS]]
            self.requests.clear()
        return frames if self._faults is None else self._faults.sent(frames)

    def _gait_frame(self) -> list[Frame]:
        """The gait sensors' frame, if a period of theirs has begun, and it does not drop out."""
        number = self.tick // self._ticks_a_gait_frame
        if number == self._last_gait_frame:
            return []
        self._last_gait_frame = number
        reading = self.plant.sense_gait()
        if reading is None:
            return []
        record = GaitSensors(
            reading.shank_rate_rad_s, reading.along_m_s2, int(reading.heel_contact), int(reading.toe_contact)
        )
        return [codec.GAIT_SENSORS.encode(record, number)]

    def _answer(self, can_id: int, estimates: Frame) -> Frame:
        """What a client has asked for."""
        if can_id in REPORT_OF_REQUEST:
            return self._report(REPORT_OF_REQUEST[can_id])
        if can_id == estimates.can_id:
            return estimates
        return VERSION if can_id == VERSION_ID else address(self.node_id)

    def _report(self, report: int) -> Frame:
        now = self.plant.now
        telemetry = Telemetry(now.current_a, now.motor_torque_n_m, now.omega_rad_s)
        can_id, length, word = report_frame(self.drive_config, self.drive, telemetry, report)
        return Frame(can_id, bytes_of(word, length))

    def advance(self, frames: Sequence[Frame]) -> None:
        """Obey `frames`, note the record of this tick, and move on to the next."""
        plant, config = self.plant, self.drive_config
        omega_rad_s = plant.now.omega_rad_s
        if self._faults is not None:
            frames = self._faults.heard(frames)
        self._obey(frames)
        torque_n_m = axis.torque_n_m(config, self.drive, omega_rad_s)
        self.record = self._record_of(torque_n_m)
        self.gait = plant.gait
        armed_s = min(self.period_s, axis.watchdog_left_s(config, self.drive))
        self._move(torque_n_m, armed_s)
        now = plant.now
        self.drive = axis.elapse(config, self.drive, armed_s, now.omega_rad_s, now.current_a)
        if armed_s < self.period_s - TIME_RESOLUTION_S:
            self._move(0.0, self.period_s - armed_s)
        self.tick += 1

    def _obey(self, frames: Sequence[Frame]) -> None:
        for can_id, data in frames:
            if can_id in COMMAND_IDS:
                frame = WordFrame(can_id, len(data), word_of(data))
                position_rev = self._reading.encoder_position_rev
                self.drive, was_read = obey(self.drive_config, self.drive, frame, position_rev)
                self.rejected += not was_read
            elif not data and can_id in REQUEST_IDS:
                self.requests.append(can_id)

    def resume(self, tick: int, drive: DriveState, reports: Reports, counter: int) -> None:
        """Go on from `tick`, to which compiled code has brought plant and drive."""
        self.tick, self.drive, self.reports, self.counter = tick, drive, reports, counter

    def sleep_through(self, ticks: int, frames: Sequence[Frame]) -> None:
        """Let `ticks` pass in which this process did not run; `frames` arrived meanwhile.

        The module moves on under the torque of the last command, for as long as a drive would hold it. The
        drive's watchdog does not count the pause: who slept cannot call the others silent.
        """
        if self.counter < 0:  # not even the first sample was sent
            self._reading = self.plant.sense()
        self._obey(frames)
        pause_s = ticks * self.period_s
        held_s = min(pause_s, axis.watchdog_left_s(self.drive_config, self.drive))
        self._move(axis.torque_n_m(self.drive_config, self.drive, self.plant.now.omega_rad_s), held_s)
        self._move(0.0, pause_s - held_s)
        self.tick += ticks
        self.counter += ticks  # the sensors went on sampling: what they count is time

    def _move(self, torque_n_m: float, dt_s: float) -> None:
        if dt_s > 0.0:
            if self._faults is not None:
                torque_n_m = self._faults.given_n_m(torque_n_m, self.plant.now.crank_rad)
            self.plant.advance(torque_n_m, dt_s)

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
        """The impacts that have ended since the last call."""
        impacts = self.plant.take_impacts()
        if self.began_s == 0.0:
            return impacts
        return [impact._replace(t_s=impact.t_s + self.began_s) for impact in impacts]
