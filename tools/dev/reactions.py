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
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError
from firmware_py.interface.enums import LATCHED, AxisState, Fault
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import (
    DriveHeartbeat,
    FirmwareHeartbeat,
    SetAxisState,
    SetInputTorque,
)
from hil.bench import workers
from hil.bench.lockstep import run_lockstep, silent
from hil.faults.kinds.flood import Flood
from hil.record.run_traces import read_bus
from hil.scenario.scenario import Scenario
from hil.suite.suite import PROCESSES, Case, cases_of, scenarios_for

IDLE = SetAxisState(AxisState.IDLE)
WATCHED = [
    message.can_id
    for message in (
        codec.SET_INPUT_TORQUE,
        codec.SET_AXIS_STATE,
        codec.DRIVE_HEARTBEAT,
        codec.FIRMWARE_HEARTBEAT,
    )
]
"""The evaluated identifiers."""


class Reaction(NamedTuple):
    """Time in s from the fault to each step; infinite if the run ends before the step."""

    torque_zero_s: float
    idle_sent_s: float
    idle_confirmed_s: float


def records(log: Path) -> Iterator[tuple[float, Any]]:
    """The time in s and the record of every evaluated frame in `log`; undecodable frames are left out."""
    bus = read_bus(log)
    rows = np.flatnonzero(np.isin(bus.can_id, WATCHED))
    for row, data in zip(rows.tolist(), bus.payloads_of(rows), strict=True):
        with suppress(FrameError):
            yield float(bus.t_s[row]), codec.decode(Frame(int(bus.can_id[row]), data))


def reaction(sent: Iterable[tuple[float, Any]], fault_s: float) -> Reaction:
    """The reaction of a run to the fault at `fault_s`, by the frames on its bus."""
    torque_s = idle_s = confirmed_s = math.inf
    for t_s, record in sent:
        if t_s < fault_s:
            continue
        if isinstance(record, SetInputTorque):
            if record.torque_n_m != 0.0:
                torque_s = idle_s = confirmed_s = math.inf
            torque_s = min(torque_s, t_s if record.torque_n_m == 0.0 else math.inf)
        elif record == IDLE and math.isfinite(torque_s):
            idle_s = min(idle_s, t_s)
        elif isinstance(record, DriveHeartbeat) and record.axis_state == AxisState.IDLE and t_s > idle_s:
            confirmed_s = min(confirmed_s, t_s)
    return Reaction(torque_s - fault_s, idle_s - fault_s, confirmed_s - fault_s)


def latched(sent: Iterable[tuple[float, Any]]) -> Fault | None:
    """The first latched fault according to the firmware's heartbeat; None without one."""
    beats = (record for _, record in sent if isinstance(record, FirmwareHeartbeat))
    return next((Fault(beat.fault) for beat in beats if beat.mode in LATCHED and beat.fault), None)


def reacted(case: Case) -> tuple[Fault | None, Reaction]:
    """Run a case; return the latched fault, None without one, and the reaction times."""
    case.run_dir.mkdir(parents=True)
    run_lockstep(case.scenario, case.run_dir, case.seed, silent, "compiled")
    sent = list(records(case.run_dir / "can.log"))
    shutil.rmtree(case.run_dir)
    fault_s = min(fault.at_s for fault in case.scenario.faults)
    return latched(sent), reaction(sent, fault_s)


def worst(reactions: Sequence[Reaction]) -> Reaction:
    """The longest of each time."""
    return Reaction(*(max(times) for times in zip(*reactions, strict=True)))


def shown(time_s: float) -> str:
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
    texts = [shown(max(finite_s))] if finite_s else []
    return ", ".join([*texts, f"never in {never}"] if never else texts)


def attributable(scenario: Scenario) -> bool:
    """Whether a scenario has a fault and its frames reveal their senders: a flood uses all identifiers."""
    return bool(scenario.faults) and not any(isinstance(fault, Flood) for fault in scenario.faults)


def main() -> None:
    """Run the scenarios of the command line and print their times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="SCENARIO", help="all with a fault without")
    parser.add_argument("--seeds", type=int, default=20, help="runs of each scenario (default 20)")
    asked = parser.parse_args()
    scenarios, _ = scenarios_for(asked.names, "lockstep")
    found: dict[tuple[Fault, str], list[Reaction]] = {}
    with tempfile.TemporaryDirectory() as folder:
        cases = cases_of(list(filter(attributable, scenarios)), range(1, asked.seeds + 1), Path(folder))
        for case, found_in in workers.results(reacted, cases, PROCESSES):
            name = case.scenario.name
            if isinstance(found_in, workers.Died):
                raise SystemExit(f"{name}, seed {case.seed}: its process {found_in.how}")
            fault, times = found_in
            what = "no fault" if fault is None else fault.name
            print(f"{name}, seed {case.seed}: {what}: {', '.join(map(shown, times))}", file=sys.stderr)
            if fault is not None:
                found.setdefault((fault, name), []).append(times)
    print(cells(found), markdown(found), sep="\n")


if __name__ == "__main__":
    main()
