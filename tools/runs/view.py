"""Opening a run in the Rerun viewer, in a window or in a browser, for this machine alone."""

import os
import subprocess
import sys
import webbrowser
from pathlib import Path

from hil.processes.signals import Interrupted, is_ctrl_c
from hil.record.rrd.rerun_program import RerunError, rerun_environment
from hil.record.run_folder import read_note
from hil.run_files import RunFile
from hil.runs.recorded_run import log_of
from hil.show.window import LOOPBACK, WINDOW, in_own_network, listening_users, viewer_command
from tools.output import EXIT_BAD_INPUT, BadInputError, progress_console
from tools.runs.quiet_viewer import served

LIVE_PORT = 9876
"""Port on which Rerun's viewers listen for live runs; Rerun's own default."""
LIVE_URL = f"rerun+http://{LOOPBACK}:{LIVE_PORT}/proxy"


def has_display() -> bool:
    """Whether a window can be opened."""
    return sys.platform != "linux" or bool({"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ))


def view(run: Path | None, web: bool, live: bool) -> None:
    """Open `run`, or a viewer that waits for live runs; return when the window is closed or on Ctrl-C."""
    if live and run is not None:
        raise BadInputError(f"--live waits for runs that are going on; leave out {run}, or leave out --live")
    if live and not web:
        raise BadInputError(
            "--live waits in a browser; add --web (`vibrohil run --live` opens its own window)"
        )
    log = None if live else log_of(run)
    if not web and not has_display():
        raise BadInputError("no display to open a window on; look at it in a browser with --web")
    try:
        if log is None:
            shown = f"waiting for `vibrohil run --live` at {LIVE_URL}"
            open_in_browser(viewer_command(web=True, port=LIVE_PORT), shown)
        elif web:
            open_in_browser(viewer_command(log, web=True), str(log))
        else:
            progress_console.print(str(log))
            open_in_window(log)
    except (Interrupted, KeyboardInterrupt) as error:
        if not is_ctrl_c(error):
            raise


def open_in_window(log: Path) -> None:
    """Open a log with the cursor on the first failed check, if any; return when the window is closed."""
    at_s = read_note(log.parent / RunFile.VERDICT).get("first_failure_s")
    cursor = ["--at", str(at_s)] if isinstance(at_s, float | int) else []
    command = [sys.executable, "-P", "-m", "hil.show.window", str(log), *cursor]
    ended = subprocess.run(in_own_network(command), stderr=subprocess.PIPE, text=True, check=False)
    if ended.returncode == EXIT_BAD_INPUT:
        raise BadInputError(ended.stderr.strip().removeprefix("error: "))
    if ended.returncode != 0:
        raise RerunError(f"the viewer ended with status {ended.returncode}: {ended.stderr.strip()}")


def open_in_browser(command: list[str], shown: str) -> None:
    """Serve the viewer until Ctrl-C, and open it in a browser if there is one."""
    with served(command, rerun_environment()) as (address, process):
        progress_console.print(f"{shown}: at {address} until Ctrl-C", soft_wrap=True)
        webbrowser.open(address)
        process.wait()
    raise RerunError(f"the viewer ended with status {process.returncode}")


def is_viewer_waiting() -> bool:
    """Whether a viewer of this user waits for live runs; BadInputError if its port is of another user."""
    users = set(listening_users(LIVE_PORT))
    if users - {os.geteuid()}:
        raise BadInputError(
            f"--live: port {LIVE_PORT}, where a viewer would wait, belongs to another user; nothing is sent"
        )
    return bool(users)


def live_viewer(*, may_open: bool) -> str:
    """Where to show a run: the viewer that waits in a browser, else a window if one may be opened."""
    if is_viewer_waiting():
        return LIVE_URL
    if not may_open or not has_display():
        lacks = ", and there is no display to open one on" if may_open else ""
        raise BadInputError(
            f"--live: no viewer is open at {LIVE_URL}{lacks}; "
            "start `vibrohil view --live --web` in another terminal first"
        )
    return WINDOW
