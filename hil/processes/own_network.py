"""A network namespace of its own for a process: what listens in it is reached by no other user.

`python -m hil.processes.own_network COMMAND…` runs a command there, with a loopback interface. Where this
machine makes no namespace, the command runs in the machine's network if no other person uses it, and else is
refused.
This module needs no library, as a process with several threads cannot enter a user namespace.
"""

import ctypes
import fcntl
import os
import socket
import struct
import subprocess
import sys
from pathlib import Path

from hil.processes.child import BAD_INPUT_STATUS
from hil.timing.realtime import libc

CLONE_NEWUSER = 0x10000000
CLONE_NEWNET = 0x40000000
SIOCSIFFLAGS, IFF_UP = 0x8914, 1
FIRST_PERSON = 1000 if sys.platform == "linux" else 500
SERVICES = range(61_184, 65_535)
"""User ids that systemd gives to services, and nobody's; below `FIRST_PERSON` all are the system's."""


class NetworkError(RuntimeError):
    """The machine gives this process no network of its own; the message says why."""


def enter_own_network() -> None:
    """Move this process into a new network namespace; without permission also into a new user namespace."""
    library = libc()
    if library is not None and library.unshare(CLONE_NEWNET) == 0:
        return
    user, group = os.getuid(), os.getgid()
    if library is None or library.unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0:
        raise NetworkError(
            f"this user may make neither a network namespace nor a user namespace "
            f"({os.strerror(ctypes.get_errno())}); wanted root or kernel.unprivileged_userns_clone=1"
        )
    try:
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
        Path("/proc/self/gid_map").write_text(f"{group} {group} 1")
    except OSError as error:
        raise NetworkError(f"this user cannot be named in a user namespace ({error.strerror})") from error


def raise_loopback() -> None:
    """Bring this network's loopback interface up."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
            fcntl.ioctl(any_socket, SIOCSIFFLAGS, struct.pack("16sh22x", b"lo", IFF_UP))
    except OSError as error:
        raise NetworkError(f"its loopback interface cannot be brought up ({error})") from error


def is_display_remote() -> bool:
    """Whether windows are shown through the network, as by `ssh -X`."""
    return "WAYLAND_DISPLAY" not in os.environ and os.environ.get("DISPLAY", ":")[:1] not in (":", "/")


def people() -> set[int]:
    """User ids of the other people whose processes run on this machine; those of services are left out."""
    if Path("/proc/self").exists():
        entries = [entry for entry in Path("/proc").iterdir() if entry.name.isdecimal()]
        users = {entry.stat().st_uid for entry in entries if entry.exists()}
    else:
        listed = subprocess.run(["ps", "-A", "-o", "uid="], capture_output=True, text=True, check=True)
        users = set(map(int, listed.stdout.split()))
    return {one for one in users if one >= FIRST_PERSON and one not in SERVICES} - {os.getuid()}


def refuse_shared_machine(reason: str) -> None:
    """End this process with a sentence if other people use the machine, or may: `/proc` can hide them."""
    is_hidden = Path("/proc/self").exists() and not Path("/proc/1").exists()
    others = people()
    if others or is_hidden:
        who = "other users are hidden" if is_hidden else f"user {min(others)} has processes here"
        sys.stderr.write(
            "error: the viewer's window takes commands that read, write and delete files, from any user of "
            f"this machine ({who}), unless it has a network of its own: {reason}; look at it in a browser "
            "with --web, which takes none\n"
        )
        sys.exit(BAD_INPUT_STATUS)


def main() -> None:
    """Enter the network and run the command in the place of this process."""
    try:
        if is_display_remote():
            raise NetworkError(f"the display {os.environ['DISPLAY']} is reached through the network")
        enter_own_network()
        raise_loopback()
    except NetworkError as error:
        refuse_shared_machine(str(error))
    os.execv(sys.argv[1], sys.argv[1:])


if __name__ == "__main__":
    main()
