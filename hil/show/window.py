"""Rerun's viewer in a window, on a port that no other user of the machine reaches.

The window takes commands on its port without a password, among them to save, delete and read files. So it
runs in a network namespace of its own (`hil.processes.own_network`), together with who sends it a run.
`python -m hil.show.window LOG [--at S]` shows a log with the cursor at a time.
"""

import argparse
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from hil.processes.child import asked_to_end_with_parent
from hil.record.rrd.rerun_program import RerunError, rerun_environment, rerun_program

LOOPBACK = "127.0.0.1"
WINDOW = "window"
"""In the place of a viewer's address: a window that the live view opens by itself."""
OPENING_S = 20.0
LOOK_S = 0.1
LISTENS = "0A"
"""State of a listening socket in the kernel's tables."""


def in_own_network(command: Sequence[str]) -> list[str]:
    """The command line that runs a command in a network of its own, or refuses."""
    return [sys.executable, "-P", "-m", "hil.processes.own_network", *command]


def viewer_command(*logs: Path, web: bool = False, port: int | None = None) -> list[str]:
    """Command for a viewer of logs; it listens on the loopback interface only, by default on a free port."""
    where = ["--bind", LOOPBACK, "--port", "auto" if port is None else str(port)]
    command = [str(rerun_program()), *map(str, logs), *where]
    return [*command, "--serve-web", "--web-viewer-port", "0"] if web else command


def free_port() -> int:
    """A port of the loopback interface that is not in use."""
    with socket.socket() as taken:
        taken.bind((LOOPBACK, 0))
        return int(taken.getsockname()[1])


def open_window(*logs: Path, stays: bool) -> tuple["subprocess.Popen[bytes]", str]:
    """Open a window, which may stay when this process ends; returns it and its address once it listens."""
    port = free_port()
    viewer = subprocess.Popen(
        viewer_command(*logs, port=port),
        env=rerun_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=stays,
        preexec_fn=None if stays else asked_to_end_with_parent,  # noqa: PLW1509  one system call, no lock
    )
    deadline_s = time.monotonic() + OPENING_S
    while not is_listening(port):
        if viewer.poll() is not None or time.monotonic() > deadline_s:
            viewer.kill()
            raise RerunError(f"the viewer's window did not open within {OPENING_S:g} s")
        time.sleep(LOOK_S)
    return viewer, f"rerun+http://{LOOPBACK}:{port}/proxy"


def is_listening(port: int) -> bool:
    """Whether a process listens on a port of the loopback interface."""
    with socket.socket() as caller:
        caller.settimeout(1.0)
        return caller.connect_ex((LOOPBACK, port)) == 0


def listening_users(port: int) -> Iterator[int]:
    """The users who listen on a port of this machine, as far as it says (Linux)."""
    for table in ("tcp", "tcp6"):
        path = Path("/proc/net") / table
        for line in path.read_text().splitlines()[1:] if path.exists() else ():
            _, local, _, state, _, _, _, user, *_ = line.split()
            if state == LISTENS and int(local.rpartition(":")[2], 16) == port:
                yield int(user)


def put_cursor(url: str, at_s: float, viewer: "subprocess.Popen[bytes]") -> None:
    """Set the time cursor as soon as the viewer has loaded its log; print the time if this fails."""
    from rerun.experimental import ViewerClient  # noqa: PLC0415  takes a second that the window needs not

    deadline_s = time.monotonic() + OPENING_S
    while viewer.poll() is None:
        try:
            ViewerClient.connect(url).set_time("sim_time", duration=at_s, play_state="paused")
            return
        except (ConnectionError, RuntimeError) as error:
            if time.monotonic() > deadline_s:
                print(f"the first failed check is at {at_s:.3f} s ({error})", file=sys.stderr)
                return
            time.sleep(LOOK_S)


def main() -> None:
    """Show a log until the window is closed."""
    parser = argparse.ArgumentParser(description="Show a log in a window.")
    parser.add_argument("log", type=Path)
    parser.add_argument("--at", type=float, help="time of the cursor in s")
    arguments = parser.parse_args()
    viewer, url = open_window(arguments.log, stays=False)
    if arguments.at is not None:
        put_cursor(url, arguments.at, viewer)
    sys.exit(viewer.wait())


if __name__ == "__main__":
    main()
