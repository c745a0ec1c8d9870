"""Stretches: sequences of lockstep ticks in one compiled call, with single ticks of lockstep in between.

A stretch of all nodes ends a tick before a fault begins, because a fault may repeat what was before it, and
the next one starts when the fault has ended, holds no frame back and has left no node behind. Faults that
only change the module's parts or the drive's configuration begin and end between two stretches. There is no
such stretch while a node's clock differs from the bench's, with a modelled bus, or with a firmware that is
not compiled. There the plant alone may be compiled: Python runs the other nodes and the bus in each tick.
Frames and records equal those of tick-by-tick lockstep, and are kept in the same memory.
"""

import ctypes
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface.frame import Frame
from firmware_py.node.xcp import IS_CONNECTED
from firmware_py.shell.builds import NATIVE
from firmware_py.shell.native import NativeNode
from hil.faults.processes import Turns
from hil.faults.fault import TIME_RESOLUTION_S, Fault
from hil.faults.on_bus import LineFault, ModelledFault
from hil.faults.on_process import HostFault
from hil.nodes.closed_loop import (
    EXCHANGE_FAILED,
    FRAMES,
    MOST_RECEIVED,
    STOP,
    TICKS,
    TO_PLANT,
    Bench,
    Buffers,
    Firmware,
    run,
)
from hil.nodes.frame_rows import frames_in, word_frame
from hil.nodes.plant_steps import PlantState
from hil.record.traces.firmware_trace import columns_in, moves_to
from hil.record.traces.own_trace import is_build
from hil.record.traces.plant_trace import PlantRecord
from hil.roster import OPERATOR, PLANT, ROSTER
from hil.runs.job import Job
from hil.runs.lockstep import Lockstep
from hil.bus.in_process import IdealBus
from hil.runs.rows import FRAME_COLUMNS
from hil.timing.clock import NS_PER_S
from hil.timing.loop import UNTIMED, LoopTiming
from plant_sim.kernels import entry_point
from plant_sim.sensors.gait import GaitTruth

FRAMES_A_TICK = 8
"""Most frames on the bus in a tick of a stretch of all nodes."""
MOST_SENT = 3
"""Most frames that the firmware sends in a tick."""
MOST_ARRIVED = 32
"""Most frames that the plant obeys at a time."""
UNTIL_IN_STEP_TICKS = 20
"""Length of a stretch of the plant while frames are held back, or a node is behind, after a fault."""
EXCHANGE = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)
NO_FIRMWARE = Firmware(
    receive=0,
    tick=0,
    config=0,
    state=0,
    frames=np.zeros((0, 3), np.int64),
    sent=np.zeros(1, np.int64),
    state_bytes=np.zeros(0, np.uint8),
    record_bytes=0,
)


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


def acts_in_plant(fault: Fault) -> bool:
    """Whether a fault acts in the plant's node, or sends it frames, which may be requests that it answers."""
    if isinstance(fault, LineFault):
        return type(fault).foreign_frames is not LineFault.foreign_frames
    return not isinstance(fault, ModelledFault) and not (
        isinstance(fault, HostFault) and fault.acts_in != PLANT
    )


class Exchange:
    """What compiled code calls between sending and receiving of the plant, in its stretches alone.

    The other nodes' turns in a tick follow before the plant sends in the next one.
    """

    def __init__(self, nodes: Lockstep, tick: int, used: NDArray[np.int64]) -> None:
        self.published = np.zeros((MOST_RECEIVED, 3), np.int64)
        self.arrived = np.zeros((MOST_ARRIVED, 3), np.int64)
        self.error: BaseException | None = None
        self._nodes, self._used = nodes, used
        self._first = self._next = tick
        self._waiting: list[Frame] = []

    def __call__(self, published: int) -> int:
        """Send the first `published` frames, none if < 0; return the number that arrived, -1 on error."""
        try:
            if published >= 0:
                if self._next > self._first:
                    self._nodes.tick_after_first(self._next - 1)
                node, line = self._nodes.plant.node, self._nodes.lines[PLANT]
                line.move_to(self._next * node.period_s)
                line.send_all(frames_in(self.published[:published]))
                self._waiting = line.receive()
                self._used[STOP] = node.note_requests(self._waiting)
                self._next += 1
            now, self._waiting = self._waiting[:MOST_ARRIVED], self._waiting[MOST_ARRIVED:]
            if now:
                self.arrived[: len(now)] = [word_frame(frame) for frame in now]
            return len(now)
        except BaseException as error:  # an exception cannot pass through compiled code
            self.error = error
            return -1


