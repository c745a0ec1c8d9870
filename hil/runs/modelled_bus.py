"""The bus model as the bus of lockstep, if a scenario requests it."""

from collections.abc import Sequence

from firmware_py.interface.frame import Frame
from hil.bus.in_process import Logged
from hil.bus.model.fault_confinement import RECORDED, UNTOUCHED, BusErrorRecord, errors_of
from hil.bus.model.modelled_bus import Delivery, ModelledBus, ModelledNode
from hil.faults.fault import Fault
from hil.faults.kinds.babbling import Babbling
from hil.faults.on_bus import ModelledFault
from hil.record.traces.trace import OpenTrace
from hil.roster import names
from hil.timing.clock import NS_PER_S

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
