"""Joins a CAN adapter to the hub of a run: passes every message of classic CAN from either to the other.

It is a separate process (`python -m hil.bus.bridge SOCKET INTERFACE:CHANNEL`). Most adapters can be opened by
one program only, and many neither return what their own program sends nor have a descriptor to wait for. So a
run's nodes meet at a hub, and this process alone opens the adapter. It ends when its standard input ends.

The errors of every adapter are judged here (`Direction`): a message that it refuses and a passing receive
error are counted, and any other error is its failure. The parent (`hil.bus.bridge_process`) receives a
report when something has changed. After a failure, messages still pass in the direction that works until the
parent ends this process, so that the nodes' last ones leave.
"""

import argparse
import json
import selectors
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import asdict

import can

from hil.bus.base import LOGGER, BusCounters, BusError
from hil.bus.local import LocalBus
from hil.processes.child import READY, report_to_parent, stop_requests
from hil.timing.realtime import BRIDGE_PRIORITY, take_fifo

BITRATE = 1_000_000
"""Bit rate of the bench's bus; interfaces without a bit rate ignore it."""
LOOK_S = 0.05
"""Longest wait for a message, after which a thread looks whether it should end."""
RETRY_S = 0.001
"""Interval between two attempts to receive while an adapter raises errors."""
LONGEST_ERROR_S = 0.1
"""An adapter that raises nothing but errors for this long has failed."""
LAST_S = 0.1
"""Time for the nodes' last messages to pass after the request to end."""
END_TIMEOUT_S = 1.0
"""Longest wait for a thread, which its adapter's driver may hold up."""


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


class Direction(threading.Thread):
    """Passes messages from one bus to another until `ending` is set or either bus fails.

    `when_failed` is called once, by this thread, after the failure of either bus.
    """

    def __init__(
        self,
        source: can.BusABC,
        target: can.BusABC,
        ending: threading.Event,
        when_failed: Callable[[], None],
    ) -> None:
        super().__init__(daemon=True)
        self.counts = BusCounters()
        self.failure = ""
        self._source = source
        self._target = target
        self._ending = ending
        self._when_failed = when_failed
        self._failing_since_s: float | None = None

    def run(self) -> None:
        """Pass messages."""
        while not self.failure and not self._ending.is_set():
            try:
                message = self._source.recv(LOOK_S)
            except Exception as error:  # each interface raises what its driver's library raises
                self._judge_receive_error(error)
                continue
            self._failing_since_s = None
            if message is not None:
                self._pass_on(message)

    def _pass_on(self, message: can.Message) -> None:
        """Pass a message on, unless this process has sent it."""
        if not message.is_rx:
            return
        if message.is_error_frame or message.is_fd:
            self.counts.foreign += 1
            return
        message.channel = None
        self.counts.sent += 1
        try:
            self._target.send(message, timeout=LOOK_S)
        except can.CanError as error:  # a full queue, a message that nobody acknowledged
            self.counts.refuse(1, f"{self._target.channel_info}: {error}")
            if self.counts.lasting_refusal:
                self._fail(self._target, self.counts.lasting_refusal)
        except Exception as error:  # each interface raises what its driver's library raises
            self.counts.refuse(1, f"{self._target.channel_info}: {error}")
            self._fail(self._target, error)

    def _judge_receive_error(self, error: Exception) -> None:
        """Go on after an error of python-can, unless errors have lasted too long; any other is a failure."""
        now_s = time.monotonic()
        if self.counts.receive_errors == 0:
            LOGGER.warning("%s: a receive error: %s", self._source.channel_info, error)
        self.counts.receive_errors += 1
        if self._failing_since_s is None:
            self._failing_since_s = now_s
        if not isinstance(error, can.CanError) or now_s - self._failing_since_s >= LONGEST_ERROR_S:
            self._fail(self._source, error)
        else:
            self._ending.wait(RETRY_S)

    def _fail(self, bus: can.BusABC, why: object) -> None:
        self.failure = f"{bus.channel_info}: {why}"
        print(self.failure, file=sys.stderr)
        self._when_failed()


class Bridge:
    """Both directions between a hub and an adapter."""

    def __init__(self, hub: LocalBus, adapter: can.BusABC) -> None:
        self._hub = hub
        self._ending = threading.Event()
        self._lock = threading.Lock()
        self._reported = ""
        self.directions = {
            "to_adapter": Direction(hub, adapter, self._ending, self.report),
            "from_adapter": Direction(adapter, hub, self._ending, self.report),
        }

    @property
    def failure(self) -> str:
        """The first failure of a bus; empty while both work."""
        return next((one.failure for one in self.directions.values() if one.failure), "")

    def report(self) -> None:
        """Report counts and failure to the parent, if they have changed."""
        with self._lock:
            self.directions["to_adapter"].counts.lost = self._hub.lost
            counts = {name: asdict(one.counts) for name, one in self.directions.items()}
            alarming = [(one["unsent"], one["lost"], one["receive_errors"]) for one in counts.values()]
            state = json.dumps([self.failure, alarming])
            if state != self._reported:
                self._reported = state
                report_to_parent(json.dumps({"failure": self.failure, **counts}))

    def run(self) -> int:
        """Pass messages until a stop is requested; returns the exit status, 1 if a bus has failed."""
        with stop_requests() as stop, selectors.DefaultSelector() as selector:
            selector.register(stop, selectors.EVENT_READ)
            selector.register(sys.stdin, selectors.EVENT_READ)
            report_to_parent(READY)
            for direction in self.directions.values():
                direction.start()
            while not selector.select(LOOK_S):
                self.report()
        time.sleep(LAST_S)
        self._ending.set()
        for direction in self.directions.values():
            direction.join(END_TIMEOUT_S)
        self._reported = ""
        self.report()
        return 1 if self.failure else 0


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
        return Bridge(hub, adapter).run()


if __name__ == "__main__":
    sys.exit(main())
