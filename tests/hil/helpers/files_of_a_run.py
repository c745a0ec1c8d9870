"""Prints the files of hil and tools through which a run in lockstep passes before its first tick."""

import sys
from pathlib import Path
from types import FrameType
from typing import Any

from tools import cli

ROOT = Path(cli.__file__).parents[1]
OURS = tuple(str(ROOT / package) for package in ("hil", "tools"))
TICKS = {"tick": "lockstep.py", "advance": "compiled.py"}
"""The functions that run the first tick, and their files."""
OPTIMIZED = 0x2
"""Flag of the code of a function; that of a class or a module lacks it."""


def callers(frame: FrameType | None) -> set[str]:
    names = set()
    while frame is not None:
        names.add(frame.f_code.co_name if frame.f_code.co_filename != __file__ else "")
        frame = frame.f_back
    return names


def watch(seen: dict[str, None]) -> None:
    def called(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event != "call" or not code.co_filename.startswith(OURS):
            return
        if not code.co_flags & OPTIMIZED or code.co_name.startswith("<"):
            return
        ticks = TICKS.get(code.co_name) == Path(code.co_filename).name
        if code.co_filename in seen and not ticks:
            return
        names = callers(frame)
        if ticks and "warm_lockstep" not in names:
            sys.setprofile(None)
        if "<module>" not in names:  # an import calls it
            seen[code.co_filename] = None

    sys.setprofile(called)


if __name__ == "__main__":
    found: dict[str, None] = {}
    watch(found)
    cli.run(["run", "soft-start-multistable", "--clock", "lockstep", "--out", sys.argv[1], "--json"])
    print(*(Path(name).relative_to(ROOT) for name in found), sep="\n", file=sys.stderr)
