"""Opening a run in the Rerun viewer, in a window or in a browser, for this machine alone."""

import os
import socket
import subprocess
import sys
import time
import webbrowser
from pathlib import Path

from hil.bench.recorded_run import log_of
from hil.record.rrd.rerun_program import RerunError, rerun_environment, rerun_program
from hil.record.run_folder import VERDICT, read_note
from hil.timing.signals import Interrupted, is_ctrl_c
from tools.logs.quiet_viewer import LOOPBACK, served
from tools.output import BadInputError, progress_console

LIVE_PORT = 9876
"""Port on which Rerun's viewers listen for live runs; Rerun's own default."""
LIVE_URL = f"rerun+http://{LOOPBACK}:{LIVE_PORT}/proxy"
OPENING_S = 20.0


def viewer_command(*logs: Path, web: bool = False, port: str = "auto") -> list[str]:
    """Command for a viewer of logs; it listens on the loopback interface only, by default on a free port."""
    command = [str(rerun_program()), *map(str, logs), "--bind", LOOPBACK, "--port", port]
    return [*command, "--serve-web", "--web-viewer-port", "0"] if web else command


def has_display() -> bool:
    """Whether a window can be opened."""
    return sys.platform != "linux" or bool({"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ))


def view(run: Path | None, web: bool, live: bool) -> None:
    """Open `run`, or a viewer that waits for live runs; return when the window is closed or on Ctrl-C."""
    if live and run is not None:
        raise BadInputError(f"--live waits for runs that are going on; leave out {run}, or leave out --live")
    log = None if live else log_of(run)
    if not web and not has_display():
        raise BadInputError("no display to open a window on; look at it in a browser with --web")
    logs, port = ((), str(LIVE_PORT)) if log is None else ((log,), "auto")
    shown = f"waiting for `vibrohil run --live` at {LIVE_URL}" if log is None else str(log)
    try:
        if web:
            open_in_browser(viewer_command(*logs, web=web, port=port), shown)
            return
        progress_console.print(shown)
        if log is None:
            subprocess.run(viewer_command(port=port), env=rerun_environment(), check=True)
        else:
            open_in_window(log)
    except (Interrupted, KeyboardInterrupt) as error:
        if not is_ctrl_c(error):
            raise
    except subprocess.CalledProcessError as error:
        raise RerunError(f"the viewer ended with status {error.returncode}") from error


def open_in_window(log: Path) -> None:
    """Open a log with the cursor on the first failed check, if any; return when the window is closed."""
    at_s = read_note(log.parent / VERDICT).get("first_failure_s")
    port = free_port()
    command = viewer_command(log, port=str(port))
    with subprocess.Popen(command, env=rerun_environment()) as viewer:
        if isinstance(at_s, float | int):
            put_cursor(f"rerun+http://{LOOPBACK}:{port}/proxy", at_s, viewer)
    if viewer.returncode != 0:
        raise subprocess.CalledProcessError(viewer.returncode, command)


def free_port() -> int:
    """A port of the loopback interface that is not in use."""
    with socket.socket() as taken:
        taken.bind((LOOPBACK, 0))
        return int(taken.getsockname()[1])


def put_cursor(url: str, at_s: float, viewer: subprocess.Popen[bytes]) -> None:
    """Set the time cursor as soon as the viewer has loaded its log; print the time if this fails."""
    from rerun.experimental import ViewerClient

    deadline_s = time.monotonic() + OPENING_S
    while viewer.poll() is None:
        try:
            ViewerClient.connect(url).set_time("sim_time", duration=at_s, play_state="paused")
            return
        except (ConnectionError, RuntimeError) as error:
            if time.monotonic() > deadline_s:
                progress_console.print(f"the first failed check is at {at_s:.3f} s ({error})")
                return
            time.sleep(0.2)


def open_in_browser(command: list[str], shown: str) -> None:
    """Serve the viewer until Ctrl-C, and open it in a browser if there is one."""
    with served(command, rerun_environment()) as (address, process):
        progress_console.print(f"{shown}: at {address} until Ctrl-C", soft_wrap=True)
        webbrowser.open(address)
        process.wait()
    raise subprocess.CalledProcessError(process.returncode, command)


def is_viewer_waiting() -> bool:
    """Whether an open viewer waits for live runs."""
    with socket.socket() as caller:
        caller.settimeout(1.0)
        return caller.connect_ex((LOOPBACK, LIVE_PORT)) == 0


def live_viewer() -> str:
    """The URL of the open viewer; if there is none, open a window, or raise BadInputError without display."""
    if is_viewer_waiting():
        return LIVE_URL
    if not has_display():
        raise BadInputError(
            f"--live: no viewer is open at {LIVE_URL}, and there is no display to open one on; "
            "start `vibrohil view --live --web` in another terminal first"
        )
    viewer = subprocess.Popen(
        viewer_command(port=str(LIVE_PORT)),
        env=rerun_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # the window stays when the run has ended
    )
    deadline_s = time.monotonic() + OPENING_S
    while not is_viewer_waiting():
        if viewer.poll() is not None or time.monotonic() > deadline_s:
            raise RerunError(f"the viewer did not open within {OPENING_S:g} s; try `vibrohil view --live`")
        time.sleep(0.1)
    return LIVE_URL
