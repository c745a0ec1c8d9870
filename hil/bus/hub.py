"""The hub of the bus `local`: forwards every frame of a node to all other nodes, in the order of arrival.

It is also the pacemaker of a run (`hil.timing.pacemaker`), of which it receives the plan on standard input.
The frames for a node that takes turns wait here and are sent with its turn. On another bus a run has a hub
that forwards nothing and only gives the turns.

It is a separate process (`python -m hil.bus.hub SOCKET`), started by the process that provides the bus, and
ends when its standard input ends. The socket lies in a folder that only its user may enter.
"""

import argparse
import json
import selectors
import socket
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from hil.bus.hub_socket import HELLO, HELLO_SEND_ONLY, HELLO_STAMPED, member_greeting
from hil.bus.wire import (
    CONTROL_MARK,
    DUE_KIND,
    END_KIND,
    FRAME_BYTES,
    LOSS_KIND,
    STAMP_KIND,
    TURN_END,
    TURN_KIND,
    control,
    whole_frames,
)
from hil.processes.child import READY, report_to_parent, stop_requests
from hil.roster import members, processes_of_a_run
from hil.timing.pacemaker import LONGEST_HOLD_NS, Pacemaker, Plan, TurnTimes
from hil.timing.realtime import HUB, become_realtime

READ_BYTES = 1 << 16
MAX_QUEUED_BYTES = 1 << 16
"""Queue for a node: frames of most of a second; a node has no use for older ones."""
MAX_QUEUED_STAMPED_BYTES = 1 << 20
"""Queue for a node that records: about twelve seconds, longer than the longest hold of a run."""
MAX_QUEUED_MEMBER_BYTES = 1 << 22
"""Queue for a node that takes turns: forty seconds, for a pause of the scenario."""
END_MARK = CONTROL_MARK + bytes((END_KIND,))
GREETINGS = {member_greeting(member): member for member in members()}


@dataclass
class Client:
    """One node: its requests, the bytes of a partly received frame, and the frames queued for it."""

    link: socket.socket
    joined: bool = False
    listening: bool = False
    stamped: bool = False
    member: str | None = None
    """Its name, if it takes turns."""
    received: bytes = b""
    queued: bytearray = field(default_factory=bytearray)
    is_full: bool = False
    """Whether its socket had no room for all queued bytes."""
    dropped: int = 0
    unreported: int = 0
    """Dropped frames that have not been reported to the node."""

    @property
    def loss_report(self) -> bytes:
        """The report on unreported drops, their number; empty if there are none."""
        return control(LOSS_KIND, self.unreported) if self.unreported else b""

    @property
    def most_queued(self) -> int:
        """Largest queue for this node in bytes."""
        if self.member is not None:
            return MAX_QUEUED_MEMBER_BYTES
        return MAX_QUEUED_STAMPED_BYTES if self.stamped else MAX_QUEUED_BYTES


def frames_alone(records: bytes) -> bytes:
    """A node's records without control records, which only the hub may send: they report losses and times."""
    if CONTROL_MARK not in records:
        return records
    starts = range(0, len(records), FRAME_BYTES)
    each = (records[start : start + FRAME_BYTES] for start in starts)
    return b"".join(record for record in each if not record.startswith(CONTROL_MARK))


