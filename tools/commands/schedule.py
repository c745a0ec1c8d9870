"""`vibrohil schedule`: worst-case response time of every CAN frame."""

from collections import Counter
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tools.commands.options import Json
from tools.output import BadInputError, answer, exit_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from firmware_py.interface.addresses import Addresses
    from hil.bus.model.message_set import Schedule

DEFAULT_BITRATE = 1_000_000
REPORTED_BITRATES = (1_000_000, 500_000, 250_000)


def schedule(
    bitrate: Annotated[int, typer.Option(help="Bits per second.")] = DEFAULT_BITRATE,
    module: Annotated[
        list[str] | None,
        typer.Option(
            help="A module's node numbers: its drive's and the first of its own; repeatable.",
            metavar="DRIVE,OWN",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Calculate the worst-case response time of every CAN frame, and check its deadline.

    A master of XCP measures as much as the firmware sends: one command, response and sample per tick. The
    period of an event is its smallest gap. `response_disturbed_s`: with a transmission destroyed at any time,
    then one every 10 ms.
    """
    from hil.bus.model.message_set import ONE_ERROR, bus_schedule

    modules = [places_of(text) for text in module or ["0,1"]]
    refuse_shared_nodes(modules)
    analysed = bus_schedule(bitrate, modules=modules)
    disturbed = bus_schedule(bitrate, errors=ONE_ERROR, modules=modules)
    alone = bus_schedule(bitrate, modules=modules, is_measured=False)
    alone_disturbed = bus_schedule(bitrate, errors=ONE_ERROR, modules=modules, is_measured=False)
    others = [bus_schedule(other, modules=modules) for other in REPORTED_BITRATES if other != bitrate]
    payload = {
        "bitrate": bitrate,
        "load": analysed.load,
        "passed": analysed.schedulable,
        "late": analysed.late,
        "late_if_disturbed": disturbed.late,
        "frames": rows(analysed, disturbed),
        "without_xcp": {
            "load": alone.load,
            "passed": alone.schedulable,
            "late": alone.late,
            "late_if_disturbed": alone_disturbed.late,
        },
        "others": [
            {"bitrate": other.bitrate, "load": other.load, "passed": other.schedulable, "late": other.late}
            for other in others
        ],
    }
    answer(payload, as_json, status=exit_of(payload))


def places_of(text: str) -> "Addresses":
    """The addresses of a module with the node numbers `DRIVE,OWN`; BadInputError for any other text."""
    from firmware_py.interface.addresses import AddressError, addresses

    drive_node, _, own_node = text.partition(",")
    if not (drive_node.strip().isdecimal() and own_node.strip().isdecimal()):
        raise BadInputError(f"--module {text}: wanted the drive's and the first own node number, e.g. 0,1")
    try:
        return addresses(int(drive_node), int(own_node))
    except AddressError as error:
        raise BadInputError(f"--module {text}: {error}") from error


def refuse_shared_nodes(modules: "Sequence[Addresses]") -> None:
    """Raise BadInputError for modules with a common node number: their frames have the same identifiers."""
    from firmware_py.interface.addresses import OWN_NODES

    count = Counter(places.drive_node for places in modules)
    for places in modules:
        count.update(range(places.own_node, places.own_node + OWN_NODES))
    shared = ", ".join(str(node) for node in sorted(count) if count[node] > 1)
    if shared:
        raise BadInputError(
            f"--module: more than one module has node {shared}; give each module node numbers of its own"
        )


def rows(analysed: "Schedule", disturbed: "Schedule") -> list[dict[str, Any]]:
    """One row per frame, times in seconds; an unbounded response time is infinite."""
    from hil.bus.model.schedulability import seconds

    table = []
    for response, with_errors in zip(analysed.responses, disturbed.responses, strict=True):
        stream = response.stream
        table.append(
            {
                "id": stream.can_id,
                "name": stream.name,
                "sender": stream.sender,
                "length": stream.length,
                "period_s": seconds(stream.period_ns),
                "jitter_s": seconds(stream.jitter_ns),
                "transmission_s": seconds(stream.transmission_ns),
                "response_s": seconds(response.response_ns),
                "response_disturbed_s": seconds(with_errors.response_ns),
                "deadline_s": seconds(stream.deadline_ns),
                "slack_s": seconds(stream.deadline_ns) - seconds(response.response_ns),
                "load": stream.transmission_ns / stream.period_ns,
                "in_time": response.in_time,
            }
        )
    return table
