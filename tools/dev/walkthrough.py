"""Reactions to every kind of fault of every sensor channel: a walk through the kinds.

    python -m tools.dev.walkthrough --out docs/data/sensor-faults.csv

Each channel is stuck, frozen (its frame), 0, at its end, drifting, swapped or of the wrong sign, at four
ratios, in the start, in the hold and in the stop. The runs are in lockstep on the compiled firmware, one by
one; a second call continues the first. A row of the file is a run: the fault that was latched, the time from
the sensor's fault to the final torque 0, and the largest force after it. Prints the table of docs/safety.md.
"""

import argparse
import csv
import math
import sys
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from firmware_py.interface.enums import Fault
from firmware_py.interface.modes import LATCHED
from hil.scenario.scenario import Scenario, check_scenario
from plant_sim.scene import read_scene
from tools.campaign.run import Run, run

RATIOS = (0.2, 0.5, 1.0, 1.4)
RUN_S, HELD_S, AFTER_S = 0.5, 9.0, 4.0
PHASES = {"start": 1.2, "hold": HELD_S, "stop": HELD_S + 0.2}
"""Time of the fault in each phase, s; RUN is requested at `RUN_S`, in the phase `stop` IDLE at `HELD_S`."""
ACCELEROMETERS = ("striker-low", "striker-high", "housing")
BEYOND_M_S2 = 3000.0
STEP_MS = 10
"""Resolution of the times on the page, to which they are rounded up."""
DRIFTS = {"encoder": 0.2} | dict.fromkeys(ACCELEROMETERS, 5.0)
"""Rates of a drift per s: in rad, and in m/s²."""


class Trial(NamedTuple):
    """A kind of fault of a channel, in a phase of a run at a ratio."""

    channel: str
    kind: str
    ratio: float
    phase: str


class Row(NamedTuple):
    """A trial's result. `torque_zero_ms`: empty if the torque does not end for good because of a fault."""

    channel: str
    kind: str
    ratio: str
    phase: str
    fault: str
    torque_zero_ms: str
    peak_force_n: str


