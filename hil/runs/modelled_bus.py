"""The bus model as the bus of lockstep, if a scenario requests it, and half a tick of it for stretches."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface.frame import Frame
from hil.bus.frame_rows import frames_in, put_frames, word_frame
from hil.bus.in_process import IdealBus, Logged
from hil.bus.model.fault_confinement import RECORDED, UNTOUCHED, BusErrorRecord, errors_of
from hil.bus.model.modelled_bus import Delivery, ModelledBus, ModelledNode
from hil.faults.fault import Fault
from hil.faults.kinds.babbling import Babbling
from hil.faults.on_bus import ModelledFault
from hil.nodes.closed_loop import BUS_BEFORE, BUSY, FRAMES, TO_OPERATOR, TO_PLANT, Buffers
from hil.nodes.operator.node import RECEIVED_IDS
from hil.record.traces.trace import OpenTrace
from hil.roster import FIRMWARE, OPERATOR, PLANT, names
from hil.timing.clock import NS_PER_S, NS_PER_US

STRANGER = "stranger"


def in_ns(time_s: float) -> int:
    """A time in whole nanoseconds."""
    return round(time_s * NS_PER_S)


class BusAsModelled:
    """The bus model: frames take time, the lowest identifier first; bus faults act in the model.

    The error counters and the discarded frames are recorded in the trace bus_errors.
    """

    breaks = (ModelledFault, Babbling)

    def __init__(self, bitrate: int, traces: OpenTrace, faults: Sequence[Fault]) -> None:
        """`faults`: the script's, of which bus-off, destroyed transmissions and babbling act here."""
        self._bus = ModelledBus((*names(), STRANGER), bitrate)
        self._faults = [fault for fault in faults if isinstance(fault, ModelledFault)]
        self._babbling = [fault for fault in faults if isinstance(fault, Babbling)]
        self._errors = traces("bus_errors", [("", BusErrorRecord)])
        self._last_errors = 0, 0, [UNTOUCHED] * len(RECORDED)

    def join(self, name: str) -> ModelledNode:
        """The connection of one of the nodes."""
        return self._bus.join(name)

    def pass_time(self, from_ns: int, to_ns: int) -> list[Logged]:
        """Advance the model; return the frames that have arrived, logged at their arrival."""
        if self._faults:
            self._break(from_ns / NS_PER_S)
        destroyed = self._bus.destroyed
        for t_ns, frame in self._foreign_frames(from_ns, to_ns):
            self._bus.submit(STRANGER, frame, t_ns)
        deliveries = self._bus.move_to(to_ns)
        logged = [(delivery.t_ns, [delivery.frame]) for delivery in deliveries]
        self._count(from_ns / NS_PER_S, deliveries, self._bus.destroyed - destroyed)
        self._bus.join(STRANGER).pending.clear()
        self._note_errors(to_ns / NS_PER_S)
        return logged

    @property
    def bit_ns(self) -> int:
        """The duration of a bit."""
        return self._bus.bit_ns

    @property
    def is_at_rest(self) -> bool:
        """Whether the bus is idle, no frame waits, and no error counter changes as the bench's nodes send."""
        return self._bus.is_at_rest(silent=(STRANGER,))

    def rest_until(self, t_ns: int) -> None:
        """Go to a time at which the bus is at rest again; what it did until then has been computed."""
        self._bus.move_to(t_ns)

    def close(self) -> None:
        """Close the trace."""
        if self._errors is not None:
            self._errors.close()

    def _foreign_frames(self, from_ns: int, to_ns: int) -> list[tuple[int, Frame]]:
        """The frames that a foreign node queues from `from_ns` to before `to_ns`, in order of time."""
        frames: list[tuple[int, Frame]] = []
        for fault in self._babbling:
            begin_ns, period_ns = in_ns(fault.at_s), in_ns(fault.period_s)
            end_ns = to_ns if fault.duration_s is None else min(to_ns, in_ns(fault.end_s))
            periods = max(-(-(from_ns - begin_ns) // period_ns), 0)
            times_ns = range(begin_ns + periods * period_ns, end_ns, period_ns)
            frames += [(t_ns, fault.frame) for t_ns in times_ns]
        return sorted(frames)

    def _note_errors(self, t_s: float) -> None:
        model = self._bus
        unsent = sum(model.join(name).lost for name in names())
        errors = model.destroyed, unsent, [model.counters(name) for name in RECORDED]
        if errors != self._last_errors and self._errors is not None:
            self._last_errors = destroyed, unsent, counters = errors
            self._errors.append(BusErrorRecord(t_s, destroyed, unsent, *map(errors_of, counters)))

    def _count(self, t_s: float, deliveries: Sequence[Delivery], destroyed: int) -> None:
        """Count the transmissions destroyed, and the foreign frames, of an interval that begins at `t_s`."""
        for fault in self._faults:
            if fault.acts(t_s):
                fault.count(fault.acted(destroyed))
        for babbling in self._babbling:
            foreign = [one for one in deliveries if one.sender == STRANGER and one.frame == babbling.frame]
            babbling.count(len(foreign))

    def _break(self, t_s: float) -> None:
        acting = [fault for fault in self._faults if fault.acts(t_s)]
        for fault in acting:
            if fault.node_off is not None:
                self._bus.switch_off(fault.node_off)
        self._bus.destroy(frozenset().union(*(fault.destroyed_ids for fault in acting)))


class Transit(NamedTuple):
    """Frames on their way in compiled code, rows of identifier, length and word."""

    to_firmware: NDArray[np.int64]
    to_plant: NDArray[np.int64]
    to_operator: NDArray[np.int64]


def pass_half(
    bus: IdealBus | BusAsModelled,
    joined: Mapping[str, Any],
    transit: Transit,
    edges_ns: tuple[int, int, int],
    which: int,
    end: int,
    tick: int,
    buffers: Buffers,
) -> int:
    """Run a bus that does not rest for a half of `tick`, in which the first `end` rows were sent.

    `edges_ns`: a tick's beginning, the firmware's turn, and its end. `which`: `BUS_BEFORE` or `BUS_AFTER`
    that turn. Returns the end of the rows that have arrived.
    """
    used, is_before = buffers.used, which == BUS_BEFORE
    rows = transit.to_firmware if is_before else transit.to_plant
    begin_ns, end_ns = np.add(edges_ns[:2] if is_before else edges_ns[1:], tick * edges_ns[-1]).tolist()
    sent = frames_in(rows[:end])
    if is_before:
        bus.rest_until(begin_ns)
        commands = frames_in(transit.to_plant[: used[TO_PLANT]])
        joined[OPERATOR].send_all(commands)
        joined[PLANT].send_all(frame for frame in sent if frame not in commands)  # no frame is of both
    else:
        joined[FIRMWARE].send_all(sent)
    passed = bus.pass_time(begin_ns, end_ns)
    logged = [(t_ns // NS_PER_US, *word_frame(frame)) for t_ns, frames in passed for frame in frames]
    if kept := logged[: max(len(buffers.frames) - used[FRAMES], 0)]:
        buffers.frames[used[FRAMES] :][: len(kept)] = kept
    used[FRAMES] += len(logged)
    if is_before:
        used[TO_PLANT] = 0
        return put_frames(rows, 0, joined[FIRMWARE].receive())
    received = [frame for frame in joined[OPERATOR].receive() if frame.can_id in RECEIVED_IDS]
    used[TO_OPERATOR] = put_frames(transit.to_operator, used[TO_OPERATOR], received)
    used[TO_PLANT] = put_frames(rows, 0, joined[PLANT].receive())
    used[BUSY] = not bus.is_at_rest or len(joined[FIRMWARE].pending) > 0
    return int(used[TO_PLANT])
