"""The frames that the faults of a script cause together, before it runs.

Faults multiply: of three that send each frame a hundred times, every one takes the copies of those before it.
"""

import math
from collections.abc import Sequence

from hil.bus.base import MAX_BURST
from hil.faults.fault import Fault
from hil.faults.on_bus import FRAME_IDS, FramesFault, LineFault

MOST_AT_ONCE = 20
"""Largest number of faults at the nodes' connections that act at a time: each costs time in every step."""
MOST_HELD_FRAMES = 100_000
"""Largest number of frames that faults may hold back at a time: a minute of one frame, and its copies."""


def excess_of(faults: Sequence[Fault], tick_s: float, duration_s: float) -> str | None:
    """The reason why the faults send or hold too many frames, or are too many; None if they are not.

    Faults act together if one begins while the others act, or as they end and release what they hold.
    """
    line_faults = [fault for fault in faults if isinstance(fault, LineFault)]
    for latest in line_faults:
        acting = [fault for fault in line_faults if fault.at_s <= latest.at_s <= fault.end_s]
        copies = copies_of(acting)
        sent = sum(copies.values()) + sum(fault.most_foreign_frames(tick_s) for fault in acting)
        if sent > MAX_BURST:
            return (
                f"the faults that act at {latest.at_s:g} s send up to {sent:,} frames a tick; wanted "
                f"{MAX_BURST:,} at most, let fewer of them act at a time, or lower copies or frames_a_tick"
            )
        held = held_frames(acting, copies, tick_s, duration_s)
        if held > MOST_HELD_FRAMES:
            return (
                f"the faults that act at {latest.at_s:g} s hold back up to {held:,} frames; wanted "
                f"{MOST_HELD_FRAMES:,} at most, name fewer frames, or lower delay_s, period_s or copies"
            )
        if len(acting) > MOST_AT_ONCE:
            return (
                f"{len(acting)} faults of frames act at {latest.at_s:g} s; wanted {MOST_AT_ONCE} at most, "
                "let fewer of them act at a time"
            )
    return None


def copies_of(faults: Sequence[LineFault]) -> dict[int, int]:
    """How often faults that act together send each frame of vibro.dbc, by its identifier."""
    copies = dict.fromkeys(FRAME_IDS.values(), 1)
    for fault in faults:
        if isinstance(fault, FramesFault) and fault.most_copies > 1:
            for can_id in fault.can_ids:
                copies[can_id] *= fault.most_copies
    return copies


def held_frames(faults: Sequence[LineFault], copies: dict[int, int], tick_s: float, duration_s: float) -> int:
    """Largest number of frames that faults which act together hold back, or release at once, with copies.

    Each frame of vibro.dbc is sent at most once a tick.
    """
    held = 0
    for fault in faults:
        if isinstance(fault, FramesFault) and fault.longest_hold_s > 0.0:
            ticks = math.ceil(min(fault.longest_hold_s, duration_s - fault.at_s) / tick_s)
            held += ticks * sum(copies[can_id] for can_id in fault.can_ids)
    return held
