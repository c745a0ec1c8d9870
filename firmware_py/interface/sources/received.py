"""The text of `received.py`: the newest record and arrival of each frame that the firmware receives."""

import math
from collections.abc import Sequence

from firmware_py.interface.layout import Layout, snake
from firmware_py.interface.sources.records import nothing

RECEIVED = '''"""Frames received by the firmware: written by `generate.py` out of `vibro.dbc`; do not edit."""

from typing import NamedTuple

from firmware_py.interface.arrivals import NEVER, Arrival, dated, taken
from firmware_py.interface.counters import Counters
from firmware_py.interface.frame import WordFrame
from firmware_py.interface.generated import kinds, records, unpacking

'''

STATE = '''\
RECEIVED_IDS = ({ids})
"""The identifiers that the firmware receives, the most frequent first."""

class Received(NamedTuple):
    """The newest record and arrival of each frame that the firmware receives."""

{members}

INITIAL = Received({initial})
'''
DATED = '''

def with_sensors_dated(received: Received, tick: int, sampled: int) -> Received:
    """`received`, with the sensors' arrivals in `tick` dated back to the earlier tick `sampled`."""
    return received._replace({sampled})


'''
RECEIVE = '''def receive(
    tick_s: float, received: Received, counters: Counters, tick: int, frame: WordFrame
) -> tuple[Received, Counters, bool]:
    """Process one frame that arrived before tick number `tick`: `(received, counters, usable)`."""
    can_id, length, word = frame
    usable = False
{branches}    return received, counters, usable
'''
BY_SAMPLE = ("EncoderEstimates",)
"""The drive's frames that are sampled with the sensors."""


def received_source(layouts: Sequence[Layout]) -> str:
    """The text of the file: `RECEIVED_IDS`, `Received`, `INITIAL`, `with_sensors_dated` and `receive`."""
    frames = sorted(
        (layout for layout in layouts if "Firmware" in layout.receivers),
        key=lambda layout: (layout.period_s or math.inf, layout.can_id),
    )
    ids = ", ".join(f"kinds.{snake(layout.name).upper()}.can_id" for layout in frames)
    members, initial, sampled, branches = "", "", "", ""
    for layout in frames:
        name = snake(layout.name)
        arrival = f"{name}_arrival"
        if layout.signals:
            members += f"    {name}: records.{layout.name}\n"
            initial += f"{name}={nothing(layout)}, "
        members += f"    {arrival}: Arrival\n"
        initial += f"{arrival}=NEVER, "
        if is_sampled(layout):
            sampled += f"{arrival}=dated(received.{arrival}, tick, sampled), "
        branches += branch(layout)
    return (
        RECEIVED
        + STATE.format(ids=ids, members=members, initial=initial)
        + DATED.format(sampled=sampled)
        + RECEIVE.format(branches=branches.replace("    elif", "    if", 1))
    )


def branch(layout: Layout) -> str:
    """The lines that process one frame."""
    name = snake(layout.name)
    kind, new = f"kinds.{name.upper()}", f"{name}_arrival=arrival"
    if layout.signals:
        new += f", {name}={name} if usable else received.{name}"
    return (
        f"    elif can_id == {kind}.can_id:\n"
        f"        {name if layout.signals else '_'}, reason = unpacking.unpack_{name}(length, word)\n"
        f"        arrival, counters, usable = taken(\n"
        f"            received.{name}_arrival, counters, tick, reason, {kind}, word, tick_s\n        )\n"
        f"        received = received._replace({new})\n"
    )


def is_sampled(layout: Layout) -> bool:
    """Whether the frame is a reading of the plant, whose arrival is dated back to its sample's tick."""
    return layout.sender == "Sensors" or layout.name in BY_SAMPLE
