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
from tools.campaign.trial.sampling import Sampled

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

    def name_of(self, trial: int) -> str:
        """Return the name of a trial's scenario."""
        return f"{self.campaign}-{self.seed}-{trial}"


class Trial(NamedTuple):
    """A sampled module and its scenario."""

    cell: Cell
    sampled: Sampled
    scenario: Scenario

    @property
    def omega_rad_s(self) -> float:
        """Crank speed that the operator requests."""
        return self.scenario.commands[-1].target_ratio * self.scenario.config.d.natural_rad_s


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
