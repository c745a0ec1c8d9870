"""A trial as a scenario: a sampled module, the operator's commands and the disturbances.

`vibrohil run` repeats the trial bit for bit and records all signals.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from firmware_py.shell.builds import Build
from hil.scenario.operator import Command, Request
from hil.scenario.scenario import Scenario, check_scenario
from tools.campaign.trial.cells import Cell
from tools.campaign.trial.sampling import Sampled, mismatch_of, sample
from tools.campaign.trial.walk_cells import WalkCell, sampled_walk

CLEAR_S, IDLE_S, RUN_S = 1.0, 1.3, 1.6
"""Times of the commands, s: CLEAR_FAULTS, as a moving striker may cause faults at power-up; IDLE; RUN."""
WALK_RUN_S = 0.5
"""Time of the command RUN in a walk, s; it can be early because the striker starts at rest."""
SETTLED_S = RUN_S + 15.0
"""Time from which a hold is judged and a kick may occur, s."""

TICK_S = 1e-3
"""The firmware's period in every trial."""


class Plan(NamedTuple):
    """What the trials of a campaign have in common."""

    campaign: str
    cells: Sequence[Cell]
    numbers: Mapping[str, Any]
    seed: int
    firmware: Build = "compiled"

    def cell_of(self, trial: int) -> Cell:
        """Return the cell of the trial with this number: all cells take turns."""
        return self.cells[trial % len(self.cells)]


class Trial(NamedTuple):
    """A sampled module and its scenario."""

    cell: Cell
    sampled: Sampled
    scenario: Scenario

    @property
    def omega_rad_s(self) -> float:
        """Crank speed that the operator requests."""
        return self.scenario.commands[-1].target_ratio * self.scenario.config.d.natural_rad_s


def script(cell: Cell) -> list[Command]:
    """Return the operator's commands in a trial."""
    if isinstance(cell, WalkCell):
        return [Command(0.0, Request.IDLE, 0.0), Command(WALK_RUN_S, Request.RUN, cell.ratio)]
    return [
        Command(0.0, Request.IDLE, 0.0),
        Command(CLEAR_S, Request.CLEAR_FAULTS, 0.0),
        Command(IDLE_S, Request.IDLE, 0.0),
        Command(RUN_S, Request.RUN, cell.ratio, cell.impulse_n_s),
    ]


def scenario_of(
    name: str,
    scene: Mapping[str, Any],
    firmware: Mapping[str, Any],
    commands: Sequence[Command],
    duration_s: float,
    seed: int,
    faults: Sequence[Mapping[str, Any]] = (),
) -> Scenario:
    """Return the checked scenario with this scene, parameters and script."""
    lines = []
    for command in commands:
        line: dict[str, Any] = {"at_s": command.at_s, "request": command.request.value}
        if command.request is Request.RUN:
            line["target_ratio"] = command.target_ratio
        if command.target_impulse_n_s > 0.0:
            line["target_impulse_n_s"] = command.target_impulse_n_s
        lines.append(line)
    script = {"duration_s": duration_s, "commands": lines, "faults": [dict(fault) for fault in faults]}
    document = {"title": name, "scene": scene, "firmware": firmware, "script": script, "seed": seed}
    return check_scenario(document, name)


def first_tick_s(t_s: float) -> float:
    """The first tick that is not before a time, s. The compiled loop's faults begin and end with a tick."""
    return math.ceil(t_s / TICK_S) * TICK_S


def kick(numbers: Mapping[str, Any], sampled: Sampled) -> dict[str, Any]:
    """Return a kick fault of sampled size and sign at a sampled tick in the settled hold."""
    size = float(sampled.more.uniform(numbers["kick_low_m_s"], numbers["kick_high_m_s"]))
    sign = 1.0 if sampled.more.uniform() < 0.5 else -1.0
    at_s = first_tick_s(SETTLED_S + float(sampled.more.uniform(0.0, 1.0)))
    return {"kind": "kick", "at_s": at_s, "change_m_s": sign * size}


def trial_of(plan: Plan, trial: int) -> Trial:
    """Return the trial with this number: its sample and its scenario."""
    cell, numbers = plan.cell_of(trial), plan.numbers
    if isinstance(cell, WalkCell):
        sampled, course = sampled_walk(cell, numbers, plan.seed, trial)
        duration_s = course.duration_s
    else:
        swing_m_s2 = numbers.get("swing_m_s2", 0.0)
        sampled = sample(cell.scene, mismatch_of(numbers), plan.seed, trial, swing_m_s2)
        duration_s = SETTLED_S + float(numbers["hold_s"]) if "hold_s" in numbers else numbers["duration_s"]
    faults = [kick(numbers, sampled)] if "kick_low_m_s" in numbers else []
    name = f"{plan.campaign}-{plan.seed}-{trial}"
    scenario = scenario_of(
        name, sampled.tables, cell.firmware, script(cell), duration_s, sampled.run_seed, faults
    )
    return Trial(cell, sampled, scenario)
