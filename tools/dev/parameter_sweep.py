"""Each tuning parameter at both bounds in every scenario with a fault: no deadline is missed.

    python -m tools.dev.parameter_sweep --out FILE [--pairs N | --monitors] [--seed S] [--runs N] [SCENARIO…]

The runs are in lockstep on the compiled firmware, one by one, singles in an order that the seed shuffles; a
second call continues the first. `--pairs` samples pairs of parameters, each at one of its bounds, instead of
single ones; `--monitors` takes all pairs of those that a conflict or the blocks of safety read, each in a
scenario that the seed chooses. A scenario counts if the firmware with its own parameters latches a fault in
it. The deadline is that of this fault in docs/safety.md, extended by as much as the parameters extend the
fault's own duration, and for a physical fault that develops by a quarter more than with the scenario's own
parameters. It is missed if the motor has a torque later. Parameters that do not fit together are refused, and
a module that they keep at rest has no torque that could end late.
"""

import argparse
import csv
import random
import re
import sys
from collections.abc import Mapping, Sequence
from itertools import combinations, product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from firmware_py.interface.enums import Fault
from firmware_py.interface.modes import LATCHED, MOVING
from firmware_py.interface.parameter_table import TABLE
from firmware_py.shell.parameters import BY_NAME, ParameterError, config_from, values_of
from hil.scenario.files import scenario_names
from hil.scenario.scenario import Scenario, load_scenario
from tools.campaign.run import Run, run
from tools.dev.reactions import attributable

ROW = re.compile(r"^\| (\d+) \| ([A-Z_]+) \| .* \| ([\d.]+) s \|$", re.MULTILINE)
PAGE = Path("docs/safety.md")
DURATIONS = {
    Fault.SENSOR_TIMEOUT: "watchdog.sensor_s",
    Fault.ENCODER_TIMEOUT: "watchdog.encoder_s",
    Fault.DRIVE_TIMEOUT: "watchdog.drive_s",
    Fault.OPERATOR_TIMEOUT: "watchdog.operator_s",
    Fault.DRIVE_ERROR: "watchdog.enable_s",
    Fault.DRIVE_FROZEN: "watchdog.frozen_s",
    Fault.OVERCURRENT: "limit.overcurrent_s",
    Fault.UNDERVOLTAGE: "limit.voltage_s",
    Fault.OVERVOLTAGE: "limit.voltage_s",
    Fault.ESTIMATE_INVALID: "limit.estimate_s",
    Fault.STALL: "limit.stall_s",
    Fault.STOP_FAILED: "start.stop_s",
}
"""The parameter that delays each fault."""
BY_STALL = (Fault.LOAD_IMPLAUSIBLE, Fault.STALL, Fault.RUNAWAY)
"""Faults of a crank that does not follow: a loop that asks for little torque betrays itself as a stall."""
SAFETY = ("gate", "own_crank", "monitors", "consent", "drive_link", "proof")
"""The blocks of `core.config` that limit, watch and stop."""
DRIVEN_N_M, SETTLING_S = 1e-3, 0.01
"""Torque above which the motor is driven, and time in which its current ends after the torque on the bus."""


DEVELOPING = 1.25
"""Allowed time over that with the scenario's own parameters, in which a physical fault develops."""


class Expected(NamedTuple):
    """The fault that a scenario's own parameters latch, and the time from its cause to the last torque, s."""

    fault: Fault
    torque_s: float


class Setting(NamedTuple):
    """The parameters with another value, and the scenario."""

    parameters: str
    scenario: str


class Row(NamedTuple):
    """A run: `verdict` is refused, at rest, in time, or MISSED; `late_ms` after the deadline, if missed."""

    parameters: str
    scenario: str
    verdict: str
    fault: str
    late_ms: str


def deadlines() -> dict[Fault, float]:
    """The deadline of each fault on the page, s."""
    found = ROW.findall(PAGE.read_text(encoding="utf-8"))
    return {
        Fault(int(code)): float(seconds) for code, name, seconds in found if Fault(int(code)).name == name
    }


def deadline_s(fault: Fault, values: Mapping[str, float], page: Mapping[Fault, float]) -> float:
    """The deadline of a fault with these parameters, s."""
    also = BY_STALL if fault in BY_STALL else (fault,)
    return max(
        page[one] + max(values[DURATIONS[one]] - BY_NAME[DURATIONS[one]].default, 0.0)
        if one in DURATIONS
        else page[one]
        for one in also
    )


def latched_in(seen: Run, since: int) -> Fault | None:
    """The first fault that was latched from a tick on."""
    modes = seen.firmware["outputs.mode"][since:]
    faults = seen.firmware["outputs.fault"][since:][np.isin(modes, list(LATCHED))]
    return Fault(int(faults[0])) if faults.size and faults[0] else None


def settings_of(parameters: str) -> list[str]:
    """Several `NAME=VALUE` as settings of a scenario."""
    return [f"firmware.{one}" for one in parameters.split()]


def last_torque_s(seen: Run, since: int) -> float:
    """The time from a tick to the last torque of the motor, s; 0 if there is none."""
    driven = np.flatnonzero(np.abs(seen.true("motor_torque_n_m")[since:]) > DRIVEN_N_M)
    return (int(driven[-1]) + 1) * seen.tick_s if driven.size else 0.0


