"""Stretches: sequences of lockstep ticks in one compiled call, with single ticks of lockstep in between.

A stretch ends before a fault begins, and the next one starts some time after the fault has ended. Faults that
only change the module's parts or the drive's configuration begin and end between two stretches. There is no
stretch while a node's clock differs from the bench's, nor in runs with a modelled bus or an encoder with a
period of its own. Frames, traces and can.log equal those of tick-by-tick lockstep.

`records_of` runs a whole scenario in stretches without a run folder, for campaigns.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface.frame import Frame, WordFrame, bytes_of, word_of
from firmware_py.shell.builds import Build, node_of
from firmware_py.shell.flat_node import FirmwareFailedError
from firmware_py.shell.native import NativeNode
from hil.bus.can_log import CanLog
from hil.bus.in_process import InProcessBus, InProcessNode
from hil.faults.clocks import Turns
from hil.nodes.closed_loop import (
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
from hil.nodes.runners import FirmwareRunner, OperatorRunner, Pace, PlantRunner
from hil.record.traces.firmware_trace import columns_in, moves_to
from hil.record.traces.plant_trace import PlantRecord
from hil.scenario.fault_tables import (
    Fault,
    FrictionChanged,
    Kick,
    MotorStall,
    ParametersDamaged,
    StiffnessChanged,
    StopMoved,
    SupplySag,
)
from hil.scenario.operator import OPERATOR_PERIOD_S
from hil.scenario.scenario import Scenario
from hil.timing.clock import NS_PER_S
from hil.timing.signals import delayed_signals
from plant_sim.arrays import zeros_of
from plant_sim.kernels import entry_point
from plant_sim.result import Impact
from plant_sim.sensors.gait import GaitTruth
from plant_sim.solvers.adaptive.adaptive import NO_GRID

STEADY = (FrictionChanged, Kick, MotorStall, ParametersDamaged, StiffnessChanged, StopMoved, SupplySag)
"""Faults that act only at their beginning and their end, not from tick to tick."""
AHEAD_S = 0.005
"""Time from the end of a stretch to the beginning of any other fault."""
BEHIND_S = 0.25
"""Time from the end of a fault to the next stretch, after which no delayed frame of the fault remains."""
SAME_INSTANT_S = 1e-9
LONGEST_TICKS = 4096
"""Longest stretch in ticks; the size of the buffers."""
LINES_A_TICK = 8


def has_stretches(scenario: Scenario) -> bool:
    """Whether any part of a run of the scenario may use compiled stretches."""
    scene = scenario.scene
    encoder_has_period = scene.axis is not None and scene.axis.encoder_s is not None
    return scenario.bitrate is None and not encoder_has_period


def quiet_until_s(faults: Sequence[Fault], t_s: float) -> float:
    """The end of the interval from `t_s` on in which no fault changes or acts; `t_s` if there is none."""
    until_s = math.inf
    for fault in faults:
        if isinstance(fault, STEADY):
            edges_s = [edge_s for edge_s in (fault.at_s, fault.end_s) if edge_s > t_s + SAME_INSTANT_S]
            until_s = min([until_s, *edges_s])
        elif t_s < fault.at_s - AHEAD_S:
            until_s = min(until_s, fault.at_s - AHEAD_S)
        elif t_s < fault.end_s + BEHIND_S:
            return t_s
    return until_s


def word_frame(frame: Frame) -> WordFrame:
    """Convert a frame of the bus to a frame of the compiled code."""
    return WordFrame(frame.can_id, len(frame.data), word_of(frame.data))


def byte_frame(frame: WordFrame) -> Frame:
    """Convert a frame of the compiled code to a frame of the bus."""
    return Frame(frame.can_id, bytes_of(frame.word, frame.length))


class Records(NamedTuple):
    """The records of a stretch: views of buffers that the next stretch overwrites.

    `plant`: numbers in the order of `PlantRecord`, one row per tick. `firmware`: the requested columns, one
    record per tick. `impacts`: records of type `Impact`, one per finished impact, with times from the plant's
    power-up. `can_log`: lines.
    """

    plant: NDArray[np.float64]
    firmware: NDArray[np.void]
    impacts: NDArray[np.void]
    can_log: NDArray[np.uint8]


class Nodes(NamedTuple):
    """The nodes of lockstep; `to_plant` holds the frames that the plant receives next."""

    plant: PlantRunner
    firmware: FirmwareRunner
    operator: OperatorRunner
    to_plant: InProcessNode


class Stretches:
    """Runs stretches of one scenario on the nodes of lockstep."""

    def __init__(self, scenario: Scenario, nodes: Nodes, columns: Any, is_logged: bool) -> None:
        """`columns`: packed type of the firmware's recorded columns (`hil.record.traces.firmware_trace`)."""
        self._scenario = scenario
        self._plant, self._firmware, self._operator, self._to_plant = nodes
        self._period_ns = round(scenario.period_s * NS_PER_S)
        self._run: Callable[..., tuple[Loop, int]] | None = None
        self._columns, precision = columns, self._native_node().native.precision
        self._firmware_rows = np.zeros(LONGEST_TICKS, columns_in(columns, precision))
        self._buffers = Buffers(
            plant=np.zeros((LONGEST_TICKS, len(PlantRecord._fields))),
            firmware=self._firmware_rows.view(np.uint8),
            moves=moves_to(self._firmware_rows.dtype, precision),
            impacts=zeros_of(Impact, LONGEST_TICKS),
            can_log=np.zeros(LONGEST_TICKS * LINES_A_TICK * LINE_BYTES if is_logged else 0, np.uint8),
            used=np.zeros(3, np.int64),
        )

    def ticks_from(self, tick: int) -> int:
        """Number of ticks from `tick` on that may be compiled."""
        scenario = self._scenario
        quiet_s = quiet_until_s(scenario.faults, tick * scenario.period_s)
        until = scenario.ticks
        if quiet_s < math.inf:
            until = min(until, math.ceil((quiet_s - SAME_INSTANT_S) / scenario.period_s))
        is_asked = self._native_node().memory["requests"]["number"][0] > 0 or self._plant.node.requests
        is_ready = self._firmware.is_in_step and len(self._to_plant.pending) <= len(Held._fields)
        return min(until - tick, LONGEST_TICKS) if is_ready and not is_asked else 0

    def _native_node(self) -> NativeNode:
        """The firmware's present node, which a restart replaces."""
        node = self._firmware.node
        assert isinstance(node, NativeNode)
        return node

    def run(self, tick: int, ticks: int, operator_period: int) -> tuple[Records, int]:
        """Run `ticks` from `tick` on; return their records and the operator's next period."""
        period_s, buffers = self._scenario.period_s, self._buffers
        plant = self._plant.node
        plant.act()
        gait_frames = self._gait_frames(tick, ticks)
        commands, operator_period = self._commands(tick + ticks, operator_period)
        lent = plant.plant.lend()
        constants = Constants(
            period_s,
            self._period_ns,
            lent.readers,
            plant.plant.sampled,
            plant.drive_config,
            plant.report_periods,
            self._firmware_rows.itemsize,
        )
        frames, sent = np.zeros((MOST_FRAMES, 3), np.int64), np.zeros(7, np.int64)
        node = self._native_node()
        tick_address, done, config, state, _ = node.native
        firmware = Firmware(
            tick_address, done, config.ctypes.data, state.ctypes.data, frames, sent, state.view(np.uint8)
        )
        held = [word_frame(frame) for frame in self._to_plant.receive()]
        held += [NO_FRAME] * (len(Held._fields) - len(held))
        drive, reports, counter = plant.drive, plant.reports, plant.counter
        loop = Loop(tick, lent.t_s, lent.t_rest_s, 0.0, drive, reports, counter, Held(*held))
        buffers.used[:] = 0
        arguments = (
            lent.parts,
            lent.probe,
            lent.memory,
            constants,
            firmware,
            loop,
            gait_frames,
            commands,
            plant.sampled.rows(tick, ticks),
            lent.noise.take(ticks),
            buffers,
            NO_GRID,
        )
        self._run = self._run or entry_point(run, *arguments)
        with delayed_signals():
            loop, status = self._run(*arguments)
        if status == FIRMWARE_FAILED:
            raise FirmwareFailedError(
                f"a division by zero or a domain error in the compiled firmware's tick {loop.tick}"
            )
        node.ticked()
        plant.plant.take_back(loop.t_s, loop.t_rest_s, loop.torque_n_m, status)
        plant.resume(loop.tick, loop.drive, loop.reports, loop.counter)
        self._to_plant.pending += [byte_frame(frame) for frame in loop.held if frame.can_id != 0]
        last = [byte_frame(WordFrame(*frame)) for frame in frames.tolist() if frame[0] != 0]
        self._firmware.resume(tick + ticks - 1, last)
        _, impacts, log_bytes = buffers.used.tolist()
        records = Records(
            buffers.plant[:ticks],
            self._firmware_rows[:ticks].astype(self._columns, copy=False),
            buffers.impacts[:impacts],
            buffers.can_log[:log_bytes],
        )
        return records, operator_period

    def _gait_frames(self, tick: int, ticks: int) -> NDArray[np.int64]:
        """The gait sensors' frames in these ticks, rows of tick, identifier, length and word."""
        node = self._plant.node
        rows: list[tuple[int, int, int, int]] = []
        if node.plant.has_gait_sensors:
            frames = node.gait_frames(range(tick, tick + ticks))
            rows = [(number, *word_frame(frame)) for number, frame in frames]
        return np.array(rows, dtype=np.int64).reshape(-1, 4)

    def _commands(self, until_tick: int, period: int) -> tuple[NDArray[np.int64], int]:
        """The operator's frames before `until_tick`, rows as of the gait sensors, and its next period."""
        rows: list[tuple[int, int, int, int]] = []
        period_s = self._scenario.period_s
        while True:
            tick = math.ceil(period * OPERATOR_PERIOD_S / period_s - 1e-6)
            if tick >= until_tick:
                return np.array(rows, dtype=np.int64).reshape(-1, 4), period
            rows += [(tick, *word_frame(frame)) for frame in self._operator.frames(period)]
            period += 1


