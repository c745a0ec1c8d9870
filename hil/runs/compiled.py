"""Stretches: sequences of lockstep ticks in one compiled call, with single ticks of lockstep in between.

A stretch of all nodes ends a tick before a fault begins, because a fault may repeat what was before it, and
the next one starts when the fault has ended and has left no node behind. Faults that only change the module's
parts or the drive's configuration, act on frames that they name, or stall the firmware or its clock, begin
and end between two stretches; where such frames leave their node, the stretch calls the node's `FaultyBus`.
On a modelled bus they run while it is at rest, which it is not as long as a node counts errors, and no fault
acts on frames: those of half a period then arrive within it in order of priority, and Python runs the bus in
the ticks in which they do not.
There is no such stretch while the plant's clock differs from the bench's, or with a firmware that is not
compiled. There the plant alone may be compiled: Python runs the other nodes and the bus in each tick. Frames
and records equal those of tick-by-tick lockstep, and are kept in the same memory.
"""

import ctypes
import math
import mmap
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface.frame import worst_case_bits
from firmware_py.node.xcp import IS_CONNECTED
from firmware_py.shell.builds import NATIVE, is_build
from firmware_py.shell.native import NativeNode
from hil.bus.frame_rows import frames_in, put_frames
from hil.faults.fault import Fault
from hil.faults.line import MOST_HELD_FRAMES, FaultyBus
from hil.faults.on_bus import FramesFault, LineFault
from hil.faults.processes import Turns
from hil.nodes import closed_loop
from hil.nodes.closed_loop import (
    AT_ONCE,
    FRAMES,
    HELD,
    NO_FIRMWARE,
    NUMBER_BYTES,
    OPERATOR_TICK,
    STOP,
    TICKS,
    TO_OPERATOR,
    TO_PLANT,
    TURNS,
    USED,
    Bench,
    Buffers,
    Firmware,
    run,
)
from hil.nodes.operator.node import RECEIVED_IDS
from hil.nodes.plant.node import requests_in
from hil.nodes.plant.steps import PlantState
from hil.record.traces.firmware_trace import columns_in, moves_to
from hil.record.traces.plant_trace import PlantRecord
from hil.roster import FIRMWARE, OPERATOR, PLANT, ROSTER, instants
from hil.runs.fault_times import (
    acts_in_plant,
    acts_in_ticks,
    delays_firmware,
    most_copies,
    quiet_until,
    unplugs_firmware,
)
from hil.runs.job import Job
from hil.runs.lockstep import Lockstep
from hil.runs.modelled_bus import Transit, pass_half
from hil.runs.rows import FRAME_COLUMNS, is_whole, leave_untimed
from hil.timing.clock import NS_PER_S
from plant_sim.kernels import FROM_COMPILED, PythonCall, entry_point
from plant_sim.sensors.gait import GaitTruth

FRAMES_A_TICK = 8
"""Most frames on the bus in a tick of a stretch of all nodes, without those that faults hold back or copy."""
MOST_SENT = 3
"""Most frames that the firmware sends in a tick."""
MOST_IN_TRANSIT = 3 * MOST_HELD_FRAMES
"""Most frames on the way to a node, after faults."""
MOST_COPIES = 100
"""Most frames for one in a stretch; memory is kept for as many. With more the run goes on tick by tick."""
IDENTIFIERS = 0x800
UNTIL_IN_STEP_TICKS = 20
"""Length of a stretch of the plant while a node is behind, after a fault."""
_Kind = TypeVar("_Kind", bound=Fault)
NODES = {closed_loop.PLANT: PLANT, closed_loop.OPERATOR: OPERATOR, closed_loop.FIRMWARE: FIRMWARE}


class RunEnd(NamedTuple):
    """Where compiled code has ended: the plant's state, the solver's status, and what Python has raised."""

    state: PlantState
    status: int
    error: BaseException | None


