"""`vibrohil schedule`: worst-case response time of every CAN frame."""

from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Column

from tools.commands.options import Json
from tools.output import BadInputError, answer, console, exit_of, table_of

if TYPE_CHECKING:
    from firmware_py.interface.addresses import Addresses
    from hil.can_model.message_set import Schedule

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

    A master of XCP measures as much as the firmware sends: one command, response and sample per tick.
    """
    from hil.can_model.message_set import ONE_ERROR, bus_schedule

    modules = [places_of(text) for text in module or ["0,1"]]
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
    answer(payload, as_json, lambda: show(payload), exit_of(payload))


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


def rows(analysed: "Schedule", disturbed: "Schedule") -> list[dict[str, Any]]:
    """One row per frame, times in seconds; an unbounded response time is infinite."""
    from hil.can_model.schedulability import seconds

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


def show(payload: dict[str, Any]) -> None:
    """Print the frames by priority, then the results at other bit rates."""
    names = (Column(name, no_wrap=True) for name in ("frame", "sender"))
    numbers = (">bytes", ">period", ">response", ">disturbed", ">slack", ">load %")
    table = table_of(("id", *names, *numbers))
    for row in payload["frames"]:
        table.add_row(
            f"0x{row['id']:03X}",
            row["name"],
            row["sender"],
            str(row["length"]),
            milliseconds(row["period_s"], 0),
            milliseconds(row["response_s"]),
            milliseconds(row["response_disturbed_s"]),
            milliseconds(row["slack_s"]),
            f"{100 * row['load']:.2f}",
            style=None if row["in_time"] else "red",
        )
    console.print(table)
    console.print(
        "times in ms · period: also the deadline (of XCP's frames: 10 ms), and an event's smallest gap\n"
        "response: at worst · disturbed: with a transmission destroyed at any time, then one every 10 ms",
        style="dim",
    )
    say(payload["bitrate"], payload["load"], ", ".join(payload["late"]))
    alone = payload["without_xcp"]
    say(payload["bitrate"], alone["load"], ", ".join(alone["late"]), "without XCP, ")
    for other in payload["others"]:
        say(other["bitrate"], other["load"], f"{len(other['late'])} frames" if other["late"] else "")


def say(bitrate: int, load: float, late: str, which: str = "") -> None:
    """Print one line for one bit rate; `which` frames."""
    what = f"[red]may be late: {late}[/]" if late else "[green]every frame in time[/]"
    console.print(
        f"{bitrate / 1000:g} kbit/s, {which}load {100 * load:.1f} % at most: {what}", soft_wrap=True
    )


def milliseconds(time_s: float, digits: int = 3) -> str:
    """A time as text in ms; an unbounded time as the sign of infinity."""
    if time_s in (float("inf"), float("-inf")):
        return "∞" if time_s > 0 else "−∞"
    return f"{1000 * time_s:.{digits}f}"