class RecordedStretches:
    """Stretches whose records are appended to the traces and the log of lockstep."""

    def __init__(self, scenario: Scenario, nodes: Nodes, turns: Sequence[Turns], can_log: CanLog) -> None:
        """`turns`: the nodes with a clock fault or a restart."""
        self._period_s = scenario.period_s
        self._plant = nodes.plant
        self._firmware = nodes.firmware
        self._turns = turns
        self._can_log = can_log
        self._plant_rows = np.zeros(LONGEST_TICKS, nodes.plant.columns)
        self._stretches = Stretches(scenario, nodes, nodes.firmware.columns, True)

    def ticks_from(self, tick: int) -> int:
        """Number of ticks from `tick` on that may be compiled."""
        if not all(turns.is_in_step(tick) for turns in self._turns):
            return 0
        return self._stretches.ticks_from(tick)

    def run(self, tick: int, ticks: int, operator_period: int) -> int:
        """Run `ticks` from `tick` on; return the operator's next period."""
        records, operator_period = self._stretches.run(tick, ticks, operator_period)
        rows, node = self._plant_rows[:ticks], self._plant.node
        for column, name in enumerate(PlantRecord._fields):
            rows[name] = records.plant[:, column]
        gaits = node.gaits_in(tick, ticks)
        if gaits is not None:
            for column, name in enumerate(GaitTruth._fields):
                rows[f"gait.{name}"] = gaits[:, column]
        self._plant.append(rows, records.impacts)
        numbers = np.arange(tick, tick + ticks)
        records.firmware["tick"], records.firmware["t_s"] = numbers, (numbers + 0.5) * self._period_s
        self._firmware.append(records.firmware)
        self._can_log.append(records.can_log.tobytes())
        for turns in self._turns:
            turns.resume(tick + ticks)
        return operator_period


