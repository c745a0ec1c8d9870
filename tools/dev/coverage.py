"""`python -m tools.dev.coverage [NAME…]`: the branches of the firmware that no scenario reaches.

Each scenario runs in lockstep on the interpreted firmware. The program prints the branches of
`firmware_py/core` and `firmware_py/node` that no scenario takes. Without names: all scenarios.
"""

import argparse
import json
import os
import tempfile
from collections.abc import Iterator
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import coverage

from hil.bench.workers import Workers, alive

FIRMWARE = Path(__file__).parents[2] / "firmware_py"
INCLUDED = [str(FIRMWARE / room / "*") for room in ("core", "node")]

_measuring: list[coverage.Coverage] = []
"""The measurement of a worker process; empty in the main process."""


class Branch(NamedTuple):
    """A branch that was never taken; `to_line` is negative if it leaves the function."""

    path: Path
    line: int
    to_line: int

    def __str__(self) -> str:
        source = self.path.read_text(encoding="utf-8").splitlines()[self.line - 1].strip()
        to = f"line {self.to_line}" if self.to_line > 0 else "the end"
        return f"{self.path.relative_to(FIRMWARE.parent)}:{self.line}: never to {to}: {source}"


def measured(data_file: str) -> None:
    """Start the measurement in this process, before the firmware is imported."""
    one = coverage.Coverage(data_file=data_file, data_suffix=True, branch=True, include=INCLUDED)
    one.start()
    _measuring.append(one)


def run(name: str) -> None:
    """Run a scenario and save its coverage."""
    from hil.bench.lockstep import run_lockstep
    from hil.scenario.scenario import load_scenario

    with tempfile.TemporaryDirectory() as folder:
        run_lockstep(load_scenario(name), Path(folder), 1, lambda *_: None)
    for one in _measuring:
        one.stop()
        one.save()
        one.start()


def missed(report: Any) -> Iterator[Branch]:
    """The branches that were never taken according to coverage's JSON report."""
    for path, found in sorted(report["files"].items()):
        for line, to_line in found["missing_branches"]:
            yield Branch(Path(path).resolve(), line, to_line)


def main() -> None:
    """Run the scenarios and print the branches that none of them takes."""
    from hil.scenario.scenario import scenario_names

    parser = argparse.ArgumentParser(prog="python -m tools.dev.coverage", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    names = parser.parse_args().names or scenario_names()
    with tempfile.TemporaryDirectory() as folder:
        data_file = str(Path(folder) / "data")
        this = import_module("tools.dev.coverage")  # workers import their functions from this module
        with Workers(this.run, os.cpu_count() or 1, partial(this.measured, data_file)) as processes:
            for done, (name, ended) in enumerate(processes.results(names), 1):
                alive(ended)
                print(f"{done} of {len(names)}: {name}", flush=True)
        all_runs = coverage.Coverage(data_file=data_file, branch=True, include=INCLUDED)
        all_runs.combine([folder])
        all_runs.json_report(outfile=f"{folder}/report.json")
        report = json.loads(Path(folder, "report.json").read_text(encoding="utf-8"))
    for branch in missed(report):
        print(branch)
    totals = report["totals"]
    print(
        f"{totals['covered_branches']} of {totals['num_branches']} branches reached by {len(names)} scenarios"
    )


if __name__ == "__main__":
    main()
