"""Prints the fastest Python on PATH of the version of the Python that runs this script, which is the default.

The firmware's tick and lockstep are interpreted. Builds of one version differ in speed: profile-guided
optimisation, as in Debian's build, makes both 10 % faster. `make setup` runs this script before it installs
anything, so the script imports the standard library only.
"""

import os
import subprocess
import sys
from pathlib import Path

PROBE = """
import ensurepip, sys, timeit, venv
from collections import namedtuple
Estimate = namedtuple("Estimate", "x v")
def predict(estimate, dt): return Estimate(estimate.x + estimate.v * dt, 0.9 * estimate.v - estimate.x * dt)
def run():
    estimate = Estimate(1.0, 0.0)
    for _ in range(20000): estimate = predict(estimate, 1e-3)
print(sys.version_info[0], sys.version_info[1], min(timeit.repeat(run, number=1, repeat=9)), sys.executable)
"""
"""The imports that a candidate must support, then a benchmark similar to the firmware's tick."""

WORTHWHILE = 0.95
"""Share of the default's time above which another Python is not faster enough to replace the default."""

PATIENCE_S = 10.0


def probed(python: Path) -> tuple[str, float] | None:
    """The interpreter behind `python` and its time in s; None if it is unusable or of another version."""
    try:
        said = subprocess.run(
            [python, "-I", "-c", PROBE], capture_output=True, text=True, timeout=PATIENCE_S, check=True
        ).stdout
        major, minor, time_s, executable = said.split(maxsplit=3)
        version, taken_s = (int(major), int(minor)), float(time_s)
    except (OSError, subprocess.SubprocessError, ValueError):
        return None
    return (executable.strip(), taken_s) if version == sys.version_info[:2] else None


def main() -> None:
    """Print the path of the interpreter to use, and a note on standard error if it is not the default."""
    names = ("python3", f"python3.{sys.version_info[1]}")
    folders = map(Path, os.get_exec_path())
    others = {(folder / name).resolve() for folder in folders for name in names if (folder / name).is_file()}
    default = Path(sys.executable)
    found = {each: probed(each) for each in [default, *sorted(others - {default.resolve()})]}
    quick = [result for result in found.values() if result is not None]
    best, best_s = min(quick, key=lambda result: result[1], default=(str(default), 1.0))
    own = found[default]
    if own is None or best == own[0] or best_s > WORTHWHILE * own[1]:
        print(default)
        return
    print(
        f"setup: {best} runs what is interpreted {own[1] / best_s:.2f} times as fast as {default}",
        file=sys.stderr,
    )
    print(best)


if __name__ == "__main__":
    main()
