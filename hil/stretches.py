"""Stretches of lockstep in one compiled call (`hil.closed_loop`), between which lockstep runs tick by tick.

A stretch ends before a fault begins, and the next one starts some time after the fault has ended. Faults that
only change the module's parts or the drive's configuration act within stretches once they have begun. Runs
with a modelled bus, a wearer, a fault of a clock or a restart have no stretches. Frames, traces and can.log
are those of lockstep tick by tick.
"""

import math
from collections.abc import Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from firmware_py.builds.entry import entry
from firmware_py.interface.frame import Frame, WordFrame, bytes_of, word_of
from firmware_py.shell.compiled_node import CompiledNode
from firmware_py.shell.flat_node import FirmwareFailedError
from hil.bus.in_process import InProcessNode
from hil.can_log import CanLog
from hil.clock import NS_PER_S
from hil.closed_loop import (
    FIRMWARE_FAILED,
    LINE_BYTES,
    MOST_FRAMES,
    NO_FRAME,
    Buffers,
    Constants,
    Firmware,
    Held,
    Loop,
    run,
)
from hil.faults.tables import (
    ClockJitter,
    ClockJumped,
    Fault,
    FrictionChanged,
    Kick,
    MotorStall,
    ParametersDamaged,
    Restarted,
    StiffnessChanged,
    StopMoved,
    SupplySag,
)
from hil.firmware_trace import moves_to
from hil.nodes import FirmwareRunner, OperatorRunner, PlantRunner
from hil.operator import OPERATOR_PERIOD_S
from hil.plant_node import ImpactRecord, PlantRecord
from hil.scenario import Scenario
from plant_sim.solvers.adaptive import NO_GRID, NO_SAMPLES

STEADY = (FrictionChanged, Kick, MotorStall, ParametersDamaged, StiffnessChanged, StopMoved, SupplySag)
"""Faults that do nothing from tick to tick between their begin and their end."""
OF_A_CLOCK = (ClockJitter, ClockJumped, Restarted)
"""Faults that give a node a clock of its own (`hil.faults.clocks.in_turns`)."""
AHEAD_S = 0.005
"""A stretch ends this long before a fault begins."""
BEHIND_S = 0.25
"""A stretch begins this long after a fault has begun or ended: by then nothing of it is under way."""
SHORTEST_TICKS = 20
LONGEST_TICKS = 4096
"""What the buffers hold."""
LINES_A_TICK = 7


def has_stretches(scenario: Scenario) -> bool:
    """Whether any part of a run of the scenario may be compiled."""
    has_clock_faults = any(isinstance(fault, OF_A_CLOCK) for fault in scenario.faults)
    return scenario.bitrate is None and scenario.scene.gait is None and not has_clock_faults


def quiet_until_s(faults: Sequence[Fault], t_s: float) -> float:
    """Until when nothing of the faults happens, from `t_s` on; `t_s` itself where something does."""
    until_s = math.inf
    for fault in faults:
        edges = (fault.at_s, fault.end_s)
        busy = [(edge - AHEAD_S, edge + BEHIND_S) for edge in edges]
        if not isinstance(fault, STEADY):
            busy = [(fault.at_s - AHEAD_S, fault.end_s + BEHIND_S)]
        for begin_s, end_s in busy:
            if begin_s <= t_s < end_s:
                return t_s
            if t_s < begin_s:
                until_s = min(until_s, begin_s)
    return until_s


def word_frame(frame: Frame) -> WordFrame:
    """The frame as compiled code handles it."""
    return WordFrame(frame.can_id, len(frame.data), word_of(frame.data))


def byte_frame(frame: WordFrame) -> Frame:
    """The frame as the bus handles it."""
    return Frame(frame.can_id, bytes_of(frame.word, frame.length))


