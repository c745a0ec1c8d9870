"""The plant as one CAN node: the module, its sensors and its motor's drive.

At t_k `publish` returns the frames of the sensors. `advance` then obeys the frames that have arrived and
moves the module to t_{k+1}. If the loop has skipped ticks, `sleep_through` advances the module by their time.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from firmware_py.builds.numba_subset import register
from firmware_py.interface import codec
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated import packing
from firmware_py.interface.generated.records import EncoderEstimates, GaitSensors
from hil.bus.frame_rows import byte_frame, frames_in, word_frame
from hil.bus.wire import REMOTE_FLAG
from hil.drive import axis
from hil.drive.axis import TIME_RESOLUTION_S, DriveConfig, DriveState
from hil.drive.axis_table import AxisTable, BenchScene
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
    obey,
    powers,
    report_frame,
    torques,
)
from hil.drive.reports import Ticks, first_reports, report_ticks, ticks_of
from hil.faults.fault import Fault
from hil.faults.plant import PlantFaults, SensorFaults
from hil.nodes.compiled import kernel
from hil.nodes.plant.sampled import SampledFrames
from hil.nodes.plant.steps import (
    MOST_FRAMES,
    NOTHING_DUE,
    Due,
    PlantState,
    Setup,
    encoder_frame,
    encoder_sample,
    move_on,
    publish,
    telemetry,
)
from hil.record.traces.plant_trace import PlantRecord
from hil.timing.clock import TICK_S
from plant_sim.kernels import entry_point
from plant_sim.parts.drive import MotorDrive, MotorTable
from plant_sim.plant import Plant
from plant_sim.result import Impact
from plant_sim.scene import Scene
from plant_sim.sensors.gait import GaitTruth
from plant_sim.sensors.readings import SensorReading

register()

_MOVE_ON = kernel(move_on)

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


def axis_of(scene: Scene) -> AxisTable | None:
    """The configuration of a scene's drive; None for the defaults."""
    return scene.axis if isinstance(scene, BenchScene) else None


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


def requests_in(frames: Sequence[Frame]) -> list[int]:
    """The identifiers of the frames by which a client asks the drive."""
    return [frame.can_id for frame in frames if not frame.data and frame.can_id in REQUEST_IDS]


