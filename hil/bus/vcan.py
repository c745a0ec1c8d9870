"""A private vcan interface for one run; it ends with the process that made it.

`python -m hil.bus.vcan FOLDER` makes the interface and keeps it until its standard input ends. If it has the
permission, it makes the interface in the machine's network namespace and prints `ready socketcan:NAME`.
Otherwise it enters a new user and network namespace, makes the interface there, and prints `ready
vcan:FOLDER/vcan`: a Unix socket through which it passes CAN sockets opened in that namespace. A socket stays
in the namespace in which it was opened, so the nodes need not enter it.
"""

import argparse
import ctypes
import errno
import json
import os
import selectors
import socket
import sys
from contextlib import suppress
from pathlib import Path

from hil.bus.can_socket import open_can_socket
from hil.timing.processes import READY, report_to_parent, stop_requests
from hil.timing.realtime import libc

CLONE_NEWUSER = 0x10000000
CLONE_NEWNET = 0x40000000
REQUEST_BYTES = 1 << 14


class VcanError(RuntimeError):
    """The machine cannot provide a private vcan; the message says why."""


def make_interface(name: str) -> None:
    """Make the vcan interface `name` and bring it up."""
    from pyroute2 import IPRoute  # noqa: PLC0415  nothing else needs netlink
    from pyroute2.netlink.exceptions import NetlinkError  # noqa: PLC0415

    with IPRoute() as netlink:
        try:
            netlink.link("add", ifname=name, kind="vcan")
            netlink.link("set", index=netlink.link_lookup(ifname=name)[0], state="up")
        except NetlinkError as error:
            if error.code == errno.EPERM:
                raise PermissionError(error.code, str(error)) from error
            raise VcanError(
                f"the kernel makes no vcan interface ({error}); wanted its module vcan"
            ) from error


def remove_interface(name: str) -> None:
    """Remove the interface `name`."""
    from pyroute2 import IPRoute  # noqa: PLC0415

    with IPRoute() as netlink:
        for index in netlink.link_lookup(ifname=name):
            netlink.link("del", index=index)


def enter_own_network() -> None:
    """Move this process into a new user namespace, as its root, and a new network namespace."""
    library = libc()
    user, group = os.getuid(), os.getgid()
    if library is None or library.unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0:
        raise VcanError(
            f"this user may neither make a vcan interface nor a user namespace "
            f"({os.strerror(ctypes.get_errno())}); wanted root or kernel.unprivileged_userns_clone=1"
        )
    Path("/proc/self/setgroups").write_text("deny")
    Path("/proc/self/uid_map").write_text(f"0 {user} 1")
    Path("/proc/self/gid_map").write_text(f"0 {group} 1")


def hand_out(listener: socket.socket, interface: str) -> None:
    """Answer one node's request with a CAN socket opened on `interface`."""
    link, _ = listener.accept()
    with link:
        content = link.recv(REQUEST_BYTES)
        if not content:
            return  # the node ended before its request
        request = json.loads(content)
        with open_can_socket(interface, request["accept"], request["stamped"]) as can_socket:
            socket.send_fds(link, [b"1"], [can_socket.fileno()])


def main() -> None:
    """Make the interface, report its address, keep it until standard input ends."""
    parser = argparse.ArgumentParser(description="Holds a private vcan interface.")
    parser.add_argument("folder", type=Path, help="the user's own; for the socket, where one is needed")
    folder: Path = parser.parse_args().folder
    name = f"vibro{os.getpid()}"
    with stop_requests() as stop, selectors.DefaultSelector() as selector:
        selector.register(stop, selectors.EVENT_READ)
        selector.register(sys.stdin, selectors.EVENT_READ)
        try:
            try:
                make_interface(name)
                address = f"socketcan:{name}"
            except PermissionError:
                enter_own_network()
                make_interface(name)
                address = f"vcan:{folder / 'vcan'}"
        except VcanError as error:
            report_to_parent(f"failed {error}")
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
            if address.startswith("vcan:"):
                listener.bind(str(folder / "vcan"))
                listener.listen()
                selector.register(listener, selectors.EVENT_READ)
            report_to_parent(f"{READY} {address}")
            while all(key.fileobj is listener for key, _ in selector.select()):
                hand_out(listener, name)
    remove_interface(name)
    (folder / "vcan").unlink(missing_ok=True)
    with suppress(OSError):
        folder.rmdir()


if __name__ == "__main__":
    main()
