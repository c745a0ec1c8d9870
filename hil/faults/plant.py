"""The faults of drive, module and sensors in the plant's node: they change parts, drive and readings."""

import math
from collections.abc import Sequence

import numpy as np

from firmware_py.interface.addresses import NODE_IDS
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import EncoderEstimates
from hil.drive import axis
from hil.drive.axis import DriveConfig, DriveState
from hil.faults.fault import TIME_RESOLUTION_S, Fault
from hil.faults.on_plant import PhysicalFault
from hil.faults.on_sensor import ReadingFault
from plant_sim.parts.drive import MotorDrive
from plant_sim.plant import Plant
from plant_sim.sensors.readings import SensorReading

DRIVE_IDS = range(NODE_IDS)
"""Identifiers of the drive's electronics: those of node 0."""


class PlantFaults:
    """A scenario's drive and module faults, for one plant and its drive."""

    def __init__(
        self, faults: Sequence[Fault], plant: Plant, config: DriveConfig, began_s: float = 0.0
    ) -> None:
        """`began_s`: time of the plant's power-up; earlier kicks did not meet it."""
        self._faults = [fault for fault in faults if isinstance(fault, PhysicalFault)]
        edges_s = {edge_s for fault in self._faults for edge_s in (fault.at_s, fault.end_s)}
        self._edges_s = sorted(edge_s for edge_s in edges_s if edge_s < math.inf)
        self._plant = plant
        self._began_s = began_s
        self._parts = plant.parts
        self._config = self._acting_config = config
        motor = plant.parts.drive
        self._pole_pairs = motor.pole_pairs if isinstance(motor, MotorDrive) else 0
        self._acting: list[PhysicalFault] = []
        self.waits = False
        """Whether a stop waits to move until the striker is clear of its new place."""
        self._changing: list[PhysicalFault] = []
        """The acting faults that change the plant in every tick."""

    def edges_s(self, from_s: float, to_s: float) -> list[float]:
        """The times at which a fault of module or drive begins or ends, with `from_s` ≤ t < `to_s`."""
        first_s, last_s = from_s - TIME_RESOLUTION_S, to_s - TIME_RESOLUTION_S
        return [edge_s for edge_s in self._edges_s if first_s <= edge_s < last_s]

    def act(self, t_s: float, drive: DriveState, ticks: int = 1) -> tuple[DriveConfig, DriveState]:
        """Begin and end the faults due at `t_s`; return the drive, as at power-up while it has no supply.

        `ticks`: the number of ticks for which the faults act until the next call.
        """
        acting = [fault for fault in self._faults if fault.acts(t_s)]
        if acting != self._acting or self.waits:
            began = [fault for fault in acting if fault not in self._acting]
            self._acting = acting
            self._break(acting)
            for fault in began:
                fault.strike(self._plant, self._began_s)
        for fault in self._changing:
            fault.count(ticks)
        config = self._acting_config
        if self.is_dead:
            return config, axis.power_up(config)
        for fault in acting:
            drive = fault.drive(drive)
        return config, drive

    def _break(self, acting: Sequence[PhysicalFault]) -> None:
        """Give plant and drive the changes of these faults; a rigid stop stays until the striker is clear."""
        parts, config = self._parts, self._config
        for fault in acting:
            parts, config = fault.parts(parts), fault.config(config)
        self.waits = not self._plant.is_clear_of(parts)
        if self.waits:
            parts = parts._replace(stop=self._plant.parts.stop)
        if parts != self._plant.parts:
            self._plant.replace_parts(parts)
        self._acting_config = config
        self._changing = [
            fault
            for fault in acting
            if fault.changes(self._parts, self._config)
            and not (self.waits and fault.parts(self._parts).stop != self._parts.stop)
        ]

    def reported(self, estimates: EncoderEstimates) -> EncoderEstimates:
        """The drive's reported position, from its circular position."""
        for fault in self._acting:
            estimates = fault.reported(estimates)
        return estimates

    @property
    def is_dead(self) -> bool:
        """Whether the drive's electronics have no supply."""
        return any(fault.cuts_supply for fault in self._acting)

    def sent(self, frames: list[Frame]) -> list[Frame]:
        """The frames that leave the plant's node: none of the drive's while it has no supply."""
        return [frame for frame in frames if frame.can_id not in DRIVE_IDS] if self.is_dead else frames

    def received(self, frames: Sequence[Frame]) -> Sequence[Frame]:
        """The frames that reach the drive under the acting faults."""
        if self.is_dead:
            return ()
        for fault in self._acting:
            given = fault.received(frames)
            if given is not frames:
                changed = sum(one != other for one, other in zip(frames, given, strict=True))
                fault.count(changed)
                frames = given
        return frames

    def given_n_m(self, torque_n_m: float, crank_rad: float) -> float:
        """The motor's torque for the torque that the drive requests."""
        for fault in self._acting:
            given_n_m = fault.given_n_m(torque_n_m, self._pole_pairs, crank_rad)
            fault.count(given_n_m != torque_n_m)
            torque_n_m = given_n_m
        return torque_n_m


class SensorFaults:
    """All sensor faults of a scenario; call `published` once per reading."""

    def __init__(self, faults: Sequence[Fault], seed: int) -> None:
        self._faults = [fault for fault in faults if isinstance(fault, ReadingFault)]
        for number, fault in enumerate(self._faults):
            fault.begin(np.random.default_rng([seed, 1000 + number]))
        self._last: SensorReading | None = None
        self._last_s = 0.0

    def published(self, t_s: float, reading: SensorReading) -> SensorReading:
        """The published reading at `t_s`, from the true reading."""
        for fault in self._faults:
            if fault.acts(t_s):
                reading = fault.published(reading, self._last or reading, t_s - self._last_s)
        self._last, self._last_s = reading, t_s
        return reading