@kernel
def pack_gaits(
    ticks: NDArray[np.int64], ticks_a_frame: int, readings: NDArray[np.float64], frames: NDArray[np.int64]
) -> int:
    """Write the gait sensors' frames as rows of `Due.gait`, but of samples that drop out; their number."""
    count = 0
    for index in range(ticks.size):
        reading = readings[index]
        if not math.isnan(reading[0]):
            sample = GaitSensors(reading[0], reading[1], int(reading[2]), int(reading[3]))
            frame = packing.pack_gait_sensors(sample, ticks[index] // ticks_a_frame)[0]
            row = frames[count]
            row[0], row[1], row[2], row[3] = ticks[index], frame.can_id, frame.length, frame.word
            count += 1
    return count


class PlantNode:
    """Publishes the state at t_k, then moves to t_{k+1} under the drive's torque."""

    def __init__(
        self,
        scene: Scene,
        seed: int,
        period_s: float = TICK_S,
        faults: Sequence[Fault] = (),
        first_tick: int = 0,
        node_id: int = 0,
    ) -> None:
        """`first_tick`: tick of power-up, at which the module is in the scene's initial state. `node_id`:
        the drive's node number on its bus, for clients that request its address.
        """
        self.plant = Plant(scene, seed=seed)
        self.drive_config = drive_config(scene)._replace(node_id=node_id)
        self.state = PlantState(
            tick=first_tick,
            counter=-1,
            reports=first_reports(first_tick),
            drive=axis.power_up(self.drive_config),
            torque_n_m=0.0,
            rejected=0,
        )
        """The state between two steps, which compiled steps continue."""
        self.period_s = period_s
        self.began_s = first_tick * period_s
        self._sensor_faults = SensorFaults(faults, seed)
        self._faults = PlantFaults(faults, self.plant, self.drive_config, self.began_s)
        self.record: PlantRecord
        self.gait: GaitTruth | None = None
        """The gait at t_k; None without a walk."""
        self._report_ticks, self._ticks_an_encoder_frame = frame_ticks(scene, period_s)
        self._reading: SensorReading
        self._estimates: EncoderEstimates
        self._requests: list[int] = []
        self._ticks_a_gait_frame = ticks_of(codec.GAIT_SENSORS, period_s)
        self._last_gait_frame = -1
        self._sampled = SampledFrames(self.plant, period_s)
        self._outbox = np.zeros((MOST_FRAMES, 3), np.int64)
        self._move_on = entry_point(_MOVE_ON, self.plant.run, self.drive_config, self.drive, 0.0, period_s)

    @property
    def tick(self) -> int:
        """The tick of the next step."""
        return self.state.tick

    @property
    def drive(self) -> DriveState:
        """The drive's state."""
        return self.state.drive

    @property
    def setup(self) -> Setup:
        """The drive's configuration and the frames' periods."""
        return Setup(
            self.drive_config, self._report_ticks, self._ticks_an_encoder_frame, self._sampled.all_sensors
        )

    def due(self, ticks: int) -> Due:
        """The gait sensors' frames and the samples of the next `ticks`; each is sampled once."""
        if not (self.plant.has_gait_sensors or self.plant.sampled):
            return NOTHING_DUE
        samples = self._sampled.rows(self.tick, ticks)
        return Due(self._gait_rows(range(self.tick, self.tick + ticks)), samples, np.zeros(2, np.int64))

    def _gait_rows(self, ticks: range) -> NDArray[np.int64]:
        """The gait sensors' frames, one for each period that begins in `ticks`, unless it drops out."""
        due = []
        for tick in ticks if self.plant.has_gait_sensors else ():
            number = tick // self._ticks_a_gait_frame
            if number != self._last_gait_frame:
                self._last_gait_frame = number
                due.append(tick)
        if not due:
            return NOTHING_DUE.gait
        numbers: NDArray[np.int64] = np.array(due)
        readings = self.plant.sense_gaits(np.array(due) * self.period_s - self.began_s)
        frames = np.zeros((len(due), 4), np.int64)
        return frames[: pack_gaits(numbers, self._ticks_a_gait_frame, readings, frames)]

    def note_requests(self, frames: Sequence[Frame]) -> bool:
        """Note the requests of clients among frames, which `publish` answers; whether there are any."""
        self._requests += requests_in(frames)
        return bool(self._requests)

    def publish(self) -> list[Frame]:
        """The frames of tick k: sensor samples, at most one further report of the drive, and answers."""
        self.act()
        self._reading = self._sensor_faults.published(self.tick * self.period_s, self.plant.sense())
        self._estimates = self._faults.reported(encoder_sample(self.drive, self._reading))
        self.state, count = publish(
            self.setup,
            self.due(1),
            self.plant.observed,
            self.state,
            self._reading,
            self._estimates,
            self._outbox,
        )
        frames = frames_in(self._outbox[:count])
        frames += [self._answer(can_id) for can_id in self._requests[:MOST_ANSWERS]]
        self._requests.clear()
        return self._faults.sent(frames)

    def _answer(self, can_id: int) -> Frame:
        """The frame that answers a client's request for `can_id`."""
        config, drive, now = self.drive_config, self.drive, telemetry(self.plant.observed)
        if can_id in REPORT_OF_REQUEST:
            return byte_frame(*report_frame(config, drive, now, REPORT_OF_REQUEST[can_id]))
        if can_id == codec.ENCODER_ESTIMATES.can_id:
            return byte_frame(*encoder_frame(self._estimates))
        if can_id == TORQUES_ID:
            return torques(config, drive, now)
        if can_id == POWERS_ID:
            return powers(config, drive, now)
        return VERSION if can_id == VERSION_ID else address(config.node_id)

    def advance(self, frames: Sequence[Frame]) -> None:
        """Obey `frames`, make the record of this tick, and advance to the next."""
        self._obey(self._faults.received(frames))
        self.record = PlantRecord(
            self.tick,
            self.tick * self.period_s,
            *self.plant.now,
            self.state.torque_n_m,
            self.drive.axis.state,
            self.drive.axis.errors,
            *self._reading,
        )
        self.gait = self.plant.gait_at(self.record.t_s - self.began_s)
        self._pass_time(self.period_s, 2.0 * TIME_RESOLUTION_S, self._drive_on)
        self.state = self.state._replace(tick=self.tick + 1)

    def _pass_time(self, duration_s: float, after_s: float, move_by: Callable[[float], None]) -> None:
        """Let faults begin and end at their times, from `after_s` on; `move_by` the durations in between."""
        begin_s, gone_s = self.tick * self.period_s, 0.0
        edges_s = self._faults.edges_s(begin_s + after_s, begin_s + duration_s)
        for edge_s in edges_s:
            move_by(edge_s - begin_s - gone_s)
            gone_s = edge_s - begin_s
            self._act_at(edge_s)
            torque_n_m = axis.torque_n_m(self.drive_config, self.drive, self.plant.now.omega_rad_s)
            self.state = self.state._replace(torque_n_m=torque_n_m)
        move_by(duration_s - gone_s)

    def _given_n_m(self, torque_n_m: float) -> float:
        """The motor's torque for the one that the drive requests."""
        return self._faults.given_n_m(torque_n_m, self.plant.now.crank_rad)

    def _drive_on(self, dt_s: float) -> None:
        """Advance by `dt_s` under the drive's torque, until its watchdog expires."""
        given_n_m = self._given_n_m(self.state.torque_n_m)
        drive, status = self._move_on(self.plant.run, self.drive_config, self.drive, given_n_m, dt_s)
        self.resume(self.state._replace(drive=drive), status)

    def _obey(self, frames: Sequence[Frame]) -> None:
        """Obey the commands, and note the requests, which are answered in the next tick."""
        config, state = self.drive_config, self.state
        drive, rejected = state.drive, state.rejected
        for frame in frames:
            drive, was_read = obey(config, drive, word_frame(frame), self._reading.encoder_position_rev)
            rejected += not was_read
        self.note_requests(frames)
        torque_n_m = axis.torque_n_m(config, drive, self.plant.now.omega_rad_s)
        self.state = PlantState(state.tick, state.counter, state.reports, drive, torque_n_m, rejected)

    def gaits_in(self, tick: int, ticks: int) -> NDArray[np.float64] | None:
        """The gait in `ticks` from `tick` on, one row of `GaitTruth` each; None without a walk."""
        numbers = np.arange(tick, tick + ticks, dtype=np.float64)
        return self.plant.gaits_at(numbers * self.period_s - self.began_s)

    def act(self, ticks: int = 1) -> None:
        """Begin and end the faults that are due in this tick; they act for `ticks` until the next call."""
        self._act_at(self.tick * self.period_s, ticks)

    def _act_at(self, t_s: float, ticks: int = 1) -> None:
        self.drive_config, drive = self._faults.act(t_s, self.drive, ticks)
        if drive is not self.state.drive:
            self.state = self.state._replace(drive=drive)

    @property
    def has_waiting_fault(self) -> bool:
        """Whether a fault is due that cannot act yet (`PlantFaults.waits`)."""
        return self._faults.waits

    def resume(self, state: PlantState, status: int, reading: SensorReading | None = None) -> None:
        """Continue from the state that compiled steps have reached, with the solver's status.

        `reading`: the sensors' last one, if a step that the node makes itself may follow a missed tick.
        """
        self.state = state
        if reading is not None:
            self._reading = reading
        self.plant.take_back(status)

    def sleep_through(self, ticks: int, frames: Sequence[Frame]) -> None:
        """Advance by `ticks` in which this process did not run; `frames` arrived in that time.

        The module moves under the torque of the last command until the drive's watchdog would expire; faults
        of module and drive act at their times. The
        pause does not count towards the watchdog afterwards, since this process could not receive commands in
        it.
        """
        if self.state.counter < 0:  # the first sample has not been sent yet
            self._reading = self.plant.sense()
        self._obey(frames)
        armed_s = axis.watchdog_left_s(self.drive_config, self.drive)

        def coast(dt_s: float) -> None:
            nonlocal armed_s
            driven_s = min(armed_s, dt_s)
            for torque_n_m, duration_s in ((self.state.torque_n_m, driven_s), (0.0, dt_s - driven_s)):
                if duration_s > 0.0:
                    self.plant.advance(self._given_n_m(torque_n_m), duration_s)
            armed_s -= driven_s

        self._pass_time(ticks * self.period_s, 0.0, coast)
        # The sensors continued to sample: their counter counts periods.
        self.state = self.state._replace(tick=self.tick + ticks, counter=self.state.counter + ticks)

    def take_impacts(self) -> list[Impact]:
        """Remove and return the impacts that have ended since the last call."""
        impacts = self.plant.take_impacts()
        if self.began_s == 0.0:
            return impacts
        return [impact._replace(t_s=impact.t_s + self.began_s) for impact in impacts]