def records_of(scenario: Scenario, seed: int, columns: Any, build: Build = "compiled") -> Iterator[Records]:
    """Yield the records of a whole compiled run without a folder, stretch by stretch.

    `columns`: the firmware's recorded columns. `build`: one of `firmware_py.shell.builds.NATIVE`. Raises
    ValueError for faults that act from tick to tick, which need lockstep's nodes.
    """
    if not has_stretches(scenario) or not all(isinstance(fault, STEADY) for fault in scenario.faults):
        kinds = ", ".join(fault.kind for fault in scenario.faults)
        raise ValueError(
            f"scenario {scenario.name!r} has a modelled bus, an encoder with a period of its own, or faults "
            f"that act from tick to tick ({kinds}); run it in lockstep"
        )
    bus = InProcessBus()
    to_plant = bus.join()
    pace = Pace(scenario.period_s, scenario.duration_s)
    plant = PlantRunner(scenario.scene, seed, pace, to_plant, None, scenario.faults)
    firmware = FirmwareRunner(
        scenario.parameters, pace, bus.join(), None, scenario.faults, seed, make=node_of(build)
    )
    operator = OperatorRunner(scenario.commands, pace, bus.join(listening=False), None)
    nodes = Nodes(plant, firmware, operator, to_plant)
    stretches = Stretches(scenario, nodes, columns, is_logged=False)
    tick = operator_period = 0
    while tick < scenario.ticks:
        ticks = stretches.ticks_from(tick)
        records, operator_period = stretches.run(tick, ticks, operator_period)
        yield records
        tick += ticks
