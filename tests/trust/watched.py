"""`python -P watched.py FOLDER CACHE`: reads each case below FOLDER by several commands, and reports them.

A case is a folder of somebody else: with a file `log.*` a log, with `mine.toml` a scenario, else a run
folder, which is compared with the folder `as-it-was` beside it. An audit hook sees every file that is opened
to write, every process and every connection. Only the case's folder, the caches and temporary folders may be
written. Each command reports one JSON object on a line of standard output.
"""

import contextlib
import gc
import io
import json
import os
import re
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tools import cli

LIMIT_S = 20.0
"""Of computing time, so that a busy machine changes nothing."""
LIMIT_OF_WAITING_S = 300
"""For a command that waits for a pipe, without computing."""
WRITE_FLAGS = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
PROGRAMS = ("git", "rerun")
"""Programs that an inspection may start: for the commit, and to mend a log."""
CHANGES = (
    "os.remove",
    "os.rename",
    "os.rmdir",
    "os.mkdir",
    "os.link",
    "os.symlink",
    "os.truncate",
    "os.chmod",
)
STARTS = ("os.system", "os.exec", "os.fork", "pty.spawn")
NAMED_STARTS = ("subprocess.Popen", "os.posix_spawn")
"""From Python 3.13 on, subprocess.Popen may start a program by os.posix_spawn."""


class Watch:
    """What happens beyond the allowed folders."""

    def __init__(self, caches: list[str]) -> None:
        own = ("/dev/null", "/dev/tty", f"/proc/{os.getpid()}/clear_refs")
        self.allowed = [*caches, *own, f"{tempfile.gettempdir()}/vibrohil-view-"]
        self.folder = ""
        self.harm: list[str] = []

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            path, _, flags = arguments
            if isinstance(path, str | bytes) and (flags or 0) & WRITE_FLAGS:
                self.refuse_elsewhere(os.path.realpath(os.fsdecode(path)), event)
        elif event in CHANGES and isinstance(arguments[0], str | bytes):
            folder, name = os.path.split(os.fsdecode(arguments[0]))
            self.refuse_elsewhere(os.path.join(os.path.realpath(folder), name), event)
        elif event in STARTS:
            self.harm.append(f"{event} {arguments}")
        elif event in NAMED_STARTS and os.path.basename(str(arguments[0])) not in PROGRAMS:
            self.harm.append(f"{event} {arguments[:2]}")
        elif event == "socket.connect" and arguments[1][0] not in ("127.0.0.1", "::1"):
            self.harm.append(f"{event} {arguments[1]}")

    def refuse_elsewhere(self, path: str, event: str) -> None:
        above_a_cache = event == "os.mkdir" and any(cache.startswith(path) for cache in self.allowed)
        if not f"{path}/".startswith((self.folder, *self.allowed)) and not above_a_cache:
            self.harm.append(f"{event} {path}")


def peak_bytes() -> int:
    """Return the most memory that this process held; getrusage would count its parent's as well."""
    return 1024 * int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])


READERS = (
    (["inspect"], ""),
    (["replay"], r"as-it-was|can\.log|scenario|run\.json|note|clock|period|in-the-shared-memory"),
    (["runs"], r"as-it-was|verdict|outcome|run\.json|note|name|types"),
    (["export", "--to", "mcap"], r"as-it-was|frames|run\.rrd|trace|start|in-the-shared-memory"),
)
"""Commands that read a run folder, each with the cases, by their names, that spoil what it reads."""
TIMES = r"time|minutes|1e400|garbage"
"""Names of the logs that can be read, or that err in their times: `replay` reads these as `import` does."""


def commands_for(case: Path) -> list[list[str]]:
    """Return the commands that read what is hostile in a case."""
    out = str(case / "run")
    if logs := list(case.glob("log.*")):
        log = str(logs[0])
        commands = [["import", log, "--out", out, "--tolerant"]]
        commands += [["replay", log]] if re.search(TIMES, case.name) else []
    elif (scenario := case / "mine.toml").exists():
        text = str(scenario)
        return [
            ["list", "--show", text],
            ["run", text, "--clock", "lockstep", "--out", out, "--json"],
        ]
    else:
        commands = [[*command, str(case)] for command, reads in READERS if re.search(reads, case.name)]
        if case.name.startswith("run.rrd-"):
            commands += [["inspect", str(case / "run.rrd")]]
            commands += [["compare", str(case), str(case.parent / "as-it-was")]]
    return [[*command, "--json"] for command in commands]


def run_limited(command: Sequence[str]) -> dict[str, Any]:
    """Run a command and return its status, its errors, and its time and memory.

    Beyond a limit of time a signal ends this process.
    """
    gc.collect()  # what earlier commands left to the collector, more on Python 3.13, is not of this one
    gc.freeze()  # and the collector need not look again at what is left, most of it modules
    Path("/proc/self/clear_refs").write_text("5")  # the peak is of this command
    signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
    signal.alarm(LIMIT_OF_WAITING_S)
    begun_s, errors = time.process_time(), io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(errors):
        status = cli.run(command)
    signal.alarm(0)
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    return {
        "status": status,
        "error": errors.getvalue()[-2000:],
        "took_s": time.process_time() - begun_s,
        "most_bytes": peak_bytes(),
    }


def main() -> None:
    """Read each case, and report it."""
    root, cache = Path(sys.argv[1]), sys.argv[2]
    watch = Watch([cache, os.environ["XDG_CACHE_HOME"]])
    sys.addaudithook(watch)
    for case, command in ((one, each) for one in sorted(root.iterdir()) for each in commands_for(one)):
        sys.stdout.write(f"{case.name}\t{command[0]}\t")
        sys.stdout.flush()
        watch.folder, watch.harm = f"{os.path.realpath(case)}/", []
        reported = run_limited(command)
        reported |= {"harm": watch.harm, "left": sorted(one.name for one in case.iterdir())}
        sys.stdout.write(json.dumps(reported) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