def judge(setting: Setting, expected: Expected, page: Mapping[Fault, float]) -> Row:
    """Run a setting and judge it."""
    try:
        scenario = load_scenario(setting.scenario, settings_of(setting.parameters))
    except ParameterError:
        return Row(*setting, "refused", "", "")
    seen = run(scenario, 1)
    since = first_tick(scenario)
    found = latched_in(seen, since)
    name = found.name if found else ""
    if seen.firmware["outputs.mode"][max(since - 1, 0)] not in list(MOVING) and not found:
        return Row(*setting, "at rest", name, "")
    values = values_of(scenario.config.p)
    own_s = DEVELOPING * expected.torque_s + deadline_s(expected.fault, values, page) - page[expected.fault]
    latest_s = max(deadline_s(expected.fault, values, page), own_s) + SETTLING_S
    late_s = last_torque_s(seen, since) - latest_s
    if late_s <= 0.0:
        return Row(*setting, "in time", name, "")
    return Row(*setting, "MISSED", name, f"{1e3 * late_s:.0f}")


def first_tick(scenario: Scenario) -> int:
    """The tick of the scenario's first fault."""
    return round(min(fault.at_s for fault in scenario.faults) / scenario.period_s)


def singles() -> list[str]:
    """Each tuning parameter at each of its bounds that is not its default."""
    tuning = [one for one in TABLE if one.is_calibrated]
    return [
        f"{one.name}={bound!r}" for one in tuning for bound in (one.low, one.high) if bound != one.default
    ]


def pairs(number: int, dice: random.Random) -> list[str]:
    """Pairs of different parameters at their bounds."""
    values = singles()
    found: list[str] = []
    while len(found) < number:
        first, second = dice.sample(values, 2)
        if first.split("=")[0] != second.split("=")[0]:
            found.append(f"{first} {second}")
    return found


def is_read_by_safety(setting: str) -> bool:
    """Whether a parameter with this value changes what the blocks of safety read, or is refused."""
    name, value = setting.split("=")
    try:
        config = config_from({name: float(value)})
    except ParameterError:
        return True
    return any(getattr(config, block) != getattr(config_from({}), block) for block in SAFETY)


def pairs_of_safety() -> list[str]:
    """All pairs of the parameters that a conflict or the blocks of safety read, at their bounds."""
    names = {one.split("=")[0] for one in singles() if is_read_by_safety(one)}
    values = [one for one in singles() if one.split("=")[0] in names]
    found = combinations(values, 2)
    return [f"{one} {two}" for one, two in found if one.split("=")[0] != two.split("=")[0]]


def read_rows(path: Path) -> list[Row]:
    """The rows of a data file; none if it does not exist."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [Row(*cells) for cells in csv.reader(file)]


def plan(asked: argparse.Namespace, expected: Sequence[str]) -> list[Setting]:
    """All settings, in the order of the seed."""
    dice = random.Random(asked.seed)
    if asked.pairs or asked.monitors:
        chosen = pairs_of_safety() if asked.monitors else pairs(asked.pairs, dice)
        return [Setting(values, dice.choice(expected)) for values in chosen]
    every = [Setting(*one) for one in product(singles(), expected)]
    dice.shuffle(every)
    return every


def main() -> None:
    """Run what the file lacks, and print the counts and what was missed."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.dev.parameter_sweep",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="SCENARIO", help="all with a fault without")
    parser.add_argument("--out", type=Path, required=True, help="the data file, which is read first")
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--pairs", type=int, default=0, help="number of pairs to sample instead of singles")
    kind.add_argument("--monitors", action="store_true", help="all pairs that a conflict or safety reads")
    parser.add_argument("--seed", type=int, default=1, help="seed of the pairs and of the order")
    parser.add_argument("--runs", type=int, default=1_000_000, help="most runs of this call")
    asked = parser.parse_args()
    page = deadlines()
    expected: dict[str, Expected] = {}
    for name in asked.names or scenario_names():
        scenario = load_scenario(name)
        if attributable(scenario) and scenario.bitrate is None:
            seen, since = run(scenario, 1), first_tick(scenario)
            fault = latched_in(seen, since)
            if fault is not None and fault in page:
                expected[name] = Expected(fault, last_torque_s(seen, since))
    settings = plan(asked, list(expected))
    rows = {Setting(*row[:2]): row for row in read_rows(asked.out)}
    waiting = [one for one in settings if one not in rows][: asked.runs]
    with asked.out.open("a", encoding="utf-8", newline="") as file:
        for number, setting in enumerate(waiting):
            row = rows[setting] = judge(setting, expected[setting.scenario], page)
            csv.writer(file, lineterminator="\n").writerow(row)
            file.flush()
            if row.verdict == "MISSED":
                print(f"{number + 1}/{len(waiting)} {' '.join(row)}", file=sys.stderr, flush=True)
    done = [rows[one] for one in settings if one in rows]
    for verdict in ("refused", "at rest", "in time", "MISSED"):
        print(f"{verdict}: {sum(row.verdict == verdict for row in done)}")
    print(f"of {len(settings)} in {len(expected)} scenarios, {len(done)} done")


if __name__ == "__main__":
    main()