class Stretches:
    """Runs stretches of one scenario on the nodes of lockstep."""

    def __init__(
        self,
        scenario: Scenario,
        plant: PlantRunner,
        firmware: FirmwareRunner,
        operator: OperatorRunner,
        can_log: CanLog,
        to_plant: InProcessNode,
    ) -> None:
        """`to_plant`: where the bus keeps the frames that the plant takes next."""
        self._scenario = scenario
        self._plant = plant
        self._firmware = firmware
        self._operator = operator
        self._can_log = can_log
        self._to_plant = to_plant
        self._period_ns = round(scenario.period_s * NS_PER_S)
        self._plant_rows = np.zeros(LONGEST_TICKS, plant.columns)
        self._firmware_rows = np.zeros(LONGEST_TICKS, firmware.columns)
        self._buffers = Buffers(
            plant=np.zeros((LONGEST_TICKS, len(PlantRecord._fields))),
            firmware=self._firmware_rows.view(np.uint8),
            moves=moves_to(firmware.columns),
            impacts=np.zeros((LONGEST_TICKS, len(ImpactRecord._fields))),
            can_log=np.zeros(LONGEST_TICKS * LINES_A_TICK * LINE_BYTES, np.uint8),
            used=np.zeros(3, np.int64),
        )

    def ticks_from(self, tick: int) -> int:
        """How many ticks from `tick` on may be compiled; 0 where a few are not worth it."""
        scenario = self._scenario
        quiet_s = quiet_until_s(scenario.faults, tick * scenario.period_s)
        until = scenario.ticks if quiet_s == math.inf else int(quiet_s / scenario.period_s)
        ticks = min(min(until, scenario.ticks) - tick, LONGEST_TICKS)
        is_asked = (
            self._compiled_node().memory["received"]["request_count"][0] > 0 or self._plant.node.requests
        )
        is_ready = self._firmware.is_in_step and len(self._to_plant.pending) <= len(Held._fields)
        return ticks if ticks >= SHORTEST_TICKS and is_ready and not is_asked else 0

    def _compiled_node(self) -> CompiledNode:
        """The firmware's node, a new one after a restart."""
        node = self._firmware.node
        assert isinstance(node, CompiledNode)
        return node

    def run(self, tick: int, ticks: int, operator_period: int) -> int:
        """Run `ticks` from `tick` on; the operator's next period."""
        period_s, buffers = self._scenario.period_s, self._buffers
        plant = self._plant.node
        spoken, operator_period = self._spoken(tick + ticks, operator_period)
        lent = plant.plant.lend()
        constants = Constants(
            period_s,
            self._period_ns,
            lent.readers,
            plant.drive_config,
            plant.report_periods,
            lent.stored_before_j,
            self._firmware_rows.itemsize,
        )
        frames, sent = np.zeros((MOST_FRAMES, 3), np.int64), np.zeros(7, np.int64)
        node = self._compiled_node()
        config, state = node.flat_config.ctypes.data, node.memory.ctypes.data
        compiled = Firmware(entry.address, config, state, frames, sent, node.memory.view(np.uint8))
        held = [word_frame(frame) for frame in self._to_plant.receive()]
        held += [NO_FRAME] * (len(Held._fields) - len(held))
        drive, reports, counter = plant.drive, plant.reports, plant.counter
        loop = Loop(tick, lent.t_s, lent.t_rest_s, 0.0, drive, reports, counter, Held(*held))
        noise = np.array(list(islice(lent.noise, ticks)))
        buffers.used[:] = 0
        module = lent.parts, lent.probe, lent.memory
        loop, status = run(*module, constants, compiled, loop, spoken, noise, buffers, NO_GRID, NO_SAMPLES)
        if status == FIRMWARE_FAILED:
            raise FirmwareFailedError(
                f"a division by zero or a domain error in the compiled firmware's tick {loop.tick}"
            )
        plant.plant.take_back(loop.t_s, loop.t_rest_s, loop.torque_n_m, status)
        plant.resume(loop.tick, loop.drive, loop.reports, loop.counter)
        self._to_plant.pending += [byte_frame(frame) for frame in loop.held if frame.can_id != 0]
        self._write(tick, ticks, frames)
        return operator_period

    def _write(self, tick: int, ticks: int, frames: NDArray[np.int64]) -> None:
        """Hand a stretch's records to traces and log; `frames`: those of the firmware's last tick."""
        buffers, rows = self._buffers, self._firmware_rows[:ticks]
        for column, name in enumerate(PlantRecord._fields):
            self._plant_rows[name][:ticks] = buffers.plant[:ticks, column]
        _, impacts, log_bytes = buffers.used.tolist()
        self._plant.append(self._plant_rows[:ticks], buffers.impacts[:impacts])
        numbers = np.arange(tick, tick + ticks)
        rows["tick"], rows["t_s"] = numbers, (numbers + 0.5) * self._scenario.period_s
        last = [byte_frame(WordFrame(*frame)) for frame in frames.tolist() if frame[0] != 0]
        self._firmware.append(rows, tick + ticks - 1, last)
        self._can_log.append(buffers.can_log[:log_bytes].tobytes())

    def _spoken(self, until_tick: int, period: int) -> tuple[NDArray[np.int64], int]:
        """What the operator sends before `until_tick`, and its next period."""
        rows: list[tuple[int, int, int, int]] = []
        period_s = self._scenario.period_s
        while True:
            tick = math.ceil(period * OPERATOR_PERIOD_S / period_s - 1e-6)
            if tick >= until_tick:
                return np.array(rows, dtype=np.int64).reshape(-1, 4), period
            rows += [(tick, *word_frame(frame)) for frame in self._operator.frames(period)]
            period += 1


def stretches_of(
    scenario: Scenario,
    plant: PlantRunner,
    firmware: FirmwareRunner,
    operator: OperatorRunner,
    can_log: CanLog,
    to_plant: InProcessNode,
) -> Stretches | None:
    """The stretches of a run on these nodes; None where it has none."""
    if not has_stretches(scenario):
        return None
    return Stretches(scenario, plant, firmware, operator, can_log, to_plant)
