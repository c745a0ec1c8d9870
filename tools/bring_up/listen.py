"""Step 1, listen: which nodes are on the bus, at which rates, and with which errors. It sends nothing."""

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from firmware_py.interface import codec
from firmware_py.interface.addresses import NODE_IDS
from firmware_py.interface.codec import FrameCodec, FrameError
from firmware_py.interface.enums import AxisState
from firmware_py.interface.frame import Frame, worst_case_bits
from hil.record.bus_load import BITRATE_BIT_S
from hil.timing.clock import TICK_S
from tools.bring_up.step import NOTHING, Context, Curve, Findings, Step, StepFailedError

LISTEN_S = 3.0
WANTED = (
    codec.ACCELEROMETER,
    codec.ENCODER_ESTIMATES,
    codec.DRIVE_HEARTBEAT,
    codec.DRIVE_ERRORS,
    codec.DRIVE_CURRENT,
    codec.DRIVE_TEMPERATURE,
    codec.DRIVE_SUPPLY,
)
"""The frames of a module's drive and sensors, without which no later step is possible."""
FEWEST_SHARE, MOST_SHARE = 0.7, 1.5
"""Frames over those that are due. Below, the sender is slow; above, two senders share an identifier."""
MOST_DAMAGED_SHARE = 0.01
LONGEST_GAP_S = 0.01
"""The firmware tolerates bundles of up to 10 ms."""
REMEDY = {
    codec.ACCELEROMETER.can_id: "check the sensor node's supply, its plug and its number (bus.own_node)",
    codec.ENCODER_ESTIMATES.can_id: "set the drive's encoder_msg_rate_ms to 1",
    codec.DRIVE_HEARTBEAT.can_id: "check the drive's supply, its node_id, and the bit rate of 1 Mbit/s",
}
ALL_REPORTS = "set the rates of the drive's cyclic messages as the page on frames has them"


class Listener:
    """Keeps every frame with the period in which it arrived."""

    moves = False
    step_ticks = 1

    def __init__(self) -> None:
        self.frames: list[tuple[int, Frame]] = []

    def play(self, tick: int, received: Sequence[Frame]) -> Sequence[Frame]:
        """Keep the frames; send none."""
        self.frames += [(tick, frame) for frame in received]
        return ()


def intact(one: FrameCodec[Any], frames: Sequence[Frame]) -> list[Frame]:
    """The codec's frames, without those that it refuses: a wrong length, CRC or value."""
    found = []
    for frame in frames:
        if frame.can_id == one.can_id:
            with suppress(FrameError):
                one.decode(frame.data)
                found.append(frame)
    return found


def judge_frame(one: FrameCodec[Any], frames: Sequence[Frame], duration_s: float, found: Findings) -> None:
    """Hold the frames of one kind against `vibro.dbc`; raises StepFailedError."""
    name, due = one.record.__name__, duration_s / (one.period_s or TICK_S)
    found.add(f"{name}, of those due", len(frames) / due, "1")
    remedy = REMEDY.get(one.can_id, ALL_REPORTS)
    if not frames:
        raise StepFailedError(
            f"no frame {name} ({one.can_id:#05x}) has arrived in {duration_s:g} s: {remedy}"
        )
    if len(frames) > MOST_SHARE * due:
        raise StepFailedError(
            f"{len(frames)} frames {name} in {duration_s:g} s, wanted {due:.0f}: two nodes have the same "
            "number, or its period is too short; give one of the nodes another number"
        )
    if len(frames) < FEWEST_SHARE * due:
        raise StepFailedError(f"{len(frames)} frames {name} in {duration_s:g} s, wanted {due:.0f}: {remedy}")
    if (damaged := len(frames) - len(intact(one, frames))) > MOST_DAMAGED_SHARE * len(frames):
        raise StepFailedError(
            f"{damaged} of {len(frames)} frames {name} are damaged (length, CRC or value): check the "
            "sender's format, the termination of the bus with 120 ohm at both ends, and its bit rate"
        )


def judge_frames(frames: Sequence[Frame], duration_s: float, found: Findings) -> None:
    """Hold the frames of the module's drive and sensors against `vibro.dbc`; raises StepFailedError."""
    for one in WANTED:
        judge_frame(one, [frame for frame in frames if frame.can_id == one.can_id], duration_s, found)


def name_other_drives(ids: Counter[int], found: Findings) -> None:
    """Say which other nodes send heartbeats of a drive; raises StepFailedError if the module's does not."""
    beat = codec.DRIVE_HEARTBEAT.can_id
    others = sorted(
        can_id // NODE_IDS
        for can_id in ids
        if can_id % NODE_IDS == beat and can_id not in codec.CODEC_BY_ID and can_id // NODE_IDS > 0
    )
    if others:
        found.notes.append(f"other drives: node {', '.join(map(str, others))}")
    if others and not ids[beat]:
        raise StepFailedError(
            f"no drive has the node number 0, but node {others[0]} sends a drive's heartbeat: give "
            f"--set firmware.bus.drive_node={others[0]}, or set the drive's node_id to 0"
        )


def listen(context: Context, found: Findings) -> None:
    """Listen for `LISTEN_S`, and judge what has arrived."""
    player = Listener()
    context.bench.play(player, LISTEN_S, context.log("listen"))
    frames = [frame for _, frame in player.frames]
    ids = Counter(frame.can_id for frame in frames)
    if not frames:
        raise StepFailedError(
            "the bus is silent: check its supply, the bit rate of 1 Mbit/s, and the termination at both ends"
        )
    found.add(
        "bus load", sum(worst_case_bits(len(one.data)) for one in frames) / BITRATE_BIT_S / LISTEN_S, "1"
    )
    foreign = sorted(set(ids) - set(codec.CODEC_BY_ID))
    found.notes += [f"identifier {one:#05x} is not in vibro.dbc: {ids[one]} frames" for one in foreign[:5]]
    name_other_drives(ids, found)
    judge_frames(frames, LISTEN_S, found)
    if ids[codec.FIRMWARE_HEARTBEAT.can_id]:
        raise StepFailedError("another controller sends heartbeats on this bus; end it first")
    last = codec.DRIVE_HEARTBEAT.decode(intact(codec.DRIVE_HEARTBEAT, frames)[-1].data)
    if last.axis_state != AxisState.IDLE:
        raise StepFailedError(
            f"the drive is armed (axis state {last.axis_state}); end what has armed it, then begin again"
        )
    ticks = np.array([tick for tick, frame in player.frames if frame.can_id == codec.ACCELEROMETER.can_id])
    counters = [codec.ACCELEROMETER.counter(one.data) for one in intact(codec.ACCELEROMETER, frames)]
    steps = np.diff(counters) % 256
    found.add("lost samples", float(np.sum(np.maximum(steps - 1, 0)) / len(counters)), "1")
    gap_s = float(np.max(np.diff(ticks))) * TICK_S
    found.add("longest time between two samples", gap_s, "s")
    if gap_s > LONGEST_GAP_S:
        found.notes.append(
            f"samples arrive up to {gap_s * 1e3:.0f} ms apart: an adapter that bundles them wants its "
            "latency timer at 1 ms"
        )
    found.curves = [Curve("samples a period", np.arange(np.max(ticks) + 1) * TICK_S, np.bincount(ticks))]
    found.axes = ("time in s", "samples of the accelerometers a period")


LISTEN = Step(
    "listen", "It sends nothing and counts the frames on the bus.", "", 3.0, lambda _: NOTHING, listen
)
