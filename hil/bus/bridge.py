"""Joins a CAN adapter to the hub of a run: passes every message of classic CAN from either to the other.

It is a separate process (`python -m hil.bus.bridge SOCKET INTERFACE:CHANNEL`). Most adapters can be opened by
one program only, and many neither return what their own program sends nor have a descriptor to wait for. So a
run's nodes meet at a hub, and this process alone opens the adapter. It ends when its standard input ends.
"""

import argparse
import json
import selectors
import sys
import threading
from dataclasses import asdict, dataclass

import can

from hil.bus.base import BusError
from hil.bus.local import LocalBus
from hil.timing.processes import READY, report_to_parent, stop_requests
from hil.timing.realtime import BRIDGE_PRIORITY, take_fifo

BITRATE = 1_000_000
"""Bit rate of the bench's bus; interfaces without a bit rate ignore it."""
LOOK_S = 0.05
"""Longest wait for a message, after which a thread looks whether it should end."""


def open_adapter(interface: str, channel: str) -> can.BusABC:
    """Open `channel` of python-can's `interface`; `BusError` if it does not open."""
    try:
        return can.Bus(channel, interface, bitrate=BITRATE)
    except Exception as error:  # each interface raises what its driver's library raises
        known = ", ".join(sorted(can.VALID_INTERFACES))
        reason = str(error) or type(error).__name__
        raise BusError(
            f"bus {interface}:{channel} did not open: {reason}; wanted auto, vcan, local or one of "
            f"python-can's interfaces ({known}) with its channel, e.g. socketcan:can0"
        ) from error


@dataclass
class Passed:
    """Counts of one direction's messages."""

    forwarded: int = 0
    unsent: int = 0
    """Messages that the other side refused: its queue was full, or nobody acknowledged them."""
    foreign: int = 0
    """Error frames and CAN FD, which stay where they are."""


class Direction(can.Listener):
    """Passes messages from one bus to another; a failure of either bus sets `ending`."""

    def __init__(self, source: can.BusABC, target: can.BusABC, ending: threading.Event) -> None:
        self.counts = Passed()
        self.failure = ""
        self._source = source
        self._target = target
        self._ending = ending

    def on_message_received(self, msg: can.Message) -> None:
        """Pass a message on, unless this process has sent it."""
        if not msg.is_rx:
            return
        if msg.is_error_frame or msg.is_fd:
            self.counts.foreign += 1
            return
        msg.channel = None
        try:
            self._target.send(msg, timeout=LOOK_S)
            self.counts.forwarded += 1
        except can.CanError:
            self.counts.unsent += 1
        except Exception as error:  # each interface raises what its driver's library raises
            self._fail(self._target, error)

    def on_error(self, exc: Exception) -> None:
        """Keep the failure of the source."""
        self._fail(self._source, exc)

    def _fail(self, bus: can.BusABC, error: Exception) -> None:
        self.failure = f"{bus.channel_info}: {error}"
        self._ending.set()


def bridge(hub: can.BusABC, adapter: can.BusABC) -> int:
    """Pass messages both ways until a stop is requested; returns the exit status, 1 if a bus has failed."""
    ending = threading.Event()
    directions = {
        "to_adapter": Direction(hub, adapter, ending),
        "from_adapter": Direction(adapter, hub, ending),
    }
    notifiers = [
        can.Notifier(source, [direction], timeout=LOOK_S)
        for source, direction in zip((hub, adapter), directions.values(), strict=True)
    ]
    with stop_requests() as stop, selectors.DefaultSelector() as selector:
        selector.register(stop, selectors.EVENT_READ)
        selector.register(sys.stdin, selectors.EVENT_READ)
        report_to_parent(READY)
        while not ending.is_set() and not selector.select(LOOK_S):
            """No stop is requested and no bus has failed."""
    for notifier in notifiers:
        notifier.stop()
    report_to_parent(json.dumps({name: asdict(one.counts) for name, one in directions.items()}))
    failures = [direction.failure for direction in directions.values() if direction.failure]
    for failure in failures:
        print(failure, file=sys.stderr)
    return 1 if failures else 0


def main() -> int:
    """Open hub and adapter and pass messages until a stop is requested."""
    parser = argparse.ArgumentParser(description="Joins a CAN adapter to the hub of a run.")
    parser.add_argument("socket", help="the hub's socket")
    parser.add_argument("adapter", help="interface:channel of python-can")
    arguments = parser.parse_args()
    interface, _, channel = arguments.adapter.partition(":")
    try:
        adapter = open_adapter(interface, channel)
    except BusError as error:
        report_to_parent(f"failed {error}")
        return 0
    take_fifo(BRIDGE_PRIORITY)  # the threads that pass the messages start with this priority
    with adapter, LocalBus(arguments.socket) as hub:
        return bridge(hub, adapter)


if __name__ == "__main__":
    sys.exit(main())
