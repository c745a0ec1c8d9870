"""A simulated module that is stepped in this process, in the order of real time (`hil.runs.lockstep`)."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from firmware_py.interface import codec
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import SetInputTorque
from hil.bus.base import NodeBus
from hil.bus.in_process import InProcessBus
from hil.bus.log.can_log import CanLog
from hil.faults.fault import Fault
from hil.faults.line import FaultyBus
from hil.nodes.firmware.runner import FirmwareRunner, ParameterMemory, controller_of
from hil.nodes.plant.runner import PlantRunner
from hil.nodes.runner import Pace
from hil.record.new_file import make_anew
from hil.record.traces.trace import no_trace
from hil.roster import PLANT
from hil.timing.clock import TICK_S
from plant_sim.result import Impact
from plant_sim.scene import Scene
from tools.bring_up.step import EMERGENCY, NOTHING, Largest, Player

NO_TORQUE = codec.SET_INPUT_TORQUE.encode(SetInputTorque(0.0))
US_A_TICK = round(TICK_S * 1e6)


class LockstepBench:
    """The module of a scene, which keeps its state from step to step; faults act from its power-up on."""

    def __init__(self, scene: Scene, seed: int, faults: Sequence[Fault] = ()) -> None:
        self.scene = scene
        self._bus = InProcessBus()
        self._pace = Pace(TICK_S, None, is_timed=False)
        self._line = FaultyBus(self._bus.join(), PLANT, faults, seed, TICK_S)
        self.plant = PlantRunner(scene, seed, self._pace, self._line, no_trace, faults)
        self.own: NodeBus = self._bus.join()
        """The line of the steps to the bus."""
        self._log = self._bus.join()
        self.tick = 0
        self.impacts: list[Impact] = []
        """The true impacts since power-up."""
        self.largest: dict[str, Largest] = {}
        """The largest true values while each log was written; the angle is one without a new torque."""
        self._torque, self._begin_rad = b"", 0.0
        """The last torque other than 0 of the steps, and the crank's angle at its begin."""

    def play(
        self, player: Player, longest_s: float, log: Path, parameters: Mapping[str, float] | None = None
    ) -> None:
        """See `Bench.play`."""
        firmware = self._power_up(parameters) if parameters is not None else None
        for waiting in (self.own, self._log):
            waiting.receive()
        begin, self._begin_rad = self.tick, self.plant.node.plant.now.crank_rad
        with CanLog(make_anew(log)) as file:
            try:
                while (tick := self.tick - begin) < round(longest_s / TICK_S):
                    self._step_plant(log.stem)
                    frames = player.play(tick, self.own.receive())
                    if frames is None:
                        break
                    self.own.send_all(frames)
                    self._note_torque(frames)
                    if firmware is not None:
                        firmware.step(self.tick)
                    file.write(tick * US_A_TICK, self._log.receive())
                    self.tick += 1
            except BaseException:
                if player.moves:
                    self.own.send_all(EMERGENCY)
                raise
        if firmware is not None:  # as the process that ends
            self.own.send_all([NO_TORQUE])

    def _power_up(self, parameters: Mapping[str, float]) -> FirmwareRunner:
        memory = ParameterMemory(parameters, (), 0)
        pace = self._pace._replace(first_tick=self.tick)
        line = FaultyBus(self._bus.join(), "firmware", (), 0, TICK_S)
        return FirmwareRunner(memory, pace, line, no_trace, False, controller_of("compiled"))

    def rest(self, duration_s: float) -> None:
        """Let time pass without a player."""
        for _ in range(round(duration_s / TICK_S)):
            self._step_plant("rest")
            self.tick += 1

    def _note_torque(self, frames: Sequence[Frame]) -> None:
        for can_id, torque in frames:
            if can_id == codec.SET_INPUT_TORQUE.can_id and torque not in (self._torque, NO_TORQUE.data):
                self._torque, self._begin_rad = torque, self.plant.node.plant.now.crank_rad

    def _step_plant(self, name: str) -> None:
        self._line.move_to(self.tick * TICK_S)
        self.plant.step(self.tick)
        impacts = self.plant.node.take_impacts()
        self.impacts += impacts
        now, before = self.plant.node.plant.now, self.largest.get(name, NOTHING)
        forces_n = [one.peak_force_n for one in impacts if math.isfinite(one.peak_force_n)]
        self.largest[name] = before._replace(
            force_n=max(before.force_n, *forces_n, 0.0),
            angle_rad=max(
                before.angle_rad, abs(math.remainder(now.crank_rad - self._begin_rad, 2.0 * math.pi))
            ),
            torque_n_m=max(before.torque_n_m, abs(now.motor_torque_n_m)),
            speed_rad_s=max(before.speed_rad_s, abs(now.omega_rad_s)),
        )
