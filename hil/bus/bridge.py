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

from hil.bus.adapter import open_adapter
from hil.bus.base import BusError
from hil.bus.local import LocalBus
from hil.timing.processes import READY, report_to_parent, stop_requests

LOOK_S = 0.05
"""Longest wait for a message, after which a thread looks whether it should end."""


@dataclass
class Passed:
    """Counts of one direction's messages."""

    forwarded: int = 0
    unsent: int = 0
    """Messages that the other side refused: its queue was full, or nobody acknowledged them."""
    foreign: int = 0
    """Error frames and CAN FD, which stay where they are."""


class Direction(threading.Thread):
    """Passes messages from one bus to another until `ending` is set or a bus fails, which sets `ending`."""

    def __init__(self, source: can.BusABC, target: can.BusABC, ending: threading.Event) -> None:
        super().__init__()
        self.counts = Passed()
        self.failure = ""
        self._source = source
        self._target = target
        self._ending = ending

    def run(self) -> None:
        """Pass messages on; the failure of the source is kept as `failure`."""
        while not self._ending.is_set():
            try:
                message = self._source.recv(LOOK_S)
            except (can.CanError, OSError) as error:
                self.failure = f"{self._source.channel_info}: {error}"
                self._ending.set()
                return
            if message is not None and message.is_rx:
                self._pass_on(message)

    def _pass_on(self, message: can.Message) -> None:
        if message.is_error_frame or message.is_fd:
            self.counts.foreign += 1
            return
        message.channel = None
        try:
            self._target.send(message, timeout=LOOK_S)
            self.counts.forwarded += 1
        except can.CanError:
            self.counts.unsent += 1


def bridge(hub: can.BusABC, adapter: can.BusABC) -> int:
    """Pass messages both ways until a stop is requested; returns the exit status, 1 if a bus has failed."""
    ending = threading.Event()
    directions = {
        "to_adapter": Direction(hub, adapter, ending),
        "from_adapter": Direction(adapter, hub, ending),
    }
    for direction in directions.values():
        direction.start()
    with stop_requests() as stop, selectors.DefaultSelector() as selector:
        selector.register(stop, selectors.EVENT_READ)
        selector.register(sys.stdin, selectors.EVENT_READ)
        report_to_parent(READY)
        while not ending.is_set() and not selector.select(LOOK_S):
            """No stop is requested and no bus has failed."""
    ending.set()
    for direction in directions.values():
        direction.join()
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
    with adapter, LocalBus(arguments.socket) as hub:
        return bridge(hub, adapter)


if __name__ == "__main__":
    sys.exit(main())
