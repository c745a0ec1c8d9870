"""Reaction times by frames on the bus: fault → torque 0 → IDLE → the drive's heartbeat reports idle.

    python -m tools.dev.reactions --seeds 20 [SCENARIO…]

Runs scenarios in lockstep on the compiled firmware, two at a time, each with several seeds, which also change
the time of the fault. Prints the longest of each reaction time for every scenario and fault that the firmware
latched, as in docs/data/reactions.csv, and the longest of each fault, as in docs/safety.md.
The times count from the beginning of the scenario's first fault; IDLE counts only after the last torque other
than 0.
"""

import argparse
import math
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from firmware_py.interface.enums import AxisState, Fault
from firmware_py.interface.generated.records import (
    DriveHeartbeat,
    FirmwareHeartbeat,
    SetAxisState,
    SetInputTorque,
)
from firmware_py.interface.modes import LATCHED
from hil.faults.kinds.flood import Flood
from hil.processes import workers
from hil.record.bus_reconstruction import frames_of
from hil.record.candump import BusLog
from hil.record.run_traces import read_bus
from hil.run_files import RunFile
from hil.runs.job import Job
from hil.runs.recording import record
from hil.scenario.scenario import Scenario
from hil.suite.suite import PROCESSES, Case, cases_of, scenarios_for
from plant_sim.arrays import FloatArray


class Reaction(NamedTuple):
    """Time in s from the fault to each step; infinite if the run ends before the step."""

    torque_zero_s: float
    idle_sent_s: float
    idle_confirmed_s: float


def times_of(bus: BusLog, record: type, signal: str, value: float) -> tuple[FloatArray, FloatArray]:
    """The times of the frames of a kind whose signal has this value, and of the others."""
    found = frames_of(bus, record)
    has_it = found.signals[:, found.record._fields.index(signal)] == value
    return found.t_s[has_it], found.t_s[~has_it]


def first_s(times_s: FloatArray, since_s: float) -> float:
    """The first of some times from `since_s` on; infinite without one."""
    return float(np.min(times_s[times_s >= since_s], initial=math.inf))


def reaction(bus: BusLog, fault_s: float) -> Reaction:
    """The reaction of a run to the fault at `fault_s`, by the frames on its bus."""
    zero_s, torque_s = times_of(bus, SetInputTorque, "torque_n_m", 0.0)
    off_s = first_s(zero_s, float(np.max(torque_s, initial=fault_s)))
    idle_s = first_s(times_of(bus, SetAxisState, "requested_state", AxisState.IDLE)[0], off_s)
    reported_s = times_of(bus, DriveHeartbeat, "axis_state", AxisState.IDLE)[0]
    confirmed_s = first_s(reported_s[reported_s > idle_s], idle_s)
    return Reaction(off_s - fault_s, idle_s - fault_s, confirmed_s - fault_s)


def find_latched(bus: BusLog) -> Fault | None:
    """The first latched fault according to the firmware's heartbeat; None without one."""
    beats = (FirmwareHeartbeat(*signals) for signals in frames_of(bus, FirmwareHeartbeat).signals)
    return next((Fault(int(beat.fault)) for beat in beats if beat.mode in LATCHED and beat.fault), None)


def run_case(case: Case) -> tuple[Fault | None, Reaction]:
    """Run a case; return the latched fault, None without one, and the reaction times."""
    case.run_dir.mkdir(parents=True)
    record(Job(case.scenario, case.seed, folder=case.run_dir))
    bus = read_bus(case.run_dir / RunFile.CAN_LOG)
    shutil.rmtree(case.run_dir)
    return find_latched(bus), reaction(bus, min(fault.at_s for fault in case.scenario.faults))


def worst(reactions: Sequence[Reaction]) -> Reaction:
    """The longest of each time."""
    return Reaction(*(max(times) for times in zip(*reactions, strict=True)))


def text_of(time_s: float) -> str:
    """A time as text; `never` if the step is missing, e.g. because the drive sends nothing any more."""
    return f"{1000.0 * time_s:.0f} ms" if math.isfinite(time_s) else "never"


def cells(found: dict[tuple[Fault, str], list[Reaction]]) -> str:
    """The text of the data file: the longest times in ms of each fault and scenario; empty for never."""
    lines = ["fault,scenario,runs,torque_zero_ms,idle_sent_ms,idle_confirmed_ms"]
    for fault, name in sorted(found):
        longest = (
            f"{1e3 * time_s:.0f}" if math.isfinite(time_s) else "" for time_s in worst(found[fault, name])
        )
        lines.append(",".join((fault.name, name, str(len(found[fault, name])), *longest)))
    return "\n".join(lines) + "\n"


def markdown(found: dict[tuple[Fault, str], list[Reaction]]) -> str:
    """The table of docs/safety.md: the longest times of each fault; `found` by fault and scenario."""
    lines = [
        "| fault latched | scenarios | runs | torque 0 | IDLE sent | idle confirmed |",
        "|---|---:|---:|---|---|---|",
    ]
    for fault in sorted({fault for fault, _ in found}):
        of_fault = [reactions for (latched_fault, _), reactions in found.items() if latched_fault == fault]
        times = " | ".join(map(longest_of, zip(*map(worst, of_fault), strict=True)))
        lines.append(f"| {fault.name} | {len(of_fault)} | {sum(map(len, of_fault))} | {times} |")
    return "\n".join(lines)


def longest_of(times_s: Sequence[float]) -> str:
    """The longest finite time of several scenarios as text, and how many of them never come to the step."""
    finite_s = [time_s for time_s in times_s if math.isfinite(time_s)]
    never = len(times_s) - len(finite_s)
    texts = [text_of(max(finite_s))] if finite_s else []
    return ", ".join([*texts, f"never in {never}"] if never else texts)


def attributable(scenario: Scenario) -> bool:
    """Whether a scenario has a fault and its frames reveal their senders: a flood uses all identifiers."""
    return bool(scenario.faults) and not any(isinstance(fault, Flood) for fault in scenario.faults)


def main() -> None:
    """Run the scenarios of the command line and print their times."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.dev.reactions",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="SCENARIO", help="all with a fault without")
    parser.add_argument("--seeds", type=int, default=20, help="runs of each scenario (default 20)")
    asked = parser.parse_args()
    scenarios, _ = scenarios_for(asked.names, "lockstep")
    found: dict[tuple[Fault, str], list[Reaction]] = {}
    with tempfile.TemporaryDirectory() as folder:
        cases = cases_of(list(filter(attributable, scenarios)), range(1, asked.seeds + 1), Path(folder))
        for case, found_in in workers.results(run_case, cases, PROCESSES):
            name = case.scenario.name
            if isinstance(found_in, workers.Died):
                raise SystemExit(f"{name}, seed {case.seed}: its process {found_in.how}")
            fault, times = found_in
            what = "no fault" if fault is None else fault.name
            print(f"{name}, seed {case.seed}: {what}: {', '.join(map(text_of, times))}", file=sys.stderr)
            if fault is not None:
                found.setdefault((fault, name), []).append(times)
    print(cells(found), markdown(found), sep="\n")


if __name__ == "__main__":
    main()
