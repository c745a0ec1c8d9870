"""Stretches: sequences of lockstep ticks in one compiled call, with single ticks of lockstep in between.

A stretch ends a tick before a fault begins, because a fault may repeat what was before it, and the next one
starts when the fault has ended, holds no frame back and has left no node behind. Faults that only change the
module's parts or the drive's configuration begin and end between two stretches. There is no stretch while a
node's clock differs from the bench's, nor in runs with a modelled bus. Frames, traces and can.log equal those
of tick-by-tick lockstep.

`records_of` runs a whole scenario in stretches without a run folder, for campaigns.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.node.xcp import IS_CONNECTED
from firmware_py.shell.builds import Build
from firmware_py.shell.native import NativeNode
from hil.bench.lockstep import LockstepNodes, faults_by_node
from hil.bus.can_log import CanLog
from hil.faults.clocks import Turns
from hil.faults.fault import TIME_RESOLUTION_S, Fault
from hil.nodes.closed_loop import (
    LINE_BYTES,
    LOG_BYTES,
    MOST_RECEIVED,
    TICKS,
    TO_PLANT,
    Bench,
    Buffers,
    Firmware,
    run,
)
from hil.nodes.frame_rows import frames_in, word_frame
from hil.nodes.own_controller import runner_of
from hil.nodes.plant_steps import PlantState
from hil.record.traces.firmware_trace import columns_in, moves_to
from hil.record.traces.plant_trace import PlantRecord
from hil.scenario.scenario import Scenario
from hil.timing.clock import NS_PER_S
from hil.timing.signals import delayed_signals
from plant_sim.kernels import entry_point
from plant_sim.result import Impact
from plant_sim.sensors.gait import GaitTruth

LONGEST_TICKS = 4096
"""Longest stretch in ticks; the size of the buffers."""
LINES_A_TICK = 8
MOST_SENT = 3
"""Most frames that the firmware sends in a tick."""


def quiet_until_s(faults: Sequence[Fault], t_s: float, period_s: float) -> float:
    """The end of the interval from `t_s` on in which no fault changes or acts; `t_s` if there is none."""
    until_s = math.inf
    for fault in faults:
        if fault.is_steady:
            edges_s = [edge_s for edge_s in (fault.at_s, fault.end_s) if edge_s > t_s + TIME_RESOLUTION_S]
            until_s = min([until_s, *edges_s])
        elif t_s < fault.at_s - period_s:
            until_s = min(until_s, fault.at_s - period_s)
        elif t_s < fault.end_s:
            return t_s
    return until_s


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


class Stretches:
    """Runs stretches of one scenario on the nodes of lockstep."""

    def __init__(self, scenario: Scenario, nodes: LockstepNodes, columns: Any, is_logged: bool) -> None:
        """`columns`: packed type of the firmware's recorded columns (`hil.record.traces.firmware_trace`)."""
        self._scenario = scenario
        self._plant, self._firmware, self._operator = nodes.plant, nodes.firmware, nodes.operator
        self._to_plant, self._to_operator = nodes.to_plant, nodes.to_operator
        self._lines = nodes.lines.values()
        self._period_ns = round(scenario.period_s * NS_PER_S)
        self._run: Callable[..., tuple[PlantState, int]] | None = None
        self._columns, precision = columns, self._native_node().native.precision
        self._firmware_rows = np.zeros(LONGEST_TICKS, columns_in(columns, precision))
        self._buffers = Buffers(
            plant=np.zeros((LONGEST_TICKS, len(PlantRecord._fields))),
            firmware=self._firmware_rows.view(np.uint8),
            moves=moves_to(self._firmware_rows.dtype, precision),
            can_log=np.zeros(LONGEST_TICKS * LINES_A_TICK * LINE_BYTES if is_logged else 0, np.uint8),
            used=np.zeros(4, np.int64),
        )

    def ticks_from(self, tick: int) -> int:
        """Number of ticks from `tick` on that may be compiled; one while the operator waits for an answer."""
        scenario = self._scenario
        quiet_s = quiet_until_s(scenario.faults, tick * scenario.period_s, scenario.period_s)
        until = scenario.ticks
        if quiet_s < math.inf:
            until = min(until, math.floor((quiet_s + TIME_RESOLUTION_S) / scenario.period_s))
        listening_tick = self._operator.node.listening_tick
        if listening_tick is not None:
            until = min(until, max(listening_tick, tick + 1))
        is_asked = self._native_node().whole["pool"][0, IS_CONNECTED] or self._plant.node.has_waiting_fault
        is_behind = self._plant.node.tick != tick or self._firmware.last_tick != tick - 1
        if is_asked or is_behind or any(line.held_frames for line in self._lines):
            return 0
        return min(until - tick, LONGEST_TICKS)

    def _native_node(self) -> NativeNode:
        """The firmware's present node, which a restart replaces."""
        node = self._firmware.node
        assert isinstance(node, NativeNode)
        return node

    def run(self, tick: int, ticks: int) -> None:
        """Run `ticks` from `tick` on; `records` then has their records."""
        plant, node, buffers = self._plant.node, self._native_node(), self._buffers
        buffers.used[:] = 0
        plant.act(ticks)
        frames, sent = np.zeros((MOST_RECEIVED, 3), np.int64), np.zeros(1 + 3 * MOST_SENT, np.int64)
        receive_address, tick_address, config, memory, _ = node.native
        firmware = Firmware(
            receive=receive_address,
            tick=tick_address,
            config=config.ctypes.data,
            state=memory.ctypes.data,
            frames=frames,
            sent=sent,
            state_bytes=memory.view(np.uint8),
            record_bytes=self._firmware_rows.itemsize,
        )
        held = self._to_plant.receive()
        buffers.used[TO_PLANT] = len(held)
        in_transit = np.zeros((max(len(held), 1 + MOST_SENT), 3), np.int64)  # a command, and the firmware's
        for place, frame in enumerate(held):
            in_transit[place] = word_frame(frame)
        bench = Bench(
            period_s=self._scenario.period_s,
            period_ns=self._period_ns,
            module=plant.plant.module,
            readers=plant.plant.readers,
            setup=plant.setup,
            due=plant.due(ticks),
            noise=plant.plant.noise.take(ticks),
            commands=self._commands(tick + ticks),
            to_plant=in_transit,
            firmware=firmware,
            buffers=buffers,
        )
        self._run = self._run or entry_point(run, bench, plant.state, ticks)
        state, status = self._run(bench, plant.state, ticks)
        node.pull_state()
        self._firmware.last_tick = state.tick - 1
        plant.resume(state, status)
        self._to_plant.pending += frames_in(in_transit[: buffers.used[TO_PLANT]])
        self._to_operator.pending += frames_in(sent[1:].reshape(-1, 3)[: sent[0]])

    def records(self) -> Records:
        """Take the records of the last stretch; those before the tick of a failure, if it has failed."""
        buffers, ticks = self._buffers, self._buffers.used[TICKS]
        return Records(
            buffers.plant[:ticks],
            self._firmware_rows[:ticks].astype(self._columns, copy=False),
            self._plant.node.plant.take_impact_rows(),
            buffers.can_log[: buffers.used[LOG_BYTES]],
        )

    def _commands(self, until_tick: int) -> NDArray[np.int64]:
        """The operator's frames before `until_tick`, rows as of the gait sensors."""
        rows: list[tuple[int, int, int, int]] = []
        while (tick := self._operator.due_tick) < until_tick:
            self._operator.bus.move_to(tick * self._scenario.period_s)
            rows += [(tick, *word_frame(frame)) for frame in self._operator.frames(tick)]
        return np.array(rows, dtype=np.int64).reshape(-1, 4)