class Hub:
    """Forwards frames between the nodes that connect to its socket."""

    def __init__(self, path: Path, turn_times: TurnTimes | None = None) -> None:
        self.path = path
        self.pacemaker: Pacemaker | None = None
        self._turn_times = turn_times
        self.forwarded = 0
        self.dropped = 0
        self._clients: dict[int, Client] = {}
        self._members: dict[str, Client] = {}
        # select(2) takes its timeout in µs, epoll in ms.
        self._selector = selectors.SelectSelector()
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(str(path))
        self._listener.listen()
        self._listener.setblocking(False)

    def serve(self, plan: IO[str], until: socket.socket) -> None:
        """Forward until `until` becomes readable or `plan` ends; give turns by the `Plan` in `plan`."""
        for waker in (self._listener, plan, until):
            self._selector.register(waker, selectors.EVENT_READ)
        while True:
            for key, events in self._selector.select(self._patience_s()):
                if key.fileobj is until:
                    return
                if key.fileobj is plan:
                    line = plan.readline()
                    if not line:
                        return
                    self._begin_run(Plan.from_line(line))
                    continue
                if key.fileobj is self._listener:
                    self._welcome()
                    continue
                client = self._clients.get(key.fd)
                if client is not None and events & selectors.EVENT_WRITE:
                    self._drain(client)
                if client is not None and events & selectors.EVENT_READ:
                    self._forward_from(client)

    def _begin_run(self, plan: Plan) -> None:
        """Begin to give turns; frames of an earlier time are no part of the run."""
        self.pacemaker = Pacemaker(plan)
        for client in self._members.values():
            client.queued.clear()
        for takes in plan.takes:
            if takes.member not in self._members and takes.has_turn(0):  # it has ended since it was ready
                self._miss(takes.member)

    def _patience_s(self) -> float | None:
        """Begin a turn that is due, and return the time until the next decision; None without a run."""
        pacemaker = self.pacemaker
        while pacemaker is not None and (deadline_ns := pacemaker.deadline_ns()) is not None:
            now_ns = time.monotonic_ns()
            if now_ns < deadline_ns:
                return (deadline_ns - now_ns) * 1e-9
            if pacemaker.running is None and now_ns - deadline_ns <= LONGEST_HOLD_NS:
                pacemaker.begin(now_ns)
                self._give_turn(pacemaker)
            else:
                pacemaker.abandon()
                self._end_run()
        return None

    def _give_turn(self, pacemaker: Pacemaker) -> None:
        """Send the running member its frames and the mark of its turn, as soon as it has joined."""
        assert pacemaker.running is not None
        client = self._members.get(pacemaker.running)
        if client is None:
            return
        if self._turn_times is not None:
            self._turn_times.note(pacemaker.t_ns, time.time_ns())
        client.queued += control(DUE_KIND, pacemaker.turn.due_ns) + control(TURN_KIND, pacemaker.turn.tick)
        self._drain(client)

    def _end_turn(self, pacemaker: Pacemaker, cpu_ns: int, next_tick: int) -> None:
        pacemaker.end(time.monotonic_ns(), cpu_ns, next_tick)
        if pacemaker.is_over:
            self._end_run()

    def _end_run(self) -> None:
        """Report to all members that there are no more turns."""
        for client in self._members.values():
            with suppress(OSError):
                client.link.shutdown(socket.SHUT_WR)

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
        if client.member is not None:
            self._members.pop(client.member)
            self._miss(client.member)

    def _miss(self, member: str) -> None:
        """Go on without a member that has ended; without the process of the bench the run is over."""
        pacemaker = self.pacemaker
        if pacemaker is None or pacemaker.is_over:
            return
        pacemaker.leave(member, time.monotonic_ns())
        if member not in processes_of_a_run():
            pacemaker.stop()
        if pacemaker.is_over:
            self._end_run()

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
        chunk, client.received = whole_frames(client.received + chunk)
        if chunk and not client.joined:
            chunk = self._admit(client, chunk)
        has_ended = client.member is not None and chunk[-FRAME_BYTES:][:5] == END_MARK
        if has_ended:
            chunk, end = chunk[:-FRAME_BYTES], chunk[-FRAME_BYTES:]
        self._forward(client, frames_alone(chunk))
        if has_ended and self.pacemaker is not None and self.pacemaker.running == client.member:
            cpu_us, next_tick = TURN_END.unpack(end[-TURN_END.size :])
            self._end_turn(self.pacemaker, 1000 * cpu_us, next_tick)

    def _forward(self, client: Client, chunk: bytes) -> None:
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
        member = GREETINGS.get(greeting)
        is_known = member is not None or greeting in (HELLO, HELLO_STAMPED, HELLO_SEND_ONLY)
        if not is_known or member in self._members:
            self._part_with(client)
            return b""
        client.joined = True
        client.listening = greeting != HELLO_SEND_ONLY
        client.stamped = greeting == HELLO_STAMPED
        self._pass_on(client, HELLO)
        if member is not None:
            client.member = member
            self._members[member] = client
            if self.pacemaker is not None and self.pacemaker.running == member:
                self._give_turn(self.pacemaker)
        return rest

    def _pass_on(self, client: Client, frames: bytes, stamp: bytes = b"") -> None:
        chunk = client.loss_report + stamp + frames
        if client.queued or client.member is not None:
            if len(client.queued) + len(chunk) > client.most_queued:
                client.unreported += len(frames) // FRAME_BYTES
                client.dropped += len(frames) // FRAME_BYTES
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
            self._watch(client)

    def _drain(self, client: Client) -> None:
        try:
            sent = client.link.send(client.queued)
        except BlockingIOError:
            sent = 0
        except ConnectionError:
            return
        del client.queued[:sent]
        if not client.queued and client.unreported:
            client.queued += client.loss_report
            client.unreported = 0
        self._watch(client)

    def _watch(self, client: Client) -> None:
        """Wait for room in the client's socket while frames are queued for it."""
        if bool(client.queued) != client.is_full:
            client.is_full = not client.is_full
            write = selectors.EVENT_WRITE if client.is_full else 0
            self._selector.modify(client.link, selectors.EVENT_READ | write)

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
    """Serve until standard input closes, then report the frames forwarded and dropped, and the holds."""
    parser = argparse.ArgumentParser(description="The hub of the bus `local`.")
    parser.add_argument("socket", type=Path, help="where to listen; its folder must be the user's own")
    parser.add_argument("--turn-times", type=int, help="descriptor of the memory for the turns' times")
    arguments = parser.parse_args()
    stop = stop_requests()
    become_realtime(HUB)
    hub = Hub(arguments.socket, None if arguments.turn_times is None else TurnTimes(arguments.turn_times))
    report_to_parent(READY)
    hub.serve(sys.stdin, stop)
    hub.close()
    report = {} if hub.pacemaker is None else hub.pacemaker.report()
    report_to_parent(json.dumps({"forwarded": hub.forwarded, "dropped": hub.dropped, **report}))


if __name__ == "__main__":
    main()
