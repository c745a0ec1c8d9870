"""The plant's faults in its node, tick by tick: the acting faults change parts, drive and readings."""

import math
from collections.abc import Sequence

from firmware_py.interface import codec
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import EncoderEstimates, SetInputTorque
from hil.drive import axis
from hil.drive.axis import DriveConfig, DriveState
from hil.faults.readings import SensorFaults
from hil.scenario import fault_tables as tables
from plant_sim.parts.drive import MotorDrive
from plant_sim.parts.friction import times
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import NoStop
from plant_sim.plant import Plant
from plant_sim.sensors.readings import SensorReading

DRIVE_IDS = frozenset(frame.can_id for frame in codec.CODECS.values() if frame.sender == "Drive")
"""Identifiers of the frames that the drive's electronics send."""
JAM_N_M = 10.0
"""Dry friction of a jammed crank, more than ten times the motor's torque: stops the crank within a tick."""


def broken_parts(parts: Parts, faults: Sequence[tables.PhysicalFault]) -> Parts:
    """The module's parts while `faults` act."""
    for fault in faults:
        match fault:
            case tables.StiffnessChanged(factor=factor):
                striker = parts.striker
                parts = parts._replace(striker=striker._replace(spring_n_m=factor * striker.spring_n_m))
            case tables.FrictionChanged(factor=factor):
                parts = parts._replace(friction=times(parts.friction, factor))
            case tables.StopMoved(by_m=by_m):
                stop = parts.stop
                if not isinstance(stop, NoStop):
                    parts = parts._replace(stop=stop._replace(position_m=stop.position_m + by_m))
            case tables.MotorStall():
                if isinstance(parts.drive, MotorDrive):
                    parts = parts._replace(drive=parts.drive._replace(dry_n_m=JAM_N_M))
            case tables.SupplySag(supply_v=supply_v):
                if isinstance(parts.drive, MotorDrive):
                    parts = parts._replace(drive=parts.drive._replace(supply_v=supply_v))
    return parts


def broken_config(config: DriveConfig, faults: Sequence[tables.PhysicalFault]) -> DriveConfig:
    """The drive's configuration while `faults` act."""
    for fault in faults:
        if isinstance(fault, tables.SupplySag):
            config = config._replace(supply_v=fault.supply_v)
    return config


def torque_share(faults: Sequence[tables.PhysicalFault], pole_pairs: int, crank_rad: float) -> float:
    """Share of the requested torque that the motor produces.

    With one wire disconnected, current flows along one axis u of the windings only. Of a current requested
    along q, perpendicular to the rotor's flux, only the projection (q·u) u flows, and its component along q
    produces torque: the share is (q·u)² = sin²(p θ).
    """
    if any(isinstance(fault, tables.PhaseLoss) for fault in faults):
        return math.sin(pole_pairs * crank_rad) ** 2
    return 1.0


class TurnCounter:
    """A position that counts revolutions from `count_rev` on, and wraps to its negative at `wraps_at_rev`."""

    def __init__(self, count_rev: int, wraps_at_rev: int) -> None:
        self._turns_rev = count_rev
        self._wraps_at_rev = wraps_at_rev
        self._last_rev: float | None = None

    def counted_rev(self, circular_rev: float) -> float:
        """The count at a position of 0 … 1, which has moved by less than half a turn since the last call."""
        if self._last_rev is not None:
            self._turns_rev -= round(circular_rev - self._last_rev)
        self._last_rev = circular_rev
        wide_rev = 2 * self._wraps_at_rev
        return (self._turns_rev + circular_rev + self._wraps_at_rev) % wide_rev - self._wraps_at_rev


class PlantFaults:
    """A scenario's sensor, drive and module faults, for one plant and its drive."""

    def __init__(self, faults: Sequence[tables.Fault], seed: int, plant: Plant, config: DriveConfig) -> None:
        self._sensors = SensorFaults(faults, seed)
        self._faults = [fault for fault in faults if isinstance(fault, tables.PhysicalFault)]
        self._plant = plant
        self._parts = plant.parts
        self._config = self._acting_config = config
        motor = plant.parts.drive
        self._pole_pairs = motor.pole_pairs if isinstance(motor, MotorDrive) else 0
        self._acting: list[tables.PhysicalFault] = []
        self._counter: TurnCounter | None = None

    def act(self, t_s: float, drive: DriveState) -> tuple[DriveConfig, DriveState]:
        """Begin and end the faults due at `t_s`; return the drive, as at power-up while it has no supply."""
        acting = [fault for fault in self._faults if fault.acts(t_s)]
        if acting != self._acting:
            began = [fault for fault in acting if fault not in self._acting]
            self._acting = acting
            parts = broken_parts(self._parts, acting)
            if parts != self._plant.parts:
                self._plant.replace_parts(parts)
            for fault in began:
                if isinstance(fault, tables.Kick):
                    self._plant.kick(fault.change_m_s)
                if isinstance(fault, tables.EncoderWrap):
                    self._counter = TurnCounter(fault.count_rev, fault.wraps_at_rev)
            if not any(isinstance(fault, tables.EncoderWrap) for fault in acting):
                self._counter = None
            self._acting_config = broken_config(self._config, acting)
        config = self._acting_config
        if self.is_dead:
            return config, axis.power_up(config)
        for fault in acting:
            if isinstance(fault, tables.OverTemperature):
                drive = drive._replace(motor_degc=fault.motor_degc)
        return config, drive

    def published(self, t_s: float, reading: SensorReading) -> SensorReading:
        """The sensors' reading with the acting faults, from the true reading."""
        return self._sensors.published(t_s, reading)

    def counted(self, estimates: EncoderEstimates) -> EncoderEstimates:
        """The drive's reported position, from its circular position."""
        if self._counter is None:
            return estimates
        return estimates._replace(position_rev=self._counter.counted_rev(estimates.position_rev))

    @property
    def is_dead(self) -> bool:
        """Whether the drive's electronics have no supply."""
        return any(isinstance(fault, tables.BrownOut) for fault in self._acting)

    def sent(self, frames: list[Frame]) -> list[Frame]:
        """The frames that leave the plant's node: none of the drive's while it has no supply."""
        return [frame for frame in frames if frame.can_id not in DRIVE_IDS] if self.is_dead else frames

    def received(self, frames: Sequence[Frame]) -> Sequence[Frame]:
        """The frames that reach the drive under the acting faults."""
        if self.is_dead:
            return ()
        for fault in self._acting:
            if isinstance(fault, tables.TorqueStuck):
                stuck = codec.SET_INPUT_TORQUE.encode(SetInputTorque(fault.torque_n_m))
                frames = [stuck if frame.can_id == stuck.can_id else frame for frame in frames]
        return frames

    def given_n_m(self, torque_n_m: float, crank_rad: float) -> float:
        """The motor's torque for the torque that the drive requests."""
        return torque_n_m * torque_share(self._acting, self._pole_pairs, crank_rad)