class RecordedStretches(Stretches):
    """Stretches whose records are appended to the traces and the log of lockstep."""

    def __init__(
        self, scenario: Scenario, nodes: LockstepNodes, turns: Sequence[Turns], can_log: CanLog
    ) -> None:
        """`turns`: the nodes with a clock fault or a restart."""
        assert nodes.plant.trace is not None
        assert nodes.firmware.trace is not None
        self._plant_trace, self._firmware_trace = nodes.plant.trace, nodes.firmware.trace.writer
        super().__init__(scenario, nodes, self._firmware_trace.dtype, is_logged=True)
        self._turns = turns
        self._can_log = can_log
        self._plant_rows = np.zeros(LONGEST_TICKS, self._plant_trace.dtype)

    def ticks_from(self, tick: int) -> int:
        """Number of ticks from `tick` on that may be compiled."""
        return super().ticks_from(tick) if all(turns.is_in_step(tick) for turns in self._turns) else 0

    def record(self, tick: int, ticks: int) -> None:
        """Run `ticks` from `tick` on, and append their records, also those before a failure."""
        try:
            self.run(tick, ticks)
        finally:
            self._append(tick, self.records())
        for turns in self._turns:
            turns.resume(tick + ticks)

    def _append(self, tick: int, records: Records) -> None:
        """Append the records of a stretch that began in `tick`."""
        ticks = len(records.plant)
        rows, node = self._plant_rows[:ticks], self._plant.node
        for column, name in enumerate(PlantRecord._fields):
            rows[name] = records.plant[:, column]
        gaits = node.gaits_in(tick, ticks)
        if gaits is not None:
            for column, name in enumerate(GaitTruth._fields):
                rows[f"gait.{name}"] = gaits[:, column]
        self._plant_trace.append_all(rows)
        impacts = map(Impact._make, records.impacts.tolist())
        self._plant.record_impacts(one._replace(t_s=node.began_s + one.t_s) for one in impacts)
        numbers = np.arange(tick, tick + ticks)
        records.firmware["tick"], records.firmware["t_s"] = numbers, (numbers + 0.5) * self._scenario.period_s
        self._firmware_trace.append_all(records.firmware)
        self._can_log.append(records.can_log.tobytes())


def records_of(scenario: Scenario, seed: int, columns: Any, build: Build = "compiled") -> Iterator[Records]:
    """Yield the records of a whole compiled run without a folder, stretch by stretch.

    `columns`: the firmware's recorded columns. `build`: one of `firmware_py.shell.builds.NATIVE`. Raises
    ValueError for faults that act from tick to tick, which need lockstep's nodes.
    """
    if scenario.bitrate is not None or not all(fault.is_steady for fault in scenario.faults):
        kinds = ", ".join(fault.kind for fault in scenario.faults)
        raise ValueError(
            f"scenario {scenario.name!r} has a modelled bus, or faults that act from tick to tick "
            f"({kinds}); run it in lockstep"
        )
    with ExitStack() as stack:
        nodes = LockstepNodes(scenario, None, seed, faults_by_node(scenario), runner_of(build), stack)
        stretches = Stretches(scenario, nodes, columns, is_logged=False)
        tick = 0
        while tick < scenario.ticks:
            ticks = stretches.ticks_from(tick)
            if ticks == 0:
                raise ValueError(
                    f"scenario {scenario.name!r} has a fault that acts within tick {tick}; run it in "
                    "lockstep, or let the fault begin and end with a tick"
                )
            with delayed_signals():
                stretches.run(tick, ticks)
            yield stretches.records()
            tick += ticks