class Stretches:
    """Runs stretches of a job on the nodes of lockstep."""

    def __init__(self, job: Job, nodes: Lockstep) -> None:
        self._scenario, self._nodes, self._firmware_name = job.scenario, nodes, job.firmware
        self._plant, self._firmware, self._operator = nodes.plant, nodes.firmware, nodes.operator
        self._in_plant = [fault for fault in job.scenario.faults if acts_in_plant(fault)]
        self._turns = {name: node for name, node in nodes.turns.items() if isinstance(node, Turns)}
        self._period_ns = round(job.scenario.period_s * NS_PER_S)
        self._run: Callable[..., tuple[PlantState, int]] | None = None
        all_compiled = all(node.has_compiled_turn for node in ROSTER) and job.firmware in NATIVE
        self._is_closed = all_compiled and isinstance(nodes.bus, IdealBus)
        """Whether all nodes have compiled turns, on a bus that needs no work."""
        self._columns, self._moves = np.dtype([]), np.zeros((0, 3), np.int64)
        if self._is_closed and "firmware" in nodes.rows:
            precision = self._native_node().native.precision
            self._columns = columns_in(nodes.rows["firmware"].dtype, precision)
            """The firmware's records in the precision of its build."""
            self._moves = moves_to(self._columns, precision)

    def advance(self, tick: int, most: int) -> int:
        """Run a stretch from `tick` on, of at most `most` ticks; return its length, 0 if none may be."""
        if (ticks := min(self.closed_ticks_from(tick), most)) > 0:
            return self.run(tick, ticks)
        if (ticks := min(self.plant_ticks_from(tick), most)) > 0:
            return self.run_plant(tick, ticks)
        return 0

    def closed_ticks_from(self, tick: int) -> int:
        """Number of ticks of all nodes from `tick` on; one while the operator waits for an answer."""
        if not self._is_closed or not all(turns.is_in_step(tick) for turns in self._turns.values()):
            return 0
        until = self._quiet_until(self._scenario.faults, tick)
        listening_tick = self._operator.node.listening_tick
        if listening_tick is not None:
            until = min(until, max(listening_tick, tick + 1))
        is_asked = self._native_node().whole["pool"][0, IS_CONNECTED] or self._plant.node.has_waiting_fault
        is_behind = self._plant.node.tick != tick or self._firmware.last_tick != tick - 1
        if is_asked or is_behind or any(line.held_frames for line in self._nodes.lines.values()):
            return 0
        return until - tick

    def plant_ticks_from(self, tick: int) -> int:
        """Number of ticks of the plant from `tick` on, until all nodes may be compiled."""
        node, turns = self._plant.node, self._turns.get(PLANT)
        if ROSTER[0].name != PLANT or node.tick != tick or node.has_waiting_fault or node.note_requests(()):
            return 0
        if turns is not None and not turns.is_in_step(tick):
            return 0
        has_due_frames = node.plant.has_gait_sensors or node.plant.sampled
        if has_due_frames and not is_build(str(self._firmware_name)):
            return 0  # a user's controller may send requests, which end a stretch before its frames are due
        until = self._quiet_until(self._in_plant, tick)
        if self._is_closed:
            t_s = tick * self._scenario.period_s
            ends_s = [fault.end_s for fault in self._scenario.faults if fault.acts(t_s)]
            in_step = tick + UNTIL_IN_STEP_TICKS
            if ends_s and not all(math.isinf(end_s) for end_s in ends_s):
                in_step = max(tick + 1, math.ceil(min(ends_s) / self._scenario.period_s))
            until = min(until, until if ends_s and math.isinf(min(ends_s)) else in_step)
        return until - tick

    def _quiet_until(self, faults: Sequence[Fault], tick: int) -> int:
        """The tick until which none of these faults changes or acts."""
        scenario = self._scenario
        quiet_s = quiet_until_s(faults, tick * scenario.period_s, scenario.period_s)
        if math.isinf(quiet_s):
            return scenario.ticks
        return min(scenario.ticks, math.floor((quiet_s + TIME_RESOLUTION_S) / scenario.period_s))

    def _native_node(self) -> NativeNode:
        """The firmware's present node, which a restart replaces."""
        node = self._firmware.node
        assert isinstance(node, NativeNode)
        return node

    def run(self, tick: int, ticks: int) -> int:
        """Run `ticks` of all nodes, and keep their records and frames, or those before a failure."""
        node, nodes = self._native_node(), self._nodes
        received, sent = np.zeros((MOST_RECEIVED, 3), np.int64), np.zeros(1 + 3 * MOST_SENT, np.int64)
        receive_address, tick_address, config, memory, _ = node.native
        firmware = Firmware(
            receive=receive_address,
            tick=tick_address,
            config=config.ctypes.data,
            state=memory.ctypes.data,
            frames=received,
            sent=sent,
            state_bytes=memory.view(np.uint8),
            record_bytes=self._columns.itemsize,
        )
        held = nodes.joined[PLANT].receive()
        in_transit = np.zeros((max(len(held), 1 + MOST_SENT), 3), np.int64)  # a command, and the firmware's
        for place, frame in enumerate(held):
            in_transit[place] = word_frame(frame)
        own = self._firmware_memory(ticks)
        frames = nodes.frames.room(ticks * FRAMES_A_TICK)
        buffers = self._buffers(ticks, own, frames)
        buffers.used[TO_PLANT] = len(held)
        self._plant.node.act(ticks)
        bench = self._bench(ticks, self._commands(tick + ticks), in_transit, firmware, buffers)
        state, status = self._call(bench, ticks)
        self._keep_plant(tick, buffers)
        self._keep_firmware(tick, int(buffers.used[TICKS]), own)
        nodes.frames.count += int(buffers.used[FRAMES])
        node.pull_state()
        self._firmware.last_tick = state.tick - 1
        self._plant.node.resume(state, status)
        nodes.joined[PLANT].pending += frames_in(in_transit[: buffers.used[TO_PLANT]])
        nodes.joined[OPERATOR].pending += frames_in(sent[1:].reshape(-1, 3)[: sent[0]])
        for turns in self._turns.values():
            turns.resume(tick + ticks)
        return ticks

    def run_plant(self, tick: int, ticks: int) -> int:
        """Run at most `ticks` of the plant, and of the other nodes in Python; return their number.

        A request of a user's controller ends it early; the sensors' noise of the other ticks is then skipped.
        """
        nothing = np.zeros((0, FRAME_COLUMNS), np.int64)
        buffers = self._buffers(ticks, np.zeros(0, self._columns), nothing)
        exchange = Exchange(self._nodes, tick, buffers.used)
        firmware = NO_FIRMWARE._replace(frames=exchange.published)
        self._plant.node.act(ticks)
        bench = self._bench(ticks, np.zeros((0, 4), np.int64), exchange.arrived, firmware, buffers)
        called = EXCHANGE(exchange)  # compiled code calls it as long as it has a name here
        address = ctypes.cast(called, ctypes.c_void_p).value or 0
        state, status = self._call(bench._replace(exchange=address), ticks)
        self._keep_plant(tick, buffers)
        if status == EXCHANGE_FAILED and exchange.error is not None:
            raise exchange.error
        self._plant.node.resume(state, status)
        if PLANT in self._turns:
            self._turns[PLANT].resume(state.tick)
        self._nodes.tick_after_first(state.tick - 1)
        return state.tick - tick

    def _buffers(self, ticks: int, firmware: NDArray[np.void], frames: NDArray[np.int64]) -> Buffers:
        numbers = self._plant_memory(ticks)
        return Buffers(
            plant=numbers,
            plant_whole=numbers.view(np.int64),
            firmware=firmware.view(np.uint8) if firmware.dtype.itemsize else np.zeros(0, np.uint8),
            moves=self._moves,
            frames=frames,
            used=np.zeros(5, np.int64),
        )

    def _bench(
        self,
        ticks: int,
        commands: NDArray[np.int64],
        to_plant: NDArray[np.int64],
        firmware: Firmware,
        buffers: Buffers,
    ) -> Bench:
        node = self._plant.node
        return Bench(
            period_s=self._scenario.period_s,
            period_ns=self._period_ns,
            module=node.plant.module,
            readers=node.plant.readers,
            setup=node.setup,
            due=node.due(ticks),
            noise=node.plant.noise.take(ticks),
            commands=commands,
            to_plant=to_plant,
            firmware=firmware,
            buffers=buffers,
            exchange=0,
        )

    def _call(self, bench: Bench, ticks: int) -> tuple[PlantState, int]:
        state = self._plant.node.state
        self._run = self._run or entry_point(run, bench, state, ticks)
        return self._run(bench, state, ticks)

    def _plant_memory(self, ticks: int) -> NDArray[np.float64]:
        """Memory for the plant's records, beside its rows if these have columns of other lengths."""
        rows = self._nodes.rows.get("plant")
        if rows is None or not is_whole(rows.dtype):
            return np.zeros((ticks, len(PlantRecord._fields)))
        return rows.room(ticks).view(np.float64).reshape(ticks, -1)

    def _firmware_memory(self, ticks: int) -> NDArray[np.void]:
        """Memory for the firmware's records, beside its rows if its build is of single precision."""
        rows = self._nodes.rows.get("firmware")
        if rows is not None and self._columns == rows.dtype:
            return rows.room(ticks)
        return np.zeros(ticks, self._columns)

    def _keep_plant(self, tick: int, buffers: Buffers) -> None:
        """Complete the plant's records of a call that began in `tick`, and keep them."""
        ticks, rows, node = int(buffers.used[TICKS]), self._nodes.rows, self._plant.node
        impacts = node.plant.take_impact_rows()
        if len(impacts) and "impacts" in rows:
            impacts["t_s"] += node.began_s
            rows["impacts"].append_all(impacts)
        if "plant" not in rows:
            return
        truth = rows["plant"].room(ticks)
        names = truth.dtype.names or ()
        if not np.may_share_memory(buffers.plant, truth):
            for column, name in enumerate(PlantRecord._fields):
                if name in names:
                    source = buffers.plant_whole if truth.dtype[name] == np.int64 else buffers.plant
                    truth[name] = source[:ticks, column]
        gaits = node.gaits_in(tick, ticks) if any(name.startswith("gait.") for name in names) else None
        if gaits is not None:
            for column, name in enumerate(GaitTruth._fields):
                truth[f"gait.{name}"] = gaits[:, column]
        leave_untimed(truth)
        rows["plant"].count += ticks

    def _keep_firmware(self, tick: int, ticks: int, records: NDArray[np.void]) -> None:
        """Complete the firmware's records of a call that began in `tick`, and keep them."""
        rows = self._nodes.rows.get("firmware")
        if rows is None:
            return
        own = rows.room(ticks)
        if not np.may_share_memory(records, own):
            for name in self._columns.names or ():
                own[name] = records[name][:ticks]
        numbers = np.arange(tick, tick + ticks)
        own["tick"], own["t_s"] = numbers, (numbers + 0.5) * self._scenario.period_s
        leave_untimed(own)
        rows.count += ticks

    def _commands(self, until_tick: int) -> NDArray[np.int64]:
        """The operator's frames before `until_tick`, rows as of the gait sensors."""
        rows: list[tuple[int, int, int, int]] = []
        while (tick := self._operator.due_tick) < until_tick:
            self._operator.bus.move_to(tick * self._scenario.period_s)
            rows += [(tick, *word_frame(frame)) for frame in self._operator.frames(tick)]
        return np.array(rows, dtype=np.int64).reshape(-1, 4)


def is_whole(columns: "np.dtype[np.void]") -> bool:
    """Whether records of the plant begin with all columns of `PlantRecord`, and all have eight bytes."""
    names = columns.names or ()
    return names[: len(PlantRecord._fields)] == PlantRecord._fields and columns.itemsize == 8 * len(names)


def leave_untimed(records: NDArray[np.void]) -> None:
    """Ticks in compiled code are not timed."""
    for name in set(LoopTiming._fields) & set(records.dtype.names or ()):
        records[name] = getattr(UNTIMED, name)