class Stretches:
    """Runs stretches of a job on the nodes of lockstep."""

    def __init__(self, job: Job, nodes: Lockstep) -> None:
        self._scenario, self._nodes, self._firmware_name = job.scenario, nodes, job.firmware
        self._plant, self._firmware, self._operator = nodes.plant, nodes.firmware, nodes.operator
        self._in_plant = [fault for fault in job.scenario.faults if acts_in_plant(fault)]
        self._delays = [fault for fault in job.scenario.faults if delays_firmware(fault)]
        self._unplugs = [fault for fault in job.scenario.faults if unplugs_firmware(fault)]
        self._turns = {name: node for name, node in nodes.turns.items() if isinstance(node, Turns)}
        self._period_ns = round(job.scenario.period_s * NS_PER_S)
        self._run: Callable[..., tuple[PlantState, int]] | None = None
        all_compiled = all(node.has_compiled_turn for node in ROSTER) and job.firmware in NATIVE
        most_bits = 2 * (MOST_SENT * worst_case_bits(8) + 1)  # frames begin at whole bits
        self._is_closed = all_compiled and most_bits * nodes.bus.bit_ns <= self._period_ns
        """Whether all nodes have compiled turns, and the bus has time for what the firmware sends."""
        # Small pages, because numpy would ask for huge ones: memory that is not used then costs nothing.
        in_transit = np.frombuffer(mmap.mmap(-1, 3 * MOST_IN_TRANSIT * 3 * NUMBER_BYTES), np.int64)
        self._to_firmware, self._to_plant, self._to_operator = in_transit.reshape(3, MOST_IN_TRANSIT, 3)
        self._named = np.zeros(IDENTIFIERS, np.uint8)
        transit = Transit(self._to_firmware, self._to_plant, self._to_operator)
        self._edges_ns = 0, instants(self._period_ns)[-1].begin_ns, self._period_ns
        """Beginning, middle and end of a tick: the firmware's turn is in the middle."""
        self._pass_bus = partial(pass_half, nodes.bus, nodes.joined, transit, self._edges_ns)
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
        """Number of ticks of all nodes from `tick` on."""
        turns = self._turns.get(FIRMWARE)
        in_step = all(one.is_in_step(tick) for name, one in self._turns.items() if name != FIRMWARE)
        if not self._is_closed or not in_step or (turns is not None and turns.restarts_in(tick)):
            return 0
        until, t_s = self._quiet_until(self._scenario.faults, tick), tick * self._scenario.period_s
        bus = self._nodes.bus
        if not bus.is_at_rest or (bus.bit_ns and not self._is_undisturbed(tick)):
            return 0
        if not self._is_regular(tick):
            if any(t_s < one.end_s for one in self._unplugs):
                return 0  # frames that the firmware has not taken may be lost yet
            if not any(one.acts(t_s) for one in self._delays):
                until = min(until, tick + UNTIL_IN_STEP_TICKS)
        is_ready = self._plant.node.tick == tick and not self._plant.node.has_waiting_fault
        is_flooded = most_copies(self._acting(FramesFault, tick)) > MOST_COPIES
        return until - tick if is_ready and not is_flooded and not self._is_asked() else 0

    def _is_asked(self) -> bool:
        """Whether a client is connected to the firmware, or has sent the plant a request."""
        is_connected = bool(self._native_node().whole["pool"][0, IS_CONNECTED])
        waiting = self._nodes.joined[PLANT].pending
        return is_connected or self._plant.node.note_requests(()) or bool(requests_in(waiting))

    def _is_regular(self, tick: int) -> bool:
        """Whether the firmware has one turn in each tick from this one on, until a fault begins."""
        turns, t_s = self._turns.get(FIRMWARE), tick * self._scenario.period_s
        is_behind = self._firmware.last_tick != tick - 1 or (turns is not None and not turns.is_in_step(tick))
        return not is_behind and not any(one.acts(t_s) for one in self._delays)

    def _is_undisturbed(self, tick: int) -> bool:
        """Whether no fault acts on frames or on the firmware's turns in a tick, or holds frames back."""
        holds = any(line.held_frames for line in self._nodes.lines.values())
        return self._is_regular(tick) and not holds and not self._acting(LineFault, tick)

    def _firmware_turns(self, tick: int, ticks: int) -> NDArray[np.int64]:
        """The firmware's turns: rows of the bench's tick and of its own."""
        if self._is_regular(tick):
            regular: NDArray[np.int64] = np.arange(tick, tick + ticks)
            return np.column_stack([regular, regular])
        slots = range(tick, tick + ticks)
        turns = [(slot, own) for slot in slots for own in self._nodes.ticks_in(FIRMWARE, slot)]
        return np.array(turns, np.int64).reshape(-1, 2)

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
            acting = [fault for fault in self._scenario.faults if fault.acts(t_s)]
            is_ideal = not self._nodes.bus.bit_ns
            lasting = [one.is_steady or (acts_in_ticks(one) and is_ideal) for one in acting]
            ends_s = [one.end_s for one, lasts in zip(acting, lasting, strict=True) if not lasts]
            in_step = tick + UNTIL_IN_STEP_TICKS
            if ends_s and not all(math.isinf(end_s) for end_s in ends_s):
                in_step = max(tick + 1, math.ceil(min(ends_s) / self._scenario.period_s))
            until = min(until, until if ends_s and math.isinf(min(ends_s)) else in_step)
        return until - tick

    def _quiet_until(self, faults: Sequence[Fault], tick: int) -> int:
        """The tick until which none of these faults changes or acts."""
        return int(min(self._scenario.ticks, quiet_until(faults, tick, self._scenario.period_s)))

    def _native_node(self) -> NativeNode:
        """The firmware's present node, which a restart replaces."""
        node = self._firmware.node
        assert isinstance(node, NativeNode)
        return node

    def run(self, tick: int, ticks: int) -> int:
        """Run `ticks` of all nodes, and keep their records and frames, or those before a failure."""
        node, nodes = self._native_node(), self._nodes
        receive, advance, tick_address, config, memory, _ = node.native
        is_regular, turns = self._is_regular(tick), self._firmware_turns(tick, ticks)
        own_ticks, elapsed_ticks = turns[:, 1], np.diff(turns[:, 1], prepend=self._firmware.last_tick)
        firmware = Firmware(
            receive=receive,
            advance=advance,
            tick=tick_address,
            turns=np.column_stack([turns[:, 0] - tick, elapsed_ticks]),
            config=config.ctypes.data,
            state=memory.ctypes.data,
            sent=np.zeros(1 + 3 * MOST_SENT, np.int64),
            state_bytes=memory.view(np.uint8),
            record_bytes=self._columns.itemsize,
        )
        own = self._firmware_memory(len(turns))
        held = {which: nodes.lines[name].held_frames for which, name in NODES.items()}
        most = max(ticks, int(np.sum(np.minimum(elapsed_ticks, node.config.catch_up_ticks)))) * FRAMES_A_TICK
        frames = nodes.frames.room((most + sum(held.values())) * self._name_frames(tick))
        buffers = self._buffers(ticks, own, frames)
        used = buffers.used
        used[TO_PLANT] = put_frames(self._to_plant, 0, nodes.joined[PLANT].receive())
        node.receive(nodes.joined[FIRMWARE].receive())  # a delayed firmware has not taken them yet
        waiting = [one for one in nodes.joined[OPERATOR].receive() if one.can_id in RECEIVED_IDS]
        used[TO_OPERATOR] = put_frames(self._to_operator, 0, waiting)
        used[OPERATOR_TICK] = self._operator.due_tick
        for which, count in held.items():
            used[HELD + which] = count
        lines = self._begin_lines(tick)

        def leave(which: int, first: int, end: int) -> int:
            now, rows = tick + int(used[TICKS]), self._to_firmware
            if which not in NODES:
                return self._pass_bus(which, end, now, buffers)
            line = nodes.lines[NODES[which]]
            if which == closed_loop.OPERATOR:
                line.move_to(now * self._scenario.period_s)
                nodes.joined[OPERATOR].pending += frames_in(self._to_operator[: used[TO_OPERATOR]])
                used[TO_OPERATOR] = 0
                frames = self._operator.frames(now)
                used[OPERATOR_TICK] = self._operator.due_tick
                end = put_frames(rows, first, line.let_through(frames))
            else:
                self._move_line(line, now, tick)
                rows = self._to_plant if which == closed_loop.FIRMWARE else rows
                frames = frames_in(rows[first:end])
                if (passed := line.let_through(frames)) != frames:
                    end = put_frames(rows, first, passed)
            used[HELD + which] = line.held_frames
            return end

        self._plant.node.act(ticks)
        ended = self._call(self._bench(ticks, firmware, buffers), ticks, leave)
        self._keep_plant(tick, buffers)
        self._keep_firmware(own_ticks[: used[TURNS]], own)
        nodes.frames.count += min(int(used[FRAMES]), len(frames))
        node.pull_state()
        self._resume(ended)
        assert used[FRAMES] <= len(frames) or not len(frames), "a fault made more than its `most_copies`"
        self._firmware.last_tick += int(np.sum(elapsed_ticks))
        for line in lines:
            self._move_line(line, tick + ticks - 1, tick)
        self._hand_over(tick + ticks, used, is_regular)
        return ticks

    def _hand_over(self, tick: int, used: NDArray[np.int64], is_regular: bool) -> None:
        """Let Python go on at `tick`, with the frames in transit."""
        joined = self._nodes.joined
        joined[PLANT].pending += frames_in(self._to_plant[: used[TO_PLANT]])
        joined[OPERATOR].pending += frames_in(self._to_operator[: used[TO_OPERATOR]])
        self._nodes.bus.rest_until(tick * self._period_ns)
        for name, turns in self._turns.items():
            if is_regular or name != FIRMWARE:
                turns.resume(tick)

    def _name_frames(self, tick: int) -> int:
        """Name the frames on which faults act in `tick`; return the most that then leave for one."""
        acting = self._acting(FramesFault, tick)
        self._named[:] = 0
        for fault in acting:
            self._named[list(fault.can_ids)] = 1
        return most_copies(acting)

    def _acting(self, kind: type[_Kind], tick: int) -> list[_Kind]:
        """The faults of a kind that act in a tick."""
        t_s = tick * self._scenario.period_s
        return [one for one in self._scenario.faults if isinstance(one, kind) and one.acts(t_s)]

    def _begin_lines(self, tick: int) -> list[FaultyBus]:
        """Move the lines of the nodes that have steps in a stretch to its first tick; return them."""
        t_s = tick * self._scenario.period_s
        steps = [name for name in (PLANT, FIRMWARE) if self._nodes.processes.runs(name, t_s)]
        lines = [self._nodes.lines[name] for name in steps]
        for line in lines:
            line.move_to(t_s)
        return lines

    def _move_line(self, line: FaultyBus, tick: int, first: int) -> None:
        """Move a line to a tick of the stretch that began in `first`, with a step in each tick."""
        if tick > first:
            line.resume(tick * self._scenario.period_s, (tick - 1) * self._scenario.period_s)

    def run_plant(self, tick: int, ticks: int) -> int:
        """Run at most `ticks` of the plant, and of the other nodes in Python; return their number.

        A request of a user's controller ends it early; the sensors' noise of the other ticks is then skipped.
        """
        buffers = self._buffers(ticks, np.zeros(0, self._columns), np.zeros((0, FRAME_COLUMNS), np.int64))
        nodes, used = self._nodes, buffers.used
        self._named[:] = 1

        def exchange(_which: int, _first: int, end: int) -> int:
            """Run the other nodes since the plant's last step; then the plant sends and receives."""
            now = tick + int(used[TICKS])
            if now > tick:
                nodes.tick_after_first(now - 1)
            node, line = self._plant.node, nodes.lines[PLANT]
            line.move_to(now * node.period_s)
            line.send_all(frames_in(self._to_firmware[:end]))
            arrived = line.receive()
            used[STOP] = node.note_requests(arrived)
            used[TO_PLANT] = put_frames(self._to_plant, 0, arrived)
            return 0

        self._plant.node.act(ticks)
        ended = self._call(self._bench(ticks, NO_FIRMWARE, buffers), ticks, exchange)
        self._keep_plant(tick, buffers)
        self._resume(ended)
        if PLANT in self._turns:
            self._turns[PLANT].resume(ended.state.tick)
        nodes.tick_after_first(ended.state.tick - 1)
        return ended.state.tick - tick

    def _buffers(self, ticks: int, firmware: NDArray[np.void], frames: NDArray[np.int64]) -> Buffers:
        numbers = self._plant_memory(ticks)
        return Buffers(
            plant=numbers,
            plant_whole=numbers.view(np.int64),
            firmware=firmware.view(np.uint8) if firmware.dtype.itemsize else np.zeros(0, np.uint8),
            moves=self._moves,
            frames=frames,
            used=np.zeros(USED, np.int64),
        )

    def _bench(self, ticks: int, firmware: Firmware, buffers: Buffers) -> Bench:
        node = self._plant.node
        return Bench(
            period_s=self._scenario.period_s,
            period_ns=self._period_ns,
            middle_ns=self._edges_ns[1],
            bit_ns=self._nodes.bus.bit_ns,
            run=node.plant.run,
            readers=node.plant.readers,
            setup=node.setup,
            due=node.due(ticks),
            noise=node.plant.noise.take(ticks),
            to_firmware=self._to_firmware,
            to_plant=self._to_plant,
            to_operator=self._to_operator,
            named=self._named,
            firmware=firmware,
            buffers=buffers,
            call_python=0,
        )

    def _call(self, bench: Bench, ticks: int, function: Callable[[int, int, int], int]) -> RunEnd:
        state = self._plant.node.state
        self._run = self._run or entry_point(run, bench, state, ticks)
        call = PythonCall(function, partial(bench.buffers.used.__setitem__, STOP, AT_ONCE))
        called = FROM_COMPILED(call)  # compiled code calls it as long as it has a name here
        address = ctypes.cast(called, ctypes.c_void_p).value or 0
        state, status = self._run(bench._replace(call_python=address), state, ticks)
        return RunEnd(state, status, call.error)

    def _resume(self, ended: RunEnd) -> None:
        """Let the plant continue from where compiled code has ended, or raise why it has failed."""
        if ended.error is not None:
            raise ended.error
        self._plant.node.resume(ended.state, ended.status)

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

    def _keep_firmware(self, numbers: NDArray[np.int64], records: NDArray[np.void]) -> None:
        """Complete the firmware's records of its ticks with these numbers, and keep them."""
        rows = self._nodes.rows.get("firmware")
        if rows is None:
            return
        own = rows.room(ticks := len(numbers))
        if not np.may_share_memory(records, own):
            for name in self._columns.names or ():
                own[name] = records[name][:ticks]
        own["tick"], own["t_s"] = numbers, (numbers + 0.5) * self._scenario.period_s
        leave_untimed(own)
        rows.count += ticks
