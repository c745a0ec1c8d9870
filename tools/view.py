"""Opening a run in the Rerun viewer, in a window or in a browser, for this machine alone."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from hil.log_reader import repair
from hil.rerun_log import LOG_NAME, rebuild
from hil.rerun_program import RerunError, rerun_environment, rerun_program
from tools.output import BadInputError, progress_console

RUNS = Path("runs")
LOOPBACK = "127.0.0.1"


def newest_run() -> Path:
    """The run folder that was begun last."""
    begun = sorted(RUNS.glob("*/run.json"), key=lambda path: path.stat().st_mtime)
    if not begun:
        raise BadInputError(
            f"no run in {RUNS}/; make one with `vibrohil run soft-start-multistable`, or name one"
        )
    return begun[-1].parent


def log_of(run: Path | None) -> Path:
    """The log to open: of a folder, a file, or the newest run; whole, whatever was killed.

    A run that has not ended may still be written to; a copy of its log is opened.
    """
    place = newest_run() if run is None else run
    if place.suffix == ".rrd":
        if not place.exists():
            raise BadInputError(f"{place} is not there; name a run folder or an .rrd file")
        repair(place)
        return place
    if not (place / "plant.trace").exists() and not (place / LOG_NAME).exists():
        raise BadInputError(f"{place} is no run folder: it holds neither {LOG_NAME} nor plant.trace")
    log = place / LOG_NAME
    if not log.exists():
        return rebuild(place)
    if not (place / "outcome.json").exists():
        copy = Path(tempfile.mkdtemp(prefix="vibrohil-view-")) / LOG_NAME
        shutil.copyfile(log, copy)
        log = copy
    try:
        repair(log)
    except RerunError:
        return rebuild(place)
    return log


def viewer_command(log: Path, web: bool) -> list[str]:
    """How the viewer is started; it listens on the loopback interface only, on ports that are free."""
    command = [str(rerun_program()), str(log), "--bind", LOOPBACK, "--port", "auto"]
    return [*command, "--web-viewer", "--web-viewer-port", "0"] if web else command


def view(run: Path | None, web: bool) -> None:
    """Open `run`, and stay until the window is closed; a browser's viewer is served until Ctrl-C."""
    log = log_of(run)
    if not web and sys.platform == "linux" and not {"DISPLAY", "WAYLAND_DISPLAY"} & set(os.environ):
        raise BadInputError("no display to open a window on; look at it in a browser with --web")
    progress_console.print(f"{log}: serving until Ctrl-C" if web else str(log), highlight=False)
    try:
        subprocess.run(viewer_command(log, web), env=rerun_environment(), check=True)
    except KeyboardInterrupt:
        return
    except subprocess.CalledProcessError as error:
        raise RerunError(f"the viewer ended with status {error.returncode}") from error