def faults_of(channel: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """The kinds of a channel, each with the fault's table."""
    yield "stuck", {"kind": "sensor-stuck", "sensor": channel}
    yield "zero", {"kind": "sensor-intermittent", "sensor": channel, "share": 1.0}
    if channel in ACCELEROMETERS:
        yield "rail", {"kind": "sensor-biased", "sensor": channel, "bias": BEYOND_M_S2}
    yield "drift", {"kind": "sensor-drifting", "sensor": channel, "rate": DRIFTS[channel]}
    yield "sign", {"kind": "sensor-wrong-sign", "sensor": channel}


def all_faults() -> dict[tuple[str, str], dict[str, Any]]:
    """The fault's table of every channel and kind."""
    found = {(channel, kind): table for channel in DRIFTS for kind, table in faults_of(channel)}
    for first, second in (("low", "high"), ("low", "housing"), ("high", "housing")):
        names = [one if one == "housing" else f"striker-{one}" for one in (first, second)]
        found[f"{names[0]} and {second}", "swapped"] = {"kind": "sensor-swapped", "sensors": names}
    found["both ranges", "stuck"] = {"kind": "sensor-stuck", "sensor": "striker"}
    found["both ranges", "sign"] = {"kind": "sensor-wrong-sign", "sensor": "striker"}
    found["accelerometer", "frozen frame"] = {"kind": "frozen", "frames": ["Accelerometer"]}
    found["encoder", "frozen frame"] = {"kind": "frozen", "frames": ["EncoderEstimates"]}
    return found


FAULTS = all_faults()
TRIALS = [
    Trial(channel, kind, ratio, phase) for (channel, kind), ratio, phase in product(FAULTS, RATIOS, PHASES)
]


def scenario_of(trial: Trial) -> Scenario:
    """The trial as a scenario: a quick start of the default module, its fault, the operator's commands."""
    at_s = PHASES[trial.phase]
    commands = [{"at_s": RUN_S, "request": "run", "target_ratio": trial.ratio}]
    if trial.phase == "stop":
        commands.append({"at_s": HELD_S, "request": "idle"})
    document: dict[str, Any] = {
        "title": f"{trial.channel}: {trial.kind}",
        "scene": read_scene("table1-motor-soft"),
        "checks": [],
        "firmware": {"start": {"rise_s": 2.0}},
        "script": {
            "duration_s": at_s + AFTER_S,
            "commands": commands,
            "faults": [FAULTS[trial.channel, trial.kind] | {"at_s": at_s}],
        },
    }
    return check_scenario(document, "-".join(map(str, trial)).replace(" ", "-"))


def judge(trial: Trial, seen: Run) -> Row:
    """The row of a run."""
    since = round(PHASES[trial.phase] / seen.tick_s)
    modes, faults = seen.firmware["outputs.mode"][since:], seen.firmware["outputs.fault"][since:]
    latched = np.flatnonzero(np.isin(modes, list(LATCHED)))
    force_n = float(np.max(np.abs(seen.true("stop_force_n")[since:]), initial=0.0))
    fault, zero_ms = "", ""
    if latched.size:
        fault = Fault(int(faults[latched[0]])).name
        driven = np.flatnonzero(seen.firmware["outputs.torque_n_m"][since:])
        zero_ms = f"{1e3 * seen.tick_s * (driven[-1] + 1 if driven.size else 0):.0f}"
    return Row(trial.channel, trial.kind, f"{trial.ratio:g}", trial.phase, fault, zero_ms, f"{force_n:.0f}")


def read_rows(path: Path) -> list[Row]:
    """The rows of a data file; none if it does not exist."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [Row(*cells) for cells in list(csv.reader(file))[1:]]


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """Write a data file."""
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([Row._fields, *rows])


def reaction_of(rows: Sequence[Row]) -> tuple[str, str]:
    """The longest time to torque 0 of each fault that was latched, rounded up, and the ratios without one."""
    longest: dict[str, int] = {}
    for row in rows:
        if row.fault:
            longest[row.fault] = max(longest.get(row.fault, 0), int(row.torque_zero_ms))
    times = (
        f"{fault} {STEP_MS * math.ceil(time_ms / STEP_MS)} ms" for fault, time_ms in sorted(longest.items())
    )
    silent = [row.ratio for row in rows if not row.fault]
    ratios = sorted({ratio: silent.count(ratio) for ratio in silent}.items())
    without = ", ".join(ratio if runs == len(PHASES) else f"{ratio} ({runs} of 3)" for ratio, runs in ratios)
    return ", ".join(times) or "none", without or "—"


def markdown(rows: Sequence[Row]) -> str:
    """The table of docs/safety.md: channels with the same reaction to a kind share a row."""
    of_kind: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        of_kind.setdefault((row.kind, row.channel), []).append(row)
    channels: dict[tuple[str, str, str], list[str]] = {}
    for (kind, channel), own in sorted(of_kind.items()):
        channels.setdefault((kind, *reaction_of(own)), []).append(channel)
    lines = ["| fault | channels | reaction, longest time | none at r = |", "|---|---|---|---|"]
    lines += [
        f"| {kind} | {'; '.join(own)} | {found} | {silent} |"
        for (kind, found, silent), own in channels.items()
    ]
    return "\n".join(lines)


def main() -> None:
    """Run the trials that the file lacks, and print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.dev.walkthrough",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--out", type=Path, required=True, help="the data file, which is read first")
    asked = parser.parse_args()
    known = {row[:4]: row for row in read_rows(asked.out)}
    for number, trial in enumerate(TRIALS):
        key = (trial.channel, trial.kind, f"{trial.ratio:g}", trial.phase)
        if key not in known:
            known[key] = judge(trial, run(scenario_of(trial), 1))
            print(f"{number + 1}/{len(TRIALS)} {' '.join(known[key])}", file=sys.stderr, flush=True)
            write_rows(asked.out, [known[one] for one in sorted(known)])
    print(markdown([known[trial.channel, trial.kind, f"{trial.ratio:g}", trial.phase] for trial in TRIALS]))


if __name__ == "__main__":
    main()
