"""The cyclic frames around the overflow of the ticks that are counted for them, after 25 days at 1 kHz."""

from collections import defaultdict

import pytest

from firmware_py.interface import codec
from firmware_py.interface.generated.records import (
    FirmwareHeartbeat,
    GaitReport,
    GaitSensors,
    SetInputTorque,
    StrikerEstimate,
)
from firmware_py.node.tick import INITIAL
from firmware_py.node.transmitter import CYCLED, CYCLES
from firmware_py.shell.builds import Build, node_of
from firmware_py.shell.flat_node import FlatNode
from firmware_py.shell.node import Node
from firmware_py.shell.parameters import config_from

CYCLIC = (StrikerEstimate, FirmwareHeartbeat, GaitReport)
"""The records of `CYCLES`, in its order."""
OVERFLOW = CYCLED + 1
AROUND = 350
LONGEST_DELAY = 2
"""Ticks for which a frame waits at most: for one of the drive link, and for another cyclic one."""


def node_at(build: Build, ticks: int) -> Node:
    """A node that was just powered up, but has counted ticks."""
    node = node_of(build)(config_from({}))
    if isinstance(node, FlatNode):
        node.memory["ticks"][0] = ticks
        node.push_memory()
    else:
        node._state = INITIAL._replace(ticks=ticks)
    return node


def due_at(tick: int, offset: int, period: int) -> int:
    """The last tick up to `tick` in which a cyclic frame fell due; the overflow is at tick 0."""
    since_offset = tick - offset
    return tick - (since_offset if since_offset >= 0 else OVERFLOW + since_offset) % period


@pytest.mark.parametrize("build", ["python", "compiled"])
def test_cyclic_frames_keep_period_and_offset_around_the_overflow_of_their_ticks(build: Build) -> None:
    """The first interval after the overflow is shorter, and no frame is lost or sent twice."""
    node, ticks = node_at(build, OVERFLOW - AROUND), range(1 - AROUND, AROUND)
    sent: dict[int, list[int]] = defaultdict(list)
    for tick in ticks:
        received = [codec.encode(GaitSensors(0.0, 9.8, 0, 0), tick)] if tick % 5 == 0 else []
        for frame in node.tick(received, 1):
            sent[frame.can_id].append(tick)
        assert node.ticks == OVERFLOW + tick
    assert sent[codec.CODECS[SetInputTorque].can_id] == list(ticks)
    for cycle, record in zip(CYCLES, CYCLIC, strict=True):
        offset, period = cycle.offset_ticks, round(1e3 * cycle.period_s)
        due = [due_at(tick, offset, period) for tick in sent[codec.CODECS[record].can_id]]
        delays = [tick - at for tick, at in zip(sent[codec.CODECS[record].can_id], due, strict=True)]
        assert max(delays) <= LONGEST_DELAY
        after, before = [at for at in due if at >= offset], [at for at in due if at < offset]
        assert after == list(range(offset, AROUND, period))
        assert before == list(range(before[0], offset, period))
        assert before[0] < period - AROUND + LONGEST_DELAY
        assert 0 < after[0] - before[-1] == OVERFLOW % period < period
