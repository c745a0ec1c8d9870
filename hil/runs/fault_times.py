"""When faults let ticks run in one compiled call: `hil.runs.compiled` asks, and the faults' kinds answer."""

import math
from collections.abc import Sequence

from hil.faults.fault import TIME_RESOLUTION_S, Fault
from hil.faults.on_bus import FramesFault, LineFault, ModelledFault
from hil.faults.on_process import ClockFault, HostFault, ProcessFault
from hil.roster import FIRMWARE, PLANT


def delays_firmware(fault: Fault) -> bool:
    """Whether a fault decides only in which ticks the firmware has its turns."""
    is_stall = isinstance(fault, ProcessFault) and not (fault.ends_process or fault.starts_anew)
    return (is_stall or isinstance(fault, ClockFault)) and fault.acts_in == FIRMWARE


def unplugs_firmware(fault: Fault) -> bool:
    """Whether a fault loses the frames that the firmware takes while it acts."""
    return isinstance(fault, LineFault) and fault.unplugs(FIRMWARE)


def acts_in_ticks(fault: Fault) -> bool:
    """Whether a fault acts only at the nodes' instants, and stretches of all nodes may contain it."""
    return isinstance(fault, FramesFault) or delays_firmware(fault)


def quiet_until(faults: Sequence[Fault], tick: int, period_s: float) -> float:
    """The tick until which no fault begins or ends, or acts so that stretches cannot contain it."""
    until, t_s = math.inf, tick * period_s
    for fault in faults:
        in_ticks = acts_in_ticks(fault)
        if in_ticks or fault.is_steady:
            for edge_s in (fault.at_s, fault.end_s):
                if edge_s > t_s + TIME_RESOLUTION_S and not math.isinf(edge_s):
                    share = TIME_RESOLUTION_S / period_s
                    edge = edge_s / period_s
                    until = min(until, math.ceil(edge - share) if in_ticks else math.floor(edge + share))
        elif t_s < fault.at_s - period_s:
            until = min(until, math.floor((fault.at_s - period_s + TIME_RESOLUTION_S) / period_s))
        elif t_s < fault.end_s:
            return tick
    return until


def acts_in_plant(fault: Fault) -> bool:
    """Whether a fault acts in the plant's node, or sends it frames, which may be requests that it answers."""
    if isinstance(fault, LineFault):
        return type(fault).foreign_frames is not LineFault.foreign_frames
    return not isinstance(fault, ModelledFault) and not (
        isinstance(fault, HostFault) and fault.acts_in != PLANT
    )


def most_copies(faults: Sequence[FramesFault]) -> int:
    """The most frames that leave for one, on which several of the faults may act."""
    by_id: dict[int, int] = {}
    for fault in faults:
        for can_id in fault.can_ids:
            by_id[can_id] = by_id.get(can_id, 1) * fault.most_copies
    return max(by_id.values(), default=1)
