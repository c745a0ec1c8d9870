"""The hub of the bus `local`: forwards every frame of a node to all other nodes, in the order of arrival.

It is a separate process (`python -m hil.bus.hub SOCKET`), started by the process that provides the bus, and
ends when its standard input ends. The socket lies in a folder that only its user may enter.
"""

import argparse
import json
import selectors
import socket
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from hil.bus.hub_socket import HELLO, HELLO_SEND_ONLY, HELLO_STAMPED
from hil.bus.wire import CAN_FRAME, CONTROL_ID, FRAME_BYTES, LOSS_KIND, STAMP_KIND
from hil.timing.processes import READY, report_to_parent, stop_requests
from hil.timing.realtime import HUB, become_realtime

READ_BYTES = 1 << 16
MAX_QUEUED_BYTES = 1 << 16
"""Queue for a node: frames of most of a second; a node has no use for older ones."""
MAX_QUEUED_STAMPED_BYTES = 1 << 19
"""Queue for a node that records: about six seconds, since a busy machine may suspend it for long."""


@dataclass
class Client:
    """One node: its requests, the bytes of a partly received frame, and the frames queued for it."""

    link: socket.socket
    joined: bool = False
    listening: bool = False
    stamped: bool = False
    received: bytes = b""
    queued: bytearray = field(default_factory=bytearray)
    dropped: int = 0
    unreported: int = 0
    """Dropped frames that have not been reported to the node; below, the times of the first and the last."""
    first_drop_ns: int = 0
    last_drop_ns: int = 0

    @property
    def loss_report(self) -> bytes:
        """The report on unreported drops: first time, their number, last time; empty if there are none."""
        if not self.unreported:
            return b""
        parts = (
            (STAMP_KIND, self.first_drop_ns),
            (LOSS_KIND, self.unreported),
            (STAMP_KIND, self.last_drop_ns),
        )
        return b"".join(control(kind, value) for kind, value in parts)


def control(kind: int, value: int) -> bytes:
    """Pack a control record of the stream between hub and node."""
    return CAN_FRAME.pack(CONTROL_ID, kind, value.to_bytes(8, "little"))


class Hub:
    """Forwards frames between the nodes that connect to its socket."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.forwarded = 0
        self.dropped = 0
        self._clients: dict[int, Client] = {}
        self._selector = selectors.DefaultSelector()
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(str(path))
        self._listener.listen()
        self._listener.setblocking(False)

    def serve(self, until: Iterable[IO[str] | socket.socket]) -> None:
        """Forward until one of `until` becomes readable or ends."""
        self._selector.register(self._listener, selectors.EVENT_READ)
        ends = [self._selector.register(end, selectors.EVENT_READ) for end in until]
        while True:
            for key, events in self._selector.select():
                if key in ends:
                    return
                if key.fileobj is self._listener:
                    self._welcome()
                    continue
                client = self._clients.get(key.fd)
                if client is not None and events & selectors.EVENT_WRITE:
                    self._drain(client)
                if client is not None and events & selectors.EVENT_READ:
                    self._forward_from(client)

    def _welcome(self) -> None:
        link, _ = self._listener.accept()
        link.setblocking(False)
        self._clients[link.fileno()] = Client(link)
        self._selector.register(link, selectors.EVENT_READ)

    def _part_with(self, client: Client) -> None:
        self._selector.unregister(client.link)
        del self._clients[client.link.fileno()]
        self.dropped += client.dropped
        client.link.close()

    def _forward_from(self, client: Client) -> None:
        try:
            chunk = client.link.recv(READ_BYTES)
        except BlockingIOError:
            return
        except ConnectionError:
            chunk = b""
        if not chunk:
            self._part_with(client)
            return
        if client.received or len(chunk) % FRAME_BYTES:
            chunk = client.received + chunk
            whole = len(chunk) - len(chunk) % FRAME_BYTES
            chunk, client.received = chunk[:whole], chunk[whole:]
        if chunk and not client.joined:
            chunk = self._admit(client, chunk)
        if not chunk:
            return
        self.forwarded += len(chunk) // FRAME_BYTES
        stamp = b""
        for other in list(self._clients.values()):
            if other is client or not other.listening:
                continue
            if other.stamped:
                stamp = stamp or control(STAMP_KIND, time.time_ns())
                self._pass_on(other, chunk, stamp)
            else:
                self._pass_on(other, chunk)

    def _admit(self, client: Client, chunk: bytes) -> bytes:
        """Admit a node by its greeting and return the frames after it; disconnect an unknown client."""
        greeting, rest = chunk[:FRAME_BYTES], chunk[FRAME_BYTES:]
        if greeting not in (HELLO, HELLO_STAMPED, HELLO_SEND_ONLY):
            self._part_with(client)
            return b""
        client.joined = True
        client.listening = greeting != HELLO_SEND_ONLY
        client.stamped = greeting == HELLO_STAMPED
        self._pass_on(client, HELLO)
        return rest

    def _pass_on(self, client: Client, frames: bytes, stamp: bytes = b"") -> None:
        chunk = client.loss_report + stamp + frames
        if client.queued:
            most = MAX_QUEUED_STAMPED_BYTES if client.stamped else MAX_QUEUED_BYTES
            if len(client.queued) + len(chunk) > most:
                self._drop(client, len(frames) // FRAME_BYTES)
                return
            client.unreported = 0
            client.queued += chunk
            return
        client.unreported = 0
        try:
            sent = client.link.send(chunk)
        except BlockingIOError:
            sent = 0
        except ConnectionError:
            return  # the client's readable event follows and disconnects it
        if sent < len(chunk):
            client.queued += chunk[sent:]
            self._selector.modify(client.link, selectors.EVENT_READ | selectors.EVENT_WRITE)

    def _drop(self, client: Client, frames: int) -> None:
        client.last_drop_ns = time.time_ns()
        if not client.unreported:
            client.first_drop_ns = client.last_drop_ns
        client.unreported += frames
        client.dropped += frames

    def _drain(self, client: Client) -> None:
        try:
            sent = client.link.send(client.queued)
        except (BlockingIOError, ConnectionError):
            return
        del client.queued[:sent]
        if not client.queued and client.unreported:
            client.queued += client.loss_report
            client.unreported = 0
        elif not client.queued:
            self._selector.modify(client.link, selectors.EVENT_READ)

    def close(self) -> None:
        """Disconnect all nodes; remove the socket, and its folder if it is then empty."""
        for client in list(self._clients.values()):
            self._part_with(client)
        self._selector.close()
        self._listener.close()
        self.path.unlink(missing_ok=True)
        with suppress(OSError):
            self.path.parent.rmdir()


def main() -> None:
    """Serve until standard input closes, then report the numbers of frames forwarded and dropped."""
    parser = argparse.ArgumentParser(description="The hub of the bus `local`.")
    parser.add_argument("socket", type=Path, help="where to listen; its folder must be the user's own")
    path: Path = parser.parse_args().socket
    stop = stop_requests()
    become_realtime(HUB)
    hub = Hub(path)
    report_to_parent(READY)
    hub.serve((sys.stdin, stop))
    hub.close()
    report_to_parent(json.dumps({"forwarded": hub.forwarded, "dropped": hub.dropped}))


if __name__ == "__main__":
    main()
