"""The bus's frames as streams for the response-time analysis, from `vibro.dbc` and the senders' limits.

Period: `GenMsgCycleTime`, or for a frame sent on an event its smallest gap, `GenMsgDelayTime`. Deadline: the
period, since a frame's transmission must end before its successor is queued. Length: the bound of Davis et
al. 2007, including stuff bits and intermission. Every node queues at most one frame per tick in addition to
those of every tick. A frame with two senders is two streams; a frame that no node of the bench sends is none.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from cantools.database.can import Message

from firmware_py.interface.addresses import DEFAULT, Addresses, bus_id
from firmware_py.interface.dbc import database
from firmware_py.interface.frame import worst_case_bits
from hil.bus.model.bits import bit_ns_of
from hil.bus.model.schedulability import ErrorModel, Pacing, Response, Stream, load, response_times

NS_PER_MS = 1_000_000

TICK_NS = NS_PER_MS
"""The nodes' tick on CAN; a frame with this period is sent in every tick."""

QUEUING_JITTER_NS = 100_000
"""Largest delay with which a node queues its frames. Loops under real-time scheduling wake 20 to 70 µs late
in 99.9 % of their ticks, microcontrollers far less; a run with later wake-ups is marked as not real-time."""

XCP = ("XcpCommand", "XcpResponse")
"""The frames of measurement and calibration. A master sends at most one command per tick; the firmware sends
at most one response and one sample, which have the same identifier."""
XCP_DEADLINE_NS = 10 * NS_PER_MS
"""Deadline of these frames, which control nothing: samples carry their tick, and a master waits for
responses."""

ONE_ERROR = ErrorModel(burst=1, gap_ns=10 * NS_PER_MS)
"""A disturbed bus: one transmission destroyed at any time, then one every 10 ms."""

NO_NODE = "Vector__XXX"
"""Name in the DBC of a sender that is not a node of the bus."""


class MessageSetError(ValueError):
    """The DBC lacks an attribute that the analysis needs."""


class Schedule(NamedTuple):
    """The analysis at one bit rate."""

    bitrate: int
    load: float
    """Share of the bus's time, with every event at its highest rate."""
    responses: list[Response]

    @property
    def late(self) -> list[str]:
        """Frames that may miss their deadline."""
        return [response.stream.name for response in self.responses if not response.in_time]

    @property
    def schedulable(self) -> bool:
        """Whether every frame's transmission always ends before its deadline."""
        return not self.late


def bus_streams(
    bitrate: int, modules: Sequence[Addresses] = (DEFAULT,), is_measured: bool = True
) -> list[Stream]:
    """Return all streams of `modules` at `bitrate`.

    `is_measured`: a master of XCP sends a command and receives a response and a sample in every tick.
    """
    streams = [
        stream
        for number, places in enumerate(modules)
        for stream in _module_streams(bitrate, places, "" if len(modules) == 1 else f" {number}")
        if is_measured or not stream.name.startswith(XCP)
    ]
    streams += [
        stream._replace(name=stream.name.replace("Response", "Sample"))
        for stream in streams
        if stream.name.startswith("XcpResponse")
    ]
    return sorted(streams, key=lambda stream: stream.can_id)


def _module_streams(bitrate: int, places: Addresses, suffix: str) -> Iterator[Stream]:
    """Yield the streams of `vibro.dbc` for the module at `places`, its names ending in `suffix`."""
    bit_ns = bit_ns_of(bitrate)
    for message in sorted(database().messages, key=lambda message: message.frame_id):
        for sender in message.senders:
            if sender == NO_NODE:
                continue
            period_ns = _period_ns(message)
            yield Stream(
                can_id=bus_id(places, message.frame_id),
                name=f"{message.name}{suffix}",
                sender=f"{sender}{suffix}",
                length=message.length,
                period_ns=period_ns,
                jitter_ns=QUEUING_JITTER_NS,
                deadline_ns=XCP_DEADLINE_NS if message.name in XCP else period_ns,
                transmission_ns=worst_case_bits(message.length) * bit_ns,
                pacing=Pacing(f"{sender}{suffix}", TICK_NS) if period_ns > TICK_NS else None,
            )


def _period_ns(message: Message) -> int:
    gap = None if message.dbc is None else message.dbc.attributes.get("GenMsgDelayTime")
    period_ms = int(message.cycle_time or 0) or (0 if gap is None else int(gap.value))
    if period_ms <= 0:
        raise MessageSetError(
            f"{message.name} has neither GenMsgCycleTime nor GenMsgDelayTime in vibro.dbc; give one in ms"
        )
    return period_ms * NS_PER_MS


def bus_schedule(
    bitrate: int,
    errors: ErrorModel | None = None,
    modules: Sequence[Addresses] = (DEFAULT,),
    is_measured: bool = True,
) -> Schedule:
    """Analyse a bus of `bitrate` bit/s with the modules at these places; arguments as of `bus_streams`."""
    streams = bus_streams(bitrate, modules, is_measured)
    return Schedule(bitrate, float(load(streams)), response_times(streams, bit_ns_of(bitrate), errors))
