"""A CAN log of a real bench in the layout of a run: the bus traffic, without truth."""

import os
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from firmware_py.interface.codec import CODEC_BY_ID
from firmware_py.interface.frame import Frame
from hil.bus.log.can_log import CanLog
from hil.record import run_folder
from hil.record.bus_reconstruction import doubt_two_firmwares, reconstruct_ticks
from hil.record.candump import BusLog
from hil.record.frame_tables import find_refused
from hil.record.run_traces import read_bus
from hil.record.traces.trace import TraceWriter
from hil.run_files import RunFile, trace_file
from hil.show.rerun_log import rebuild
from hil.timing.clock import IMPORTED, TICK_S
from tools.exchange.foreign_logs import (
    SHOWN_LINES,
    ClockJump,
    ForeignLog,
    LoggedMessage,
    clock_jumps,
)
from tools.exchange.reading import read_log
from tools.output import BadInputError

LONGEST_S = 86400.0
"""Longest time that a log may span; more is a clock that was set."""
MOST_IGNORED_SHARE = 0.01
"""Largest share of lines that are no messages, such as statistics of the bus, in a log that may be judged."""
EARLIEST_WALL_S = 1e8
"""Times before 1973 are not wall time; they count from the start of the log."""
NO_CHANNEL = str(None)
"""The channel of a message for which the log names none."""


def choose_channel(messages: list[LoggedMessage], channel: str | None, path: Path) -> list[LoggedMessage]:
    """The messages of one channel; BadInputError if a log has several and none is named.

    Messages without a channel, such as error frames in candump's logs, belong to each.
    """
    channels = Counter(message.channel for message in messages if message.channel != NO_CHANNEL)
    found = ", ".join(f"{name} ({number} messages)" for name, number in sorted(channels.items()))
    if channel is None and len(channels) > 1:
        raise BadInputError(f"{path} has the channels {found}; choose one with --channel")
    if channel is not None and channel not in channels:
        raise BadInputError(
            f"{path} has no channel {channel}, but {found}; choose one of these with --channel"
        )
    return messages if channel is None else [m for m in messages if m.channel in (channel, NO_CHANNEL)]


def count_undecoded(bus: BusLog) -> tuple[dict[str, int], dict[str, int]]:
    """Counts by identifier of the frames that are not in the DBC, and of those that it cannot decode."""
    ids = Counter(int(bus.can_id[row]) for row, _ in find_refused(bus))
    named = [(f"0x{can_id:03X}", count, can_id in CODEC_BY_ID) for can_id, count in sorted(ids.items())]
    unknown, damaged = (
        {name: count for name, count, known in named if known is is_known} for is_known in (False, True)
    )
    return unknown, damaged


def doubt_mixed(jumps: Sequence[ClockJump]) -> list[str]:
    """The first jump backwards as a reason not to judge the run; empty without one."""
    return [
        f"the log's clock falls back from {from_s:.6f} to {to_s:.6f} s at line or message {place}: frames "
        "of different times are mixed; cut the log there and import its parts"
        for place, from_s, to_s in jumps
        if to_s < from_s
    ][:1]


def doubt_ignored(log: ForeignLog) -> list[str]:
    """Too many lines that are no messages as a reason not to judge the run; empty without one."""
    if log.ignored_share <= MOST_IGNORED_SHARE:
        return []
    number, text, why = min([*log.ignored[:1], *log.left_out[:1]])
    ignored = log.ignored_count + len(log.left_out)
    return [
        f"{ignored} lines, {log.ignored_share:.1%} of the log, were ignored, more than "
        f"{MOST_IGNORED_SHARE:.0%}; the first is line {number}: {text!r} ({why})"
    ]


def refuse_long(path: Path, duration_s: float, jumps: Sequence[ClockJump]) -> None:
    """Raise `BadInputError` for a log that spans more than `LONGEST_S`, and name its first jump."""
    if duration_s > LONGEST_S:
        place, from_s, to_s = max(jumps, key=lambda jump: abs(jump.to_s - jump.from_s))
        raise BadInputError(
            f"{path} spans {duration_s:.9g} s, more than {LONGEST_S:g} s: at line or message {place} the "
            f"time goes from {from_s:.6f} to {to_s:.6f} s; cut the log there and import its parts"
        )


def import_log(
    path: Path, out_dir: Path | None, channel: str | None = None, tolerant: bool = False
) -> dict[str, Any]:
    """Make a run folder from a log; return the folder's path and the contents of the log."""
    if out_dir is not None and Path(os.path.realpath(path)).is_relative_to(os.path.realpath(out_dir)):
        raise BadInputError(
            f"{path} lies in the folder that it would replace; name another --out than {out_dir}"
        )
    log = read_log(path, tolerant)
    chosen = choose_channel(log.messages, channel, path)
    jumps = clock_jumps(chosen)
    frames = [
        (message.t_s, Frame(message.can_id, message.data)) for message in chosen if message.kind is None
    ]
    if not frames:
        raise BadInputError(f"{path} holds no data frame of classic CAN with an 11-bit identifier")
    frames.sort(key=lambda stamped: stamped[0])
    first_s, duration_s = frames[0][0], frames[-1][0] - frames[0][0]
    refuse_long(path, duration_s, jumps)
    with run_folder.claimed(path.stem, out_dir) as run_dir:
        run_folder.clear(run_dir)
        run_folder.note(
            run_dir,
            scenario=path.name,
            begun_s=time.time(),
            clock=IMPORTED,
            bus=path.name,
            kernel_can=False,
            period_s=TICK_S,
            duration_s=duration_s,
            wall_start_s=first_s if first_s > EARLIEST_WALL_S else 0.0,
        )
        with CanLog(run_dir / RunFile.CAN_LOG) as can_log:
            for t_s, frame in frames:
                can_log.write(round((t_s - first_s) * 1e6), (frame,))
        bus = read_bus(run_dir / RunFile.CAN_LOG)
        doubts = doubt_ignored(log) + doubt_mixed(jumps) + doubt_two_firmwares(bus)
        run_folder.write_json(run_dir / RunFile.OUTCOME, {"reasons": [], "not_judged": doubts})
        unknown, damaged = count_undecoded(bus)
        ticks = reconstruct_ticks(bus, TICK_S)
        if ticks:
            fields = [(name, type(values[0].item())) for name, values in ticks.items()]
            with TraceWriter(run_dir / trace_file("firmware"), fields) as writer:
                records = np.zeros(len(ticks["tick"]), writer.dtype)
                for name, values in ticks.items():
                    records[name] = values
                writer.append_all(records)
        rebuild(run_dir)
    return {
        "log": str(path),
        "out": str(run_dir),
        "duration_s": duration_s,
        "frames": len(frames),
        "known": len(frames) - sum(unknown.values()) - sum(damaged.values()),
        "unknown": unknown,
        "refused": damaged,
        "skipped": dict(Counter(message.kind for message in chosen if message.kind is not None)),
        "left_out": [line._asdict() for line in log.left_out],
        "ignored": log.ignored_count,
        "ignored_lines": [line._asdict() for line in log.ignored],
        "other_objects": dict(sorted(log.other_objects.items())),
        "not_judged": doubts,
        "trigger_s": None if log.earlier_s == 0.0 else -first_s,
        "clock_jumps": len(jumps),
        "clock_jumps_first": [jump._asdict() for jump in jumps[:SHOWN_LINES]],
        "truncated": log.truncated,
        "firmware_seen": bool(ticks),
    }
