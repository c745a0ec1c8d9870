"""A private vcan interface for one run, in a network namespace of its own, which ends with its process.

`python -m hil.bus.vcan FOLDER` makes the namespace and the interface and keeps them until its standard input
ends. It prints `ready vcan:FOLDER/vcan`: a Unix socket through which it passes CAN sockets made in that
namespace. A socket stays in the namespace in which it was made, so the nodes need not enter it. No other user
of the machine can make a CAN socket there: the folder is the user's own, and so is the namespace.

All modules are imported before the namespace is entered: an ordinary user enters a user namespace with it,
where files of root's can no longer be read, of a Python in root's folder for example.
"""

import argparse
import selectors
import socket
import sys
from contextlib import suppress
from pathlib import Path

from pyroute2 import IPRoute
from pyroute2.netlink.exceptions import NetlinkError

from hil.bus.can_socket import PRIVATE_INTERFACE, new_can_socket
from hil.processes.child import READY, report_to_parent, stop_requests
from hil.processes.own_network import NetworkError, enter_own_network


class VcanError(RuntimeError):
    """The machine cannot provide a private vcan; the message says why."""


def make_interface(name: str) -> None:
    """Make the vcan interface `name` and bring it up."""
    with IPRoute() as netlink:
        try:
            netlink.link("add", ifname=name, kind="vcan")
            netlink.link("set", index=netlink.link_lookup(ifname=name)[0], state="up")
        except NetlinkError as error:
            raise VcanError(
                f"the kernel makes no vcan interface ({error}); wanted its module vcan"
            ) from error


def remove_interface(name: str) -> None:
    """Remove the interface `name`."""
    with IPRoute() as netlink:
        for index in netlink.link_lookup(ifname=name):
            netlink.link("del", index=index)


def hand_out(listener: socket.socket) -> None:
    """Give the next node that connects a CAN socket of this namespace; it binds the socket itself."""
    link, _ = listener.accept()
    with link, new_can_socket() as can_socket, suppress(ConnectionError):  # the node may have ended
        socket.send_fds(link, [b"1"], [can_socket.fileno()])


def main() -> None:
    """Make the interface, report its address, keep it until standard input ends."""
    parser = argparse.ArgumentParser(description="Holds a private vcan interface.")
    parser.add_argument("folder", type=Path, help="the user's own; for the socket that hands out CAN sockets")
    path: Path = parser.parse_args().folder / "vcan"
    with (
        stop_requests() as stop,
        selectors.DefaultSelector() as selector,
        socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener,
    ):
        selector.register(stop, selectors.EVENT_READ)
        selector.register(sys.stdin, selectors.EVENT_READ)
        try:
            enter_own_network()
            make_interface(PRIVATE_INTERFACE)
        except (NetworkError, VcanError) as error:
            report_to_parent(f"failed {error}")
            return
        listener.bind(str(path))
        listener.listen()
        selector.register(listener, selectors.EVENT_READ)
        report_to_parent(f"{READY} vcan:{path}")
        while all(key.fileobj is listener for key, _ in selector.select()):
            hand_out(listener)
    remove_interface(PRIVATE_INTERFACE)
    path.unlink(missing_ok=True)
    with suppress(OSError):
        path.parent.rmdir()


if __name__ == "__main__":
    main()
