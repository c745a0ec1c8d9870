"""Prints the quickest Python on PATH of the same version as the one that runs this, which is the default.

The firmware's tick is interpreted, and lockstep with it. Builds of one version differ: one with
profile-guided optimisation, as Debian's is, runs it 10 % faster than one without. Run by `make setup` before
anything is installed, so it is plain Python.
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
"""What a candidate has to be able to do, then what the firmware does all day."""

WORTHWHILE = 0.95
"""Of the default's time: one that is not quicker than that is not worth a surprise."""

PATIENCE_S = 10.0


def probed(python: Path) -> tuple[str, float] | None:
    """The interpreter behind `python` and the time it takes, if it is one of this version that will do."""
    try:
        said = subprocess.run(
            [python, "-c", PROBE], capture_output=True, text=True, timeout=PATIENCE_S, check=True
        ).stdout
        major, minor, time_s, executable = said.split(maxsplit=3)
        version, taken_s = (int(major), int(minor)), float(time_s)
    except (OSError, subprocess.SubprocessError, ValueError):
        return None
    return (executable.strip(), taken_s) if version == sys.version_info[:2] else None


def main() -> None:
    """Print the path of the interpreter to use; say so where it is not the default."""
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
