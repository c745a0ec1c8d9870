"""A CAN log of a real bench in the layout of a run: the bus traffic, without truth."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import can

from firmware_py.interface.codec import CODEC_BY_ID, FrameError
from firmware_py.interface.frame import Frame
from hil.bus.can_log import CanLog
from hil.judge.reasons import IMPORTED
from hil.record import run_folder
from hil.record.bus_reconstruction import FIELDS, ticks_seen
from hil.record.run_traces import read_bus
from hil.record.traces.trace import TraceWriter
from hil.show.rerun_log import rebuild
from tools.logs.foreign_logs import FORMATS, read_log
from tools.output import BadInputError

PERIOD_S = 1e-3
"""The bus's tick."""
EARLIEST_WALL_S = 1e8
"""Times before 1973 are not wall time; they count from the start of the log."""


@dataclass
class Census:
    """The number of a log's frames, and of those that cannot be shown as signals."""

    frames: int = 0
    known: int = 0
    unknown: Counter[str] = field(default_factory=Counter)
    """Frames whose identifier is not in the DBC, by identifier."""
    refused: Counter[str] = field(default_factory=Counter)
    """Frames whose identifier is in the DBC but whose data cannot be decoded, by identifier."""
    skipped: Counter[str] = field(default_factory=Counter)
    """Counts by kind of frames other than data frames of classic CAN with 11-bit identifiers."""


def kind_of(message: can.Message) -> str | None:
    """The kind of a message that cannot be a frame of the bench; None for a classic 11-bit data frame."""
    if message.is_error_frame:
        return "error frame"
    if message.is_remote_frame:
        return "remote frame"
    if message.is_fd:
        return "CAN FD"
    return "29-bit identifier" if message.is_extended_id else None


def of_channel(messages: list[can.Message], channel: str | None, path: Path) -> list[can.Message]:
    """The messages of one channel; BadInputError if a log has several and none is named."""
    channels = Counter(str(message.channel) for message in messages)
    found = ", ".join(f"{name} ({number} messages)" for name, number in sorted(channels.items()))
    if channel is None and len(channels) > 1:
        raise BadInputError(f"{path} has the channels {found}; choose one with --channel")
    if channel is not None and channel not in channels:
        raise BadInputError(
            f"{path} has no channel {channel}, but {found}; choose one of these with --channel"
        )
    return messages if channel is None else [m for m in messages if str(m.channel) == channel]


def count(census: Census, frame: Frame) -> None:
    """Count a frame as known, unknown or refused by the DBC."""
    census.frames += 1
    name = f"0x{frame.can_id:03X}"
    codec = CODEC_BY_ID.get(frame.can_id)
    if codec is None:
        census.unknown[name] += 1
        return
    try:
        codec.decode(frame.data)
        census.known += 1
    except FrameError:
        census.refused[name] += 1


def import_log(
    path: Path, out_dir: Path | None, channel: str | None = None, tolerant: bool = False
) -> dict[str, Any]:
    """Make a run folder from a log; return the folder's path and the contents of the log."""
    if not path.is_file():
        state = "no file" if path.exists() else "not there"
        raise BadInputError(f"{path} is {state}; wanted {FORMATS}")
    census = Census()
    frames: list[tuple[float, Frame]] = []
    log = read_log(path, tolerant)
    for message in of_channel(log.messages, channel, path):
        why = kind_of(message)
        if why is not None:
            census.skipped[why] += 1
            continue
        frame = Frame(message.arbitration_id, bytes(message.data))
        count(census, frame)
        frames.append((message.timestamp, frame))
    if not frames:
        raise BadInputError(f"{path} holds no data frame of classic CAN with an 11-bit identifier")
    frames.sort(key=lambda stamped: stamped[0])
    first_s = frames[0][0]
    with run_folder.claimed(path.stem, out_dir) as run_dir:
        run_folder.clear(run_dir)
        run_folder.note(
            run_dir,
            scenario=path.name,
            clock=IMPORTED,
            bus=str(path),
            kernel_can=False,
            period_s=PERIOD_S,
            wall_start_s=first_s if first_s > EARLIEST_WALL_S else 0.0,
        )
        with CanLog(run_dir / "can.log") as can_log:
            for t_s, frame in frames:
                can_log.write(round((t_s - first_s) * 1e6), (frame,))
        run_folder.write_json(run_dir / "outcome.json", {"reasons": []})
        ticks = ticks_seen(read_bus(run_dir / "can.log"), PERIOD_S)
        if ticks:
            with TraceWriter(run_dir / "firmware.trace", FIELDS, expected_records=len(ticks)) as writer:
                for tick in ticks:
                    writer.append(*tick)
        rebuild(run_dir)
    return {
        "log": str(path),
        "out": str(run_dir),
        "duration_s": frames[-1][0] - first_s,
        "frames": census.frames,
        "known": census.known,
        "unknown": dict(sorted(census.unknown.items())),
        "refused": dict(sorted(census.refused.items())),
        "skipped": dict(census.skipped),
        "left_out": [line._asdict() for line in log.left_out],
        "truncated": log.truncated,
        "firmware_seen": bool(ticks),
    }
